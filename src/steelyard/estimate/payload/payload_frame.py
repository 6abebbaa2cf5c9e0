"""The frame that carries a payload, and what the payload adds to the base parameters."""

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError, named
from steelyard.estimate.information.base_regressor import BaseMap
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Frame, Robot


def carrier(robot: Robot, name: str | None = None) -> Frame:
    """The frame of that name; that of the last link if none is named."""
    links = {
        body.name: Frame(body.name, k, np.eye(3), np.zeros(3))
        for k, body in enumerate(robot.bodies)
    }
    frames = links | {frame.name: frame for frame in robot.frames}
    if name is None:
        return links[robot.bodies[-1].name]
    frame = named(name, frames, "frame", "frames", f"robot '{robot.name}'")
    wrong, which = "", ""
    if frame.body < 0:
        wrong, which = "is fixed to the base: a payload there loads no joint", "frame that moves"
    elif robot.bodies[frame.body].massless:
        wrong, which = "lies between two joints of one body, and has no mass", "link with mass"
    if wrong:
        raise ModelError(
            f"frame '{name}' {wrong}",
            where=f"robot '{robot.name}'",
            fix=f"name a {which}, such as '{robot.bodies[-1].name}'",
        )
    return frame


def payload_lift(robot: Robot, base: BaseMap, frame: Frame) -> Array:
    """What a payload's ten numbers in a frame add to the base parameters, shape `(b, 10)`."""
    body = robot.bodies[frame.body].name
    if f"{INERTIAL_NAMES[0]}.{body}" not in base.names:
        raise ModelError(
            "a payload adds to the robot's bodies, but the model's terms have none",
            where=f"robot '{robot.name}', list of terms",
            fix='list the term "rigid_body", and identify the model anew',
        )
    move = np.array(
        [Inertia.from_ten(e).moved(frame.rotation, frame.position).ten for e in np.eye(10)]
    ).T
    columns = [base.names.index(f"{name}.{body}") for name in INERTIAL_NAMES]
    return np.asarray(base.lift[:, columns] @ move)
