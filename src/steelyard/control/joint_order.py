"""A desired motion with its joints in the order of a model, matched by name."""

from collections.abc import Sequence

import numpy as np

from steelyard.errors import DataError
from steelyard.motion import Motion
from steelyard.robot.robot import Robot
from steelyard.suggest import advice


def ordered(motion: Motion, joints: Sequence[str] | None, robot: Robot, where: str) -> Motion:
    """The motion of a robot's joints, in their order.

    Args:
        motion: Samples, shape `(N, n)` or more columns.
        joints: Names of its columns; `None` if they are those of the robot in its order.
        robot: The robot.
        where: Where the motion comes from, for messages.

    Raises:
        DataError: A joint of the robot is missing, or there are no names and another number.
    """
    if joints is None:
        if motion.n_joints == robot.n:
            return motion
        raise DataError(
            f"the motion has {motion.n_joints} joints without names, the model {robot.n}",
            where=where,
            fix=f"name its joints; the model has {', '.join(robot.joint_names)}",
        )
    if len(joints) != motion.n_joints or len(set(joints)) != len(joints):
        raise DataError(
            f"{len(joints)} names are given for the {motion.n_joints} joints of the motion, or one "
            "twice",
            where=where,
            fix="give one name per column, each once",
        )
    for name in robot.joint_names:
        if name not in joints:
            raise DataError(
                f"the motion has no joint '{name}', which the model has",
                where=where,
                fix=advice(name, joints, "joints of the motion"),
            )
    for name in joints:
        if name not in robot.joint_names:
            raise DataError(
                f"the model has no joint '{name}', which the motion moves",
                where=where,
                fix=advice(name, robot.joint_names, "joints of the model"),
            )
    order = np.array([list(joints).index(name) for name in robot.joint_names])
    parts = (x[:, order] for x in (motion.q, motion.dq, motion.ddq))
    return Motion(motion.t, *parts)
