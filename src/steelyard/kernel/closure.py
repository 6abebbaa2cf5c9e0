r"""Closed chains: from independent joints to all joints, and their torques back.

With all positions known, pins give $H\,\dot q = 0$; split into independent and passive joints,
$\dot q_p = G \dot q_a$ with $G = -H_p^{-1} H_a$, $\ddot q_p = G \ddot q_a + \dot G \dot q_a$, and
the effort of the independent joints is $\tau_a + G^T \tau_p$ [Murray1989].
"""

from collections.abc import Mapping
from typing import Any

from steelyard.kernel.dynamics import JointState, Scalar
from steelyard.robot.robot import Robot


def completed(robot: Robot, state: JointState) -> tuple[JointState, Any]:
    """The state of all joints, and the map `G` by which passive torques load independent joints.

    Args:
        robot: The robot.
        state: Independent joints; the first channels are the positions of the passive ones.

    Returns:
        All joints, with the other channels, and `G`, indexed `[passive][independent]`; `None`
        for a tree.
    """
    if not robot.passive:
        return state, None
    raise NotImplementedError


def projected(robot: Robot, entries: Mapping[tuple[int, int], Scalar], torque_map: Any) -> Any:
    """Rows of all joints as rows of the independent ones, `(row, column)` to scalar."""
    if torque_map is None:
        return entries
    result: dict[tuple[int, int], Scalar] = {}
    for (row, column), value in entries.items():
        if row < robot.n:
            targets = [(row, value)]
        else:
            targets = [(k, g * value) for k, g in enumerate(torque_map[row - robot.n])]
        for target, part in targets:
            old = result.get((target, column))
            result[target, column] = part if old is None else old + part
    return result
