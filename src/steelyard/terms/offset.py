"""A constant torque: sensor offset, or whatever else does not move."""

from dataclasses import dataclass
from typing import ClassVar

from steelyard.kernel.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.term import Columns, acting_on, diagonal, effort_unit, per_joint


@dataclass(frozen=True)
class Offset:
    r"""Constant effort, $\tau_j = o_j$ [Nm; N on a prismatic joint]."""

    law: ClassVar[str] = "offset"
    joints: tuple[str, ...] | None = None

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per joint, of either sign."""
        return per_joint(robot, self.joints, self.law, effort_unit)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """One."""
        return diagonal(acting_on(robot, self.joints), lambda j: 0.0 * state.dq[j] + 1.0)
