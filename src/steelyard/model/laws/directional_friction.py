"""Friction that differs between the two directions of motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.terms.axes import (
    DEFAULT_SHAPE,
    Axes,
    Field,
    directional,
    directions,
    refuse_negative,
    refuse_shape,
)
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation
from steelyard.model.terms.terms_in_model_files import Place, as_one


@dataclass(frozen=True)
class DirectionalCoulomb(ActsOnAxes):
    r"""Coulomb friction of its own in each direction, $f = f_+ s_+(v) + f_- s_-(v)$.

    $s_\pm = (s \pm |s|)/2$ with the sign $s$ of the velocity, or a smooth $s$ as of `Coulomb`.
    Without smoothing it says what `coulomb` and `offset` say together: use it in their place.
    """

    law: ClassVar[str] = "directional_coulomb"
    dissipation: ClassVar[Dissipation] = "each"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion in both directions of"
    in_model_files: ClassVar[Place] = as_one("dry")
    units: ClassVar[Mapping[str, str]] = {"_forward": "{effort}", "_backward": "{effort}"}
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"smoothing": (1e-3, 1.0)}
    # speed $w$ of the smooth law, one for all or one per coordinate [rad/s; m/s]; zero for the sign
    smoothing: Field = 0.0
    shape: str = DEFAULT_SHAPE  # which smooth law: `tanh`, `arctan` or `logistic`

    def __post_init__(self) -> None:
        refuse_negative(self.law, smoothing=self.smoothing)
        refuse_shape(self.law, self.shape, self.smoothing)

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The direction of motion, its positive and its negative part."""
        return directional(directions(axes, state.dq, self.smoothing, self.law, self.shape))


@dataclass(frozen=True)
class DirectionalViscous(ActsOnAxes):
    r"""Viscous friction of its own in each direction, $f = f_+ \max(v, 0) + f_- \min(v, 0)$."""

    law: ClassVar[str] = "directional_viscous"
    dissipation: ClassVar[Dissipation] = "each"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion at several speeds in both directions of"
    in_model_files: ClassVar[Place] = as_one("viscous")
    units: ClassVar[Mapping[str, str]] = {"_forward": "{rate}", "_backward": "{rate}"}

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The velocity, its positive and its negative part."""
        speeds = [axis.of(state.dq) for axis in axes]
        return [bound(x, 0.0) for bound in (np.maximum, np.minimum) for x in speeds]
