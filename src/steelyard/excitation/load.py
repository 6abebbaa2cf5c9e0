"""A point mass that hangs on a frame, as numbers of the body that carries it."""

from collections.abc import Mapping

import numpy as np

from steelyard.kernel.kinematics import frame_of, last_frame
from steelyard.robot.excitation_schema import LoadSection
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot


def load_numbers(load: LoadSection, robot: Robot) -> Mapping[str, float]:
    """What a load adds to standard parameters, by name; nothing where the base carries it.

    Raises:
        ModelError: Its frame does not exist.
    """
    frame = frame_of(robot, load.frame or last_frame(robot))
    if frame.body < 0:
        return {}
    com = frame.rotation @ np.array(load.com) + frame.position
    ten = Inertia.about_com(load.mass, com, np.zeros((3, 3))).ten
    body = robot.bodies[frame.body].name
    return {f"{name}.{body}": value for name, value in zip(INERTIAL_NAMES, ten, strict=True)}
