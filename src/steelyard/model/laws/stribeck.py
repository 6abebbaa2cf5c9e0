"""Friction that falls when motion begins."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.terms.axes import (
    DEFAULT_SHAPE,
    Axes,
    Field,
    directional,
    directions,
    per_axis,
    refuse_negative,
    refuse_not_positive,
    refuse_shape,
    refuse_unknown,
)
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation
from steelyard.model.terms.terms_in_model_files import Place, curve_over_speed


@dataclass(frozen=True)
class Stribeck(ActsOnAxes):
    r"""Stribeck friction, the excess of breakaway over Coulomb friction.

    $$ f = (f_s - f_c)\,e^{-|v/v_s|^\beta}\,s(v) $$

    The Coulomb part is the term `coulomb`, the viscous one `viscous`.
    """

    law: ClassVar[str] = "stribeck"
    dissipation: ClassVar[Dissipation] = "together"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "slow motion in both directions of"
    in_model_files: ClassVar[Place] = curve_over_speed("excess of friction at breakaway")
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {
        "speed": (1e-3, 1.0),
        "smoothing": (1e-3, 1.0),
    }
    speed: Field = 0.1  # stribeck speed $v_s$, one for all or one per coordinate [rad/s; m/s]
    exponent: int = 1  # $\beta$, 1 or 2
    # speed $w$ of a smooth $s$ as of `Coulomb`, one for all or one per coordinate [rad/s; m/s];
    # zero for the sign
    smoothing: Field = 0.0
    shape: str = DEFAULT_SHAPE  # which smooth $s$: `tanh`, `arctan` (p3, eq 6) or `logistic`

    def __post_init__(self) -> None:
        refuse_unknown(self.law, "exponent", self.exponent, (1, 2))
        refuse_not_positive(self.law, speed=self.speed)
        refuse_negative(self.law, smoothing=self.smoothing)
        refuse_shape(self.law, self.shape, self.smoothing)

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The direction of motion, fading with speed."""
        sense = directions(axes, state.dq, self.smoothing, self.law, self.shape)
        return [s * x for s, x in zip(sense, self.fading(axes, state.dq), strict=True)]

    def fading(self, axes: Axes, dq: Scalars) -> list[Scalar]:
        r"""$e^{-|v/v_s|^\beta}$ along every coordinate."""
        scales = per_axis(self.speed, axes, self.law)
        relative = [axis.of(dq) / scale for axis, scale in zip(axes, scales, strict=True)]
        return [np.exp(-(np.abs(x) if self.exponent == 1 else x * x)) for x in relative]


@dataclass(frozen=True)
class DirectionalStribeck(Stribeck):
    r"""Stribeck friction of its own in each direction.

    $$ f = \bigl(f_+ s_+(v) + f_- s_-(v)\bigr)\,e^{-|v/v_s|^\beta}, \qquad s_\pm = (s \pm |s|)/2 $$

    To be added to `directional_coulomb`, or to `coulomb` and `offset`. Its fields are those of
    `Stribeck`.
    """

    law: ClassVar[str] = "directional_stribeck"
    units: ClassVar[Mapping[str, str]] = {"_forward": "{effort}", "_backward": "{effort}"}

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The direction of motion, its positive and its negative part, fading with speed."""
        sense = directions(axes, state.dq, self.smoothing, self.law, self.shape)
        fading = self.fading(axes, state.dq)
        return [s * x for s, x in zip(directional(sense), fading * 2, strict=True)]
