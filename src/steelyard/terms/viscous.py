"""Friction that grows with speed."""

from dataclasses import dataclass
from typing import ClassVar

from steelyard.kernel.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.term import Columns, acting_on, diagonal, per_joint, rate_unit


@dataclass(frozen=True)
class Viscous:
    r"""Viscous joint friction, $\tau_j = f_{v,j}\,\dot q_j$ [N m s/rad; N s/m if prismatic]."""

    law: ClassVar[str] = "viscous"
    joints: tuple[str, ...] | None = None

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per joint, not negative."""
        return per_joint(robot, self.joints, self.law, rate_unit, lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The joint's velocity."""
        return diagonal(acting_on(robot, self.joints), lambda j: state.dq[j])
