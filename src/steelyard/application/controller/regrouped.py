r"""Mass properties of a tree with as many zeros as possible, and the same torque.

What looks the same at every position of a joint may belong to either of the two bodies that the
joint connects [Gautier1991]: of the body behind a revolute joint with axis $a$ its mass at the
joint's frame, a first moment along $a$ and a second moment $a a^T$; behind a prismatic joint all
second moments. They are moved to the parent in closed form, so the torque changes by rounding
alone; from the first body they go to the base, where they make no torque.
"""

import numpy as np

from steelyard.arrays import Array
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Body, Robot

DIAGONAL = tuple(INERTIAL_NAMES.index(name) for name in ("Ixx", "Iyy", "Izz"))


def regrouped(robot: Robot, tens: Array) -> Array:
    """Mass properties that make the same torque with more zeros.

    Args:
        robot: The robot; where chains are closed, its tree.
        tens: Ten numbers per body, shape `(n_bodies, 10)`.

    Returns:
        The same shape; a body on a parent without mass keeps all that it has.
    """
    found = np.array(tens, dtype=np.float64)
    for index in reversed(range(len(robot.bodies))):
        body = robot.bodies[index]
        if body.parent >= 0 and robot.bodies[body.parent].massless:
            continue
        moved, zeros = _movable(body, found[index])
        found[index] -= moved.ten
        found[index][zeros] = 0.0
        if body.parent >= 0:
            found[body.parent] += moved.moved(body.rotation, body.position).ten
    return found


def _movable(body: Body, ten: Array) -> tuple[Inertia, list[int]]:
    """What the parent may have of a body, and which of the ten numbers are then zero."""
    if body.kind == "prismatic":
        return Inertia.from_ten([0.0] * 4 + ten[4:].tolist()), list(range(4, 10))
    axis = body.axis
    along, across = int(np.abs(axis).argmax()), np.abs(axis).argsort(kind="stable")[:2]
    # of the two moments of inertia across the axis one is made zero, the second if none is
    zero = next((k for k in across if ten[DIAGONAL[k]] == 0.0), across[1])
    size = ten[DIAGONAL[zero]] / (1.0 - axis[zero] ** 2)
    about = size * (np.eye(3) - np.outer(axis, axis))
    moment = ten[1 + along] / axis[along] * axis
    return Inertia(ten[0], moment, about), [0, 1 + along, DIAGONAL[zero]]
