"""A constant torque: sensor offset, or whatever else does not move."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.terms.axes import spread
from steelyard.model.terms.model_files import Place, left_out
from steelyard.model.terms.term import ActsOnAxes, Cause, Columns, Dissipation
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class Offset(ActsOnAxes):
    r"""Constant effort, $f = o$ [Nm; N if prismatic]."""

    law: ClassVar[str] = "offset"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "offset"
    shown_by: ClassVar[str] = "motion both ways of"
    in_model_files: ClassVar[Place] = left_out("constant efforts")
    lower: ClassVar[float] = float("-inf")
    symbol: ClassVar[str] = "OFF"
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {"offset": (-0.03, 0.03)}

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """One."""
        return spread(self.axes(robot), lambda _, axis: 0.0 * axis.of(state.dq) + 1.0)
