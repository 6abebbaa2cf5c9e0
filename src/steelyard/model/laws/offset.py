"""A constant torque: sensor offset, or whatever else does not move."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.terms.axes import Axes
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation
from steelyard.model.terms.terms_in_model_files import Place, left_out


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

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """One."""
        return [0.0 * axis.of(state.dq) + 1.0 for axis in axes]
