"""Where a robot's joints and tool are, for pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.poses import Poses, ShapeKinematics
from steelyard.excitation.shapes import Shape
from steelyard.excitation.solids import Ball
from steelyard.kernel.kinematics import frame_of
from steelyard.robot.robot import Frame, Robot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from steelyard.excitation.markers import Marker

_SMALL = Ball(1e-3)


def frame_poses(robot: Robot, frames: Sequence[Frame], q: Array) -> Poses:
    """Poses of frames at positions of a tree's joints, shape `(N, n)`.

    Args:
        robot: A tree without loops.
        frames: One or more.
        q: Shape `(N, n)` [rad; m].

    Returns:
        With `origins` `(N, F, 3)` [m] and `rotations` `(N, F, 3, 3)`.
    """
    shapes = [Shape(f.name, f.body, f.rotation, f.position, _SMALL) for f in frames]
    return ShapeKinematics(robot, shapes)(q)


def body_frames(robot: Robot) -> list[Frame]:
    """The frames of the base and of all bodies."""
    frames = [Frame("base", -1, np.eye(3), np.zeros(3))]
    return frames + [Frame(b.name, k, np.eye(3), np.zeros(3)) for k, b in enumerate(robot.bodies)]


def tool_frame(robot: Robot, tool: Marker) -> Frame:
    """The tool's centre, as a frame on its body."""
    own = frame_of(robot, tool.frame)
    return Frame(own.name, own.body, own.rotation, own.position + own.rotation @ tool.offset)


def way_of(robot: Robot, tool: Marker, q: Array) -> Array:
    """Positions of the tool's centre, shape `(N, 3)` [m]."""
    return frame_poses(robot, [tool_frame(robot, tool)], q).origins[:, 0]


def sticks(robot: Robot, tool: Marker) -> list[tuple[int, int]]:
    """Pairs of points that sticks join: each body's origin and its parent's, and the tool.

    Points are numbered as `skeleton` gives them, without its breaks: the base, the bodies, the
    tool.
    """
    pairs = [(body.parent + 1, k + 1) for k, body in enumerate(robot.bodies)]
    return [*pairs, (tool_frame(robot, tool).body + 1, len(robot.bodies) + 1)]


def points(robot: Robot, tool: Marker, q: Array) -> Array:
    """The base, the bodies' origins and the tool, shape `(N, B + 2, 3)` [m]."""
    frames = [*body_frames(robot), tool_frame(robot, tool)]
    return frame_poses(robot, frames, q).origins


def skeleton(robot: Robot, tool: Marker, q: Array) -> Array:
    """Sticks as one broken line: two ends and a gap of NaN each, shape `(3 sticks, N, 3)` [m]."""
    at = points(robot, tool, q).transpose(1, 0, 2)
    gap = np.full_like(at[0], np.nan)
    return np.array([row for a, b in sticks(robot, tool) for row in (at[a], at[b], gap)])
