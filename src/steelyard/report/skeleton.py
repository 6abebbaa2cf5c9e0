"""Where a robot's joints and tool are, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.shapes.poses import Poses, ShapeKinematics
from steelyard.excitation.shapes.shapes import Shape
from steelyard.excitation.shapes.solids import Ball
from steelyard.kernel.quantities.kinematics import frame_of
from steelyard.robot.loop_equations import closest, loop_equations
from steelyard.robot.robot import Frame, Robot

if TYPE_CHECKING:
    from steelyard.excitation.constraints.markers import Marker

_SMALL = Ball(1e-3)


def all_joints(robot: Robot, q: Array) -> Array:
    """Positions of all joints, those that loops determine too, shape `(N, n_joints)`.

    Args:
        robot: The robot.
        q: Of the independent joints along a motion, shape `(N, n)` [rad; m]; each row is closed
            from the one before it, the first one from the assembly.
    """
    if not robot.passive:
        return q
    free = list(range(robot.n, robot.n_joints))
    rows, last = [], np.array(loop_equations(robot).assembly)
    for own in q:
        last = closest(robot, np.concatenate([own, last[robot.n :]]), free)
        rows.append(last)
    return np.array(rows)


def places(robot: Robot, frames: Sequence[Frame], joints: Array) -> Array:
    """Origins of frames, shape `(N, F, 3)` [m], at positions of all joints `(N, n_joints)`."""
    return _poses(robot, frames, joints).origins


def body_poses(robot: Robot, joints: Array) -> tuple[Array, Array]:
    """Axes `(B, 3, 3)` and origins `(B, 3)` [m] of the bodies, at positions of all joints."""
    poses = _poses(robot, _frames(robot)[1:], joints[None])
    return poses.rotations[0], poses.origins[0]


def _poses(robot: Robot, frames: Sequence[Frame], joints: Array) -> Poses:
    shapes = [Shape(f.name, f.body, f.rotation, f.position, _SMALL) for f in frames]
    return ShapeKinematics(robot, shapes)(joints)


def _frames(robot: Robot) -> list[Frame]:
    """Of the base and of all bodies."""
    names = ["base", *(body.name for body in robot.bodies)]
    return [Frame(name, k - 1, np.eye(3), np.zeros(3)) for k, name in enumerate(names)]


def tool_frame(robot: Robot, tool: Marker) -> Frame:
    """The tool's centre, as a frame on its body."""
    own = frame_of(robot, tool.frame)
    return Frame(own.name, own.body, own.rotation, own.position + own.rotation @ tool.offset)


def way_of(robot: Robot, tool: Marker, joints: Array) -> Array:
    """Positions of the tool's centre, shape `(N, 3)` [m]."""
    return places(robot, [tool_frame(robot, tool)], joints)[:, 0]


def skeleton(robot: Robot, tool: Marker, joints: Array) -> Array:
    """The robot as one broken line, from each joint to the next, and to the tool.

    Args:
        robot: The robot.
        tool: Its tool.
        joints: Positions of all joints, shape `(n_joints,)`.

    Returns:
        Two ends and a gap of NaN per stick, shape `(3 sticks, 3)` [m].
    """
    last = tool_frame(robot, tool)
    ends = places(robot, [_frames(robot)[last.body + 1], last], joints[None])[0]
    return np.concatenate([sticks(robot, joints), ends, np.full((1, 3), np.nan)])


def sticks(robot: Robot, joints: Array) -> Array:
    """The robot as one broken line, from each joint to the next; see `skeleton`."""
    at = places(robot, _frames(robot), joints[None])[0]
    gap = np.full(3, np.nan)
    pairs = [(body.parent + 1, k + 1) for k, body in enumerate(robot.bodies)]
    return np.array([row for a, b in pairs for row in (at[a], at[b], gap)])
