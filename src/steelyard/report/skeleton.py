"""Where a robot's joints and tool are, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.shapes.poses import ShapeKinematics
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
    shapes = [Shape(f.name, f.body, f.rotation, f.position, _SMALL) for f in frames]
    return ShapeKinematics(robot, shapes)(joints).origins


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
    still, none = np.eye(3), np.zeros(3)
    frames = [Frame(body.name, k, still, none) for k, body in enumerate(robot.bodies)]
    base, last = Frame("base", -1, still, none), tool_frame(robot, tool)
    at = places(robot, [base, *frames, last], joints[None])[0]
    pairs = [(body.parent + 1, k + 1) for k, body in enumerate(robot.bodies)]
    pairs.append((last.body + 1, len(at) - 1))
    gap = np.full(3, np.nan)
    return np.array([row for a, b in pairs for row in (at[a], at[b], gap)])
