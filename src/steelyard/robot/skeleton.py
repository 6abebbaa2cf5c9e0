"""Where the bodies and joints of a robot are, for many samples at once."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array
from steelyard.robot.loop_closures import closest, loop_equations
from steelyard.robot.rigid_body import skew
from steelyard.robot.robot import Body, Frame, Robot


def bodies_along(robot: Robot, q: Array) -> tuple[list[Array], list[Array]]:
    """Axes `(N, 3, 3)` and origins `(N, 3)` [m] of base and bodies; joints `q` `(N, n_joints)`."""
    count = len(q)
    rotations = [np.broadcast_to(np.eye(3), (count, 3, 3))]
    origins = [np.zeros((count, 3))]
    for body in robot.bodies:
        turn, origin = rotations[body.parent + 1], origins[body.parent + 1]
        own, slide = _moved(body, body.ratio * q[:, body.coordinate] + body.offset)
        origins.append(origin + (turn @ (body.position + slide)[..., None])[..., 0])
        rotations.append(turn @ own)
    return rotations, origins


def all_joints(robot: Robot, q: Array) -> Array:
    """Positions `(N, n_joints)` of all joints along a motion of the independent ones `q` `(N, n)`.

    Each row is closed from the one before it, the first one from the assembly.
    """
    if not robot.passive:
        return q
    free = list(range(robot.n, robot.n_joints))
    rows, last = [], np.array(loop_equations(robot).assembly)
    for own in q:
        last = closest(robot, np.concatenate([own, last[robot.n :]]), free)
        rows.append(last)
    return np.array(rows)


def frame_origins(robot: Robot, frames: Sequence[Frame], joints: Array) -> Array:
    """Origins of frames, shape `(N, F, 3)` [m], at positions of all joints `(N, n_joints)`."""
    rotations, origins = bodies_along(robot, joints)
    at = [origins[f.body + 1] + rotations[f.body + 1] @ f.position for f in frames]
    return np.stack(at, axis=1)


def body_poses(robot: Robot, joints: Array) -> tuple[Array, Array]:
    """Axes `(B, 3, 3)` and origins `(B, 3)` [m] of the bodies, at positions of all joints."""
    rotations, origins = bodies_along(robot, joints[None])
    return np.stack([one[0] for one in rotations[1:]]), np.stack([one[0] for one in origins[1:]])


def sticks(robot: Robot, joints: Array) -> Array:
    """The robot as one broken line, from each joint to the next."""
    at = frame_origins(robot, body_frames(robot), joints[None])[0]
    gap = np.full(3, np.nan)
    pairs = [(body.parent + 1, k + 1) for k, body in enumerate(robot.bodies)]
    return np.array([row for a, b in pairs for row in (at[a], at[b], gap)])


def body_frames(robot: Robot) -> list[Frame]:
    """Of the base and of all bodies."""
    names = ["base", *(body.name for body in robot.bodies)]
    return [Frame(name, k - 1, np.eye(3), np.zeros(3)) for k, name in enumerate(names)]


def _moved(body: Body, x: Array) -> tuple[Array, Array]:
    """Rotations `(N, 3, 3)` and shifts `(N, 3)` of a body in its parent's frame."""
    if body.kind == "prismatic":
        slide = x[:, None] * (body.rotation @ body.axis)
        return np.broadcast_to(body.rotation, (len(x), 3, 3)), slide
    k = skew(body.axis)
    sine, versine = np.sin(x)[:, None, None], (1.0 - np.cos(x))[:, None, None]
    first, second = body.rotation @ k, body.rotation @ k @ k
    return body.rotation + sine * first + versine * second, np.zeros((len(x), 3))
