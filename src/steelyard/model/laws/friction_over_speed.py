"""Friction over speed: Coulomb, viscous, powers of speed, Stribeck; per direction, and coupled."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Parameter
from steelyard.base.errors import ModelError
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.terms import axes_and_fields as fields
from steelyard.model.terms import term as terms
from steelyard.model.terms.axes_and_fields import Axes, Axis, Field, directional, is_zero
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation, Place, Placed
from steelyard.robot.robot import Robot


@dataclass(frozen=True, kw_only=True)
class _Directed(ActsOnAxes):
    """Friction that turns round with the direction of motion; of two units, one per direction."""

    cause: ClassVar[Cause] = "friction"
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"smoothing": (1e-3, 1.0)}
    # speed $w$ of the smooth law, one for all or one per coordinate [rad/s; m/s]; zero for the sign
    smoothing: Field = 0.0
    shape: str = fields.DEFAULT_SHAPE  # which smooth law: `tanh`, `arctan` (p3, eq 6) or `logistic`

    def __post_init__(self) -> None:
        fields.refuse_negative(self.law, smoothing=self.smoothing)
        fields.refuse_shape(self.law, self.shape, self.smoothing)

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The direction of motion, or its positive and its negative part, times `sizes`."""
        sense = fields.directions(axes, state.dq, self.smoothing, self.law, self.shape)
        each, sizes = sense if len(self.units) == 1 else directional(sense), self.sizes(axes, state)
        return each if sizes is None else [s * sizes[k % len(axes)] for k, s in enumerate(each)]

    def sizes(self, axes: Axes, state: JointState) -> Scalars | None:
        """Size of the friction along every coordinate, over that of sliding; one if `None`."""
        return None


@dataclass(frozen=True)
class Coulomb(_Directed):
    r"""Coulomb friction, $f = f_c\,s(v)$ [Nm; N if prismatic].

    $s$ is the sign of the velocity, zero up to `threshold`, or with `smoothing` $w$ the smooth
    $\tanh(v/w)$, $\tfrac{2}{\pi}\arctan(v/w)$ or $2/(1 + e^{-v/w}) - 1$.
    """

    law: ClassVar[str] = "coulomb"
    dissipation: ClassVar[Dissipation] = "each"
    shown_by: ClassVar[str] = "motion in both directions of"
    symbol: ClassVar[str] = "FC"
    # speed up to which the friction is zero, one for all or one per coordinate [rad/s; m/s]
    threshold: Field = 0.0

    def __post_init__(self) -> None:
        fields.refuse_negative(self.law, threshold=self.threshold)
        super().__post_init__()
        if not is_zero(self.threshold) and not is_zero(self.smoothing):
            raise fields.unfit(
                f"Coulomb friction with threshold {self.threshold} and smoothing {self.smoothing}",
                "give one of the two, as a positive speed, or none for the plain sign",
            )

    @property
    def role(self) -> terms.Role:
        """By the plain sign it sticks and slips: at rest it holds up to its size."""
        return "brake" if is_zero(self.threshold) and is_zero(self.smoothing) else "effort"

    def sizes(self, axes: Axes, state: JointState) -> Scalars | None:
        """Nothing up to the threshold."""
        return None if is_zero(self.threshold) else _moving(self, axes, state)

    def in_model_files(self, robot: Robot, values: terms.Values) -> Placed:
        """Dry friction by the plain sign."""
        parts = terms.under(self, robot, values, self.law, "dry")
        unsupported = tuple(
            f"{words} {getattr(self, name)} rad/s or m/s ({self.law})"
            for name, words in (
                ("smoothing", "that dry friction turns smoothly within"),
                ("threshold", "that dry friction begins above"),
            )
            if any(part.value for part in parts) and not is_zero(getattr(self, name))
        )
        return Placed(parts, unsupported=unsupported)


def _moving(term: "Coulomb | Viscous", axes: Axes, state: JointState) -> Scalars:
    """Whether the speed along every coordinate is above the threshold."""
    pairs = zip(axes, fields.per_axis(term.threshold, axes, term.law), strict=True)
    return [np.abs(axis.of(state.dq)) > rest for axis, rest in pairs]


@dataclass(frozen=True)
class DirectionalCoulomb(_Directed):
    r"""Coulomb friction of its own in each direction, $f = f_+ s_+(v) + f_- s_-(v)$.

    $s_\pm = (s \pm |s|)/2$ with the sign $s$ of the velocity, or a smooth $s$ as of `Coulomb`.
    Without smoothing it says what `coulomb` and `offset` say together: use it in their place.
    """

    law: ClassVar[str] = "directional_coulomb"
    dissipation: ClassVar[Dissipation] = "each"
    shown_by: ClassVar[str] = "motion in both directions of"
    in_model_files: ClassVar[Place] = terms.as_one("dry")
    units: ClassVar[Mapping[str, str]] = {"_forward": "{effort}", "_backward": "{effort}"}


CREEP = 1e-12
"""Speed up to which the root is a straight line, so that its slope stays finite [rad/s; m/s]."""


class _OfSpeed(ActsOnAxes):
    """A function of each coordinate's speed; of two units, its parts in each direction."""

    dissipation: ClassVar[Dissipation] = "together"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion at several speeds of"

    curve: ClassVar[Callable[[Scalar], Scalar]]
    """Friction per unit of the parameter; odd."""

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        curve = [type(self).curve(axis.of(state.dq)) for axis in axes]
        return curve if len(self.units) == 1 else directional(curve)


@dataclass(frozen=True)
class Viscous(_OfSpeed):
    r"""Viscous friction, $f = f_v\,v$ [N m s/rad; N s/m if prismatic], zero up to `threshold`."""

    law: ClassVar[str] = "viscous"
    dissipation: ClassVar[Dissipation] = "each"
    units: ClassVar[Mapping[str, str]] = {"": "{rate}"}
    curve: ClassVar[Callable[[Scalar], Scalar]] = lambda speed: speed
    symbol: ClassVar[str] = "FV"
    # speed up to which the friction is zero, one for all or one per coordinate [rad/s; m/s]
    threshold: Field = 0.0

    def __post_init__(self) -> None:
        fields.refuse_negative(self.law, threshold=self.threshold)

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The velocity above the threshold."""
        speeds = super().efforts(axes, state)
        if is_zero(self.threshold):
            return speeds
        return [v * on for v, on in zip(speeds, _moving(self, axes, state), strict=True)]

    def in_model_files(self, robot: Robot, values: terms.Values) -> Placed:
        """Viscous friction from zero speed on."""
        placed = terms.as_one("viscous")(self, robot, values)
        if is_zero(self.threshold) or not any(part.value for part in placed.parts):
            return placed
        words = f"that viscous friction begins above {self.threshold} rad/s or m/s ({self.law})"
        return replace(placed, unsupported=(*placed.unsupported, words))


@dataclass(frozen=True)
class DirectionalViscous(_OfSpeed):
    r"""Viscous friction of its own in each direction, $f = f_+ \max(v, 0) + f_- \min(v, 0)$."""

    law: ClassVar[str] = "directional_viscous"
    dissipation: ClassVar[Dissipation] = "each"
    shown_by: ClassVar[str] = "motion at several speeds in both directions of"
    in_model_files: ClassVar[Place] = terms.as_one("viscous")
    units: ClassVar[Mapping[str, str]] = {"_forward": "{rate}", "_backward": "{rate}"}

    curve: ClassVar[Callable[[Scalar], Scalar]] = lambda speed: speed


@dataclass(frozen=True)
class Quadratic(_OfSpeed):
    r"""Friction with the square of speed, $f = f_2\,|v|\,v$: turbulent oil, fans."""

    law: ClassVar[str] = "quadratic"
    in_model_files: ClassVar[Place] = terms.as_one("quadratic")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/({speed})²"}
    curve: ClassVar[Callable[[Scalar], Scalar]] = lambda speed: np.abs(speed) * speed


@dataclass(frozen=True)
class Cubic(_OfSpeed):
    r"""Friction with the cube of speed, $f = f_3\,v^3$."""

    law: ClassVar[str] = "cubic"
    in_model_files: ClassVar[Place] = terms.as_one("cubic")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/({speed})³"}
    curve: ClassVar[Callable[[Scalar], Scalar]] = lambda speed: speed * speed * speed


@dataclass(frozen=True)
class Root(_OfSpeed):
    r"""Friction with the root of speed, $f = f_{1/2}\,\sqrt{|v|}\,\mathrm{sign}(v)$: grease."""

    law: ClassVar[str] = "root"
    in_model_files: ClassVar[Place] = terms.curve_over_speed("friction with the root of speed")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/√({speed})"}
    curve: ClassVar[Callable[[Scalar], Scalar]] = lambda speed: (
        speed / np.sqrt(np.maximum(np.abs(speed), CREEP))
    )


@dataclass(frozen=True)
class Stribeck(_Directed):
    r"""Stribeck friction, the excess of breakaway over Coulomb friction.

    $$ f = (f_s - f_c)\,e^{-|v/v_s|^\beta}\,s(v) $$

    The Coulomb part is the term `coulomb`, the viscous one `viscous`.
    """

    law: ClassVar[str] = "stribeck"
    dissipation: ClassVar[Dissipation] = "together"
    shown_by: ClassVar[str] = "slow motion in both directions of"
    in_model_files: ClassVar[Place] = terms.curve_over_speed("excess of friction at breakaway")
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {
        "speed": (1e-3, 1.0),
        "smoothing": (1e-3, 1.0),
    }
    speed: Field = 0.1  # stribeck speed $v_s$, one for all or one per coordinate [rad/s; m/s]
    exponent: int = 1  # $\beta$, 1 or 2

    def __post_init__(self) -> None:
        fields.refuse_unknown(self.law, "exponent", self.exponent, (1, 2))
        fields.refuse_not_positive(self.law, speed=self.speed)
        super().__post_init__()

    def sizes(self, axes: Axes, state: JointState) -> Scalars | None:
        r"""$e^{-|v/v_s|^\beta}$ along every coordinate."""
        scales = fields.per_axis(self.speed, axes, self.law)
        relative = [axis.of(state.dq) / scale for axis, scale in zip(axes, scales, strict=True)]
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


Pair = tuple[tuple[str, str], tuple[str, str]]  # `(("from", name), ("to", name))`


@dataclass(frozen=True)
class Coupled(terms.Term):
    r"""Coupled friction, $f_b = f_{ab}\,v_a$ or $f_{ab}\,s(v_a)$: belts, cables, shared bearings.

    A coupling alone may give energy; only with the joints' own friction is the whole dissipative.
    """

    law: ClassVar[str] = "coupled"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "separate motion of the joints"
    in_model_files: ClassVar[Place] = terms.left_out("friction of one joint that loads another")
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"smoothing": (1e-3, 1.0)}
    # joints or motors, `{"from": a, "to": b}`: `b` is loaded when `a` moves
    pairs: tuple[Pair, ...] = ()
    kind: str = "viscous"  # `viscous` or `coulomb`
    # speed $w$ of $s = \tanh(v/w)$, one for all or one per pair [rad/s; m/s]; zero for the sign. Of
    # Coulomb couplings only
    smoothing: Field = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", _pairs(self.pairs))
        fields.refuse_unknown(self.law, "kind", self.kind, ("viscous", "coulomb"))
        fields.refuse_negative(self.law, smoothing=self.smoothing)
        if not self.pairs:
            raise _no_pair("no pairs")
        if self.kind == "viscous" and not is_zero(self.smoothing):
            raise fields.unfit(
                "viscous coupled friction has no smoothing",
                'leave out `smoothing`, or give kind = "coulomb"',
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per pair, of either sign."""
        return tuple(
            Parameter(
                f"{self.law}_{self.kind}.{mover.name}>{loaded.name}",
                loaded.effort_unit
                if self.kind == "coulomb"
                else loaded.unit(f"{{force}}/({mover.speed_unit})"),
            )
            for mover, loaded in self._axes(robot)
        )

    def columns(self, robot: Robot, state: JointState) -> terms.Columns:
        """The moving joint's velocity or direction, along the loaded joint."""
        pairs = self._axes(robot)
        movers = [mover for mover, _ in pairs]
        speeds: list[Scalar] = (
            fields.directions(movers, state.dq, self.smoothing, self.law)
            if self.kind == "coulomb"
            else [mover.of(state.dq) for mover in movers]
        )
        return fields.spread([loaded for _, loaded in pairs], speeds)

    def _axes(self, robot: Robot) -> list[tuple[Axis, Axis]]:
        return [
            (fields.named_axis(robot, mover), fields.named_axis(robot, loaded))
            for (_, mover), (_, loaded) in self.pairs
        ]


def _pairs(given: Any) -> tuple[Pair, ...]:
    """All pairs in their one form, from tables or two names; a table may come without a list."""
    alone = _ends(given)
    listed = given if isinstance(given, tuple | list) else (given,)
    found = [alone] if alone else [_ends(pair) or pair for pair in listed]
    for pair in found:
        names = [x for x in pair if isinstance(x, str)] if isinstance(pair, tuple | list) else []
        if len(names) != 2 or len(pair) != 2 or names[0] == names[1]:
            raise _no_pair(f"the pair {pair!r}")
    return tuple((("from", mover), ("to", loaded)) for mover, loaded in found)


def _ends(given: Any) -> tuple[Any, Any] | None:
    """The two ends in a table, or in named pairs; `None` for anything else."""
    with suppress(TypeError, ValueError):
        table = dict(given)
        if table.keys() == {"from", "to"}:
            return table["from"], table["to"]
    return None


def _no_pair(what: str) -> ModelError:
    return fields.unfit(
        f"coupled friction with {what}",
        'name two joints or motors per pair: pairs = [{from = "hip", to = "knee"}]',
    )
