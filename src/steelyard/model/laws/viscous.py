"""Friction that grows with speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.terms.axes import Axes
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation
from steelyard.model.terms.terms_in_model_files import Place, as_one


@dataclass(frozen=True)
class Viscous(ActsOnAxes):
    r"""Viscous friction, $f = f_v\,v$ [N m s/rad; N s/m if prismatic]."""

    law: ClassVar[str] = "viscous"
    dissipation: ClassVar[Dissipation] = "each"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion at several speeds of"
    in_model_files: ClassVar[Place] = as_one("viscous")
    units: ClassVar[Mapping[str, str]] = {"": "{rate}"}
    symbol: ClassVar[str] = "FV"

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The coordinate's velocity."""
        return [axis.of(state.dq) for axis in axes]
