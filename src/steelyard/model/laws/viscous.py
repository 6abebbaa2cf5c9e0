"""Friction that grows with speed."""

from dataclasses import dataclass
from typing import ClassVar

from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.terms.axes import spread
from steelyard.model.terms.model_files import Place, as_one
from steelyard.model.terms.term import ActsOnAxes, Cause, Columns, Dissipation
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class Viscous(ActsOnAxes):
    r"""Viscous friction, $f = f_v\,v$ [N m s/rad; N s/m if prismatic]."""

    law: ClassVar[str] = "viscous"
    dissipation: ClassVar[Dissipation] = "each"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion at several speeds of"
    in_model_files: ClassVar[Place] = as_one("viscous")
    unit: ClassVar[str] = "rate_unit"
    symbol: ClassVar[str] = "FV"

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The coordinate's velocity."""
        return spread(self.axes(robot), lambda _, axis: axis.of(state.dq))
