"""Where a robot's joints and tool are, for pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.quantities.kinematics import frame_of
from steelyard.robot.robot import Frame, Robot
from steelyard.robot.skeleton import body_frames, places, sticks

if TYPE_CHECKING:
    from steelyard.excitation.constraints.markers import Marker


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
    ends = places(robot, [body_frames(robot)[last.body + 1], last], joints[None])[0]
    return np.concatenate([sticks(robot, joints), ends, np.full((1, 3), np.nan)])
