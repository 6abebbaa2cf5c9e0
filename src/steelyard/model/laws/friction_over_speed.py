"""Friction over speed: Coulomb, viscous, powers of speed, Stribeck; also one per direction."""

from abc import abstractmethod
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
    is_zero,
    per_axis,
    refuse_negative,
    refuse_not_positive,
    refuse_shape,
    refuse_unknown,
    unfit,
)
from steelyard.model.terms.term import (
    ActsOnAxes,
    Cause,
    Dissipation,
    Place,
    Placed,
    Role,
    Values,
    as_one,
    curve_over_speed,
    under,
)
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


CREEP = 1e-12
"""Speed up to which the root is a straight line, so that its slope stays finite [rad/s; m/s]."""


class _OfSpeed(ActsOnAxes):
    """One parameter per coordinate, not negative, times a function of its speed."""

    dissipation: ClassVar[Dissipation] = "together"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion at several speeds of"

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        return [self.curve(axis.of(state.dq)) for axis in axes]

    @abstractmethod
    def curve(self, speed: Scalar) -> Scalar:
        """Friction per unit of the parameter; odd."""


@dataclass(frozen=True)
class Quadratic(_OfSpeed):
    r"""Friction with the square of speed, $f = f_2\,|v|\,v$: turbulent oil, fans."""

    law: ClassVar[str] = "quadratic"
    in_model_files: ClassVar[Place] = as_one("quadratic")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/({speed})²"}

    def curve(self, speed: Scalar) -> Scalar:
        """The square with the speed's sign."""
        return np.abs(speed) * speed


@dataclass(frozen=True)
class Cubic(_OfSpeed):
    r"""Friction with the cube of speed, $f = f_3\,v^3$."""

    law: ClassVar[str] = "cubic"
    in_model_files: ClassVar[Place] = as_one("cubic")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/({speed})³"}

    def curve(self, speed: Scalar) -> Scalar:
        """The cube."""
        return speed * speed * speed


@dataclass(frozen=True)
class Root(_OfSpeed):
    r"""Friction with the root of speed, $f = f_{1/2}\,\sqrt{|v|}\,\mathrm{sign}(v)$: grease."""

    law: ClassVar[str] = "root"
    in_model_files: ClassVar[Place] = curve_over_speed("friction with the root of speed")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/√({speed})"}

    def curve(self, speed: Scalar) -> Scalar:
        """The root with the speed's sign."""
        return speed / np.sqrt(np.maximum(np.abs(speed), CREEP))


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
