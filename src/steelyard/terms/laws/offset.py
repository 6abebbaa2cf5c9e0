"""A constant torque: sensor offset, or whatever else does not move."""

from dataclasses import dataclass
from typing import ClassVar

from steelyard.kernel.equations.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Acting, each, spread
from steelyard.terms.term import Columns


@dataclass(frozen=True)
class Offset(Acting):
    r"""Constant effort, $f = o$ [Nm; N if prismatic]."""

    law: ClassVar[str] = "offset"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, of either sign."""
        return each(self.axes(robot), self.law, lambda axis: axis.effort_unit)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """One."""
        return spread(self.axes(robot), lambda _, axis: 0.0 * axis.of(state.dq) + 1.0)
