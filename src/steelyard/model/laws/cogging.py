"""Torque that is periodic in the position: cogging of motors, ripple of gears."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.terms.axes import Axes, Field, per_axis, refuse_not_positive
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation
from steelyard.model.terms.terms_in_model_files import Place, left_out


@dataclass(frozen=True)
class Cogging(ActsOnAxes):
    r"""Effort with a period in the position, $f = a\sin(2\pi x/p) + b\cos(2\pi x/p)$ [Nm; N].

    Of a motor with $c$ equal poles or teeth behind gears of ratio $r$ the period at the joint is
    $p = 2\pi / (c\,r)$ [rad]; a check of the residuals finds it.
    """

    law: ClassVar[str] = "cogging"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "spring"
    shown_by: ClassVar[str] = "slow motion over several periods of"
    in_model_files: ClassVar[Place] = left_out("efforts periodic in the position")
    lower: ClassVar[float] = float("-inf")
    units: ClassVar[Mapping[str, str]] = {"_sin": "{effort}", "_cos": "{effort}"}
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {
        "cogging_sin": (-0.1, 0.1),
        "cogging_cos": (-0.1, 0.1),
    }
    period: Field = 0.1  # $p$, one for all or one per coordinate [rad; m]

    def __post_init__(self) -> None:
        refuse_not_positive(self.law, period=self.period)

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """Sines of all axes, then cosines."""
        periods = per_axis(self.period, axes, self.law)
        phases = [2.0 * np.pi / p * axis.of(state.q) for axis, p in zip(axes, periods, strict=True)]
        return [*(np.sin(x) for x in phases), *(np.cos(x) for x in phases)]
