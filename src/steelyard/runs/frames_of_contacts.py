"""Pose and Jacobian of the frames that contacts are on, compiled once per robot."""

import json
from functools import lru_cache

from steelyard.model.equations.frame_and_point_kinematics import FrameKinematics, frame_kinematics
from steelyard.robot.file.signals import BaseSignals
from steelyard.robot.robot import robot_from_dict


def kinematics_of(base: BaseSignals, frames: tuple[str, ...]) -> tuple[FrameKinematics, ...]:
    """Of some frames of the robot whose base it is."""
    return _kinematics(json.dumps(base.tree), frames)


@lru_cache(maxsize=16)
def _kinematics(tree: str, frames: tuple[str, ...]) -> tuple[FrameKinematics, ...]:
    robot = robot_from_dict(json.loads(tree))
    return tuple(frame_kinematics(robot, frame) for frame in frames)
