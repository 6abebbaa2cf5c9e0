"""Dry friction: a constant torque against the direction of motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.terms.axes import (
    DEFAULT_SHAPE,
    Axes,
    Field,
    directions,
    is_zero,
    per_axis,
    refuse_negative,
    refuse_shape,
    unfit,
)
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation, Role
from steelyard.model.terms.terms_in_model_files import Placed, Values, under
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class Coulomb(ActsOnAxes):
    r"""Coulomb friction, $f = f_c\,s(v)$ [Nm; N if prismatic].

    $s$ is the sign of the velocity, zero up to `threshold`, or with `smoothing` $w$ the smooth
    $\tanh(v/w)$, $\tfrac{2}{\pi}\arctan(v/w)$ or $2/(1 + e^{-v/w}) - 1$.
    """

    law: ClassVar[str] = "coulomb"
    dissipation: ClassVar[Dissipation] = "each"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion in both directions of"
    symbol: ClassVar[str] = "FC"
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"smoothing": (1e-3, 1.0)}
    # speed up to which the friction is zero, one for all or one per coordinate [rad/s; m/s]
    threshold: Field = 0.0
    smoothing: Field = 0.0  # speed $w$ of the smooth law, likewise; zero for the sign
    shape: str = DEFAULT_SHAPE  # which smooth law: `tanh`, `arctan` or `logistic`

    def __post_init__(self) -> None:
        refuse_negative(self.law, threshold=self.threshold, smoothing=self.smoothing)
        refuse_shape(self.law, self.shape, self.smoothing)
        if not is_zero(self.threshold) and not is_zero(self.smoothing):
            raise unfit(
                f"Coulomb friction with threshold {self.threshold} and smoothing {self.smoothing}",
                "give one of the two, as a positive speed, or none for the plain sign",
            )

    @property
    def role(self) -> Role:
        """By the plain sign it sticks and slips: at rest it holds up to its size."""
        return "brake" if is_zero(self.threshold) and is_zero(self.smoothing) else "effort"

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """Direction of motion."""
        sense = directions(axes, state.dq, self.smoothing, self.law, self.shape)
        if is_zero(self.threshold):
            return sense
        parts = zip(sense, axes, per_axis(self.threshold, axes, self.law), strict=True)
        return [s * (np.abs(axis.of(state.dq)) > rest) for s, axis, rest in parts]

    def in_model_files(self, robot: Robot, values: Values) -> Placed:
        """Dry friction by the plain sign."""
        parts = under(self, robot, values, self.law, "dry")
        unsupported = tuple(
            f"{words} {getattr(self, name)} rad/s or m/s ({self.law})"
            for name, words in (
                ("smoothing", "that dry friction turns smoothly within"),
                ("threshold", "that dry friction begins above"),
            )
            if any(part.value for part in parts) and not is_zero(getattr(self, name))
        )
        return Placed(parts, unsupported=unsupported)
