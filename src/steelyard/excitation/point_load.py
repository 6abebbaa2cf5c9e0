"""Loads that hang on a frame, as mass properties and as numbers of the body that carries them."""

from collections.abc import Mapping

import numpy as np

from steelyard.kernel.quantities.kinematics import frame_of, last_frame
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot
from steelyard.robot_file.excitation_sections import LoadSection

SHELL = 2.0 / 3.0
"""Inertia of a hollow ball about its centre, over its mass and its radius squared."""

COUNTED = (
    "torques hold for loads of any inertia from a point mass to a hollow sphere of the load's "
    "radius "
    "about its centre of mass, alike about all axes; not for an elongated one"
)
"""What torques count of loads."""


def load_inertias(load: LoadSection) -> Mapping[str, Inertia]:
    """Mass properties of a load in its frame, by what it is: between these torques are linear."""
    shell = SHELL * load.mass * load.ball**2
    return {
        "as a point": Inertia.about_com(load.mass, load.com, np.zeros((3, 3))),
        f"as a hollow sphere of {1e3 * load.ball:.3g} mm": Inertia.about_com(
            load.mass, load.com, shell * np.eye(3)
        ),
    }


def load_numbers(load: LoadSection, robot: Robot) -> Mapping[str, float]:
    """What a point mass adds to standard parameters, by name; nothing where the base carries it.

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
