r"""Friction with memory: what a contact does before it slides, and how it gives way.

All laws here follow states $s$ along the position, exactly over every monotone step $\Delta$
between samples. Where a motion is sampled more finely, states at the old samples stay as they were;
only LuGre, whose steady state depends on the velocity, takes the velocity of a step's end for the
whole step.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array, Parameter
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.terms.axes import (
    Axes,
    Axis,
    Field,
    each,
    per_axis,
    refuse_not_positive,
    unfit,
)
from steelyard.model.terms.friction_memory import Presliding, RigidTorque, StateStep, relaxed
from steelyard.model.terms.term import INVENTED_TORQUE_SHARE, Dissipation
from steelyard.model.terms.terms_in_model_files import Place, full_sliding
from steelyard.robot.robot import Robot

PRESLIDING_DISPLACEMENT = "presliding displacement"


@dataclass(frozen=True)
class OneState(Presliding):
    """A law whose torque is one channel per coordinate, from a state over a length [rad; m]."""

    state_only_fields: ClassVar[tuple[str, ...]] = ("length",)
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"length": (1e-5, 3e-2)}
    length: Field = 3e-4

    def __post_init__(self) -> None:
        refuse_not_positive(self.law, length=self.length)

    def lengths_of(self, axes: Axes) -> list[float]:
        """One per coordinate."""
        return per_axis(self.length, axes, self.law)

    def steps(self, axes: Axes, moved: Scalars, speeds: Scalars) -> list[StateStep]:
        """A Dahl state each [Dahl1968]."""
        return [relaxed(*x) for x in zip(moved, self.lengths_of(axes), strict=True)]


@dataclass(frozen=True)
class Dahl(OneState):
    r"""Dahl friction, $f = f_c\,s$ with $ds/dq = (1 - s\,\mathrm{sign}\,\dot q)/\delta$ [Dahl1968].

    A reversal turns the friction round within some lengths $\delta$; a resting joint keeps what it
    had. Over a step $\Delta$, $s \leftarrow \pm 1 + (s \mp 1)\,e^{-|\Delta|/\delta}$.

    Attributes:
        length: Presliding length $\delta$, one for all or one per coordinate [rad; m].
    """

    law: ClassVar[str] = "dahl"
    dissipation: ClassVar[Dissipation] = "each"
    in_model_files: ClassVar[Place] = full_sliding("dahl", unsupported=PRESLIDING_DISPLACEMENT)


@dataclass(frozen=True)
class MaxwellSlip(Presliding):
    r"""Generalised Maxwell slip, $f = \sum_i f_i\,s_i$: elastic elements that slip [AlBender2005].

    An element stretches by the position and slips at the end of its length,
    $s_i \leftarrow \operatorname{clip}(s_i + \Delta/\delta_i, \pm 1)$; with `relaxing` it gives way
    gradually, as a Dahl state of length $\delta_i$ does.
    """

    law: ClassVar[str] = "maxwell_slip"
    dissipation: ClassVar[Dissipation] = "together"
    in_model_files: ClassVar[Place] = full_sliding(unsupported=PRESLIDING_DISPLACEMENT)
    state_only_fields: ClassVar[tuple[str, ...]] = ("lengths", "relaxing")
    # lengths $\delta_i$ of the elements [rad; m]
    lengths: tuple[float, ...] = (3e-4, 1e-3, 3e-3, 1e-2)
    relaxing: bool = False  # whether elements give way gradually

    def __post_init__(self) -> None:
        lengths = self.lengths if isinstance(self.lengths, tuple) else ()
        if not lengths or not all(isinstance(x, float | int) and 0.0 < x < inf for x in lengths):
            raise unfit(
                f"Maxwell slip with lengths {self.lengths!r}",
                "give one length above zero per element: lengths = [3e-4, 1e-3]",
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate and element, not negative."""
        names = [f"{self.law}{k + 1}" for k in range(len(self.lengths))]
        return tuple(p for name in names for p in each(self.axes(robot), name, "{effort}", 0.0))

    def lengths_of(self, axes: Axes) -> list[float]:
        """One per element and coordinate."""
        return [length for length in self.lengths for _ in axes]

    def steps(self, axes: Axes, moved: Scalars, speeds: Scalars) -> list[StateStep]:
        """Elements stretch, and slip at one or give way."""
        pairs = [(x, length) for length in self.lengths for x in moved]
        if self.relaxing:
            return [relaxed(x, length) for x, length in pairs]
        return [(1.0, x / length, 1.0) for x, length in pairs]

    def typical_values(
        self, robot: Robot, at_torque: Array, inertia: Callable[[Axis], float]
    ) -> Array:
        """Friction is shared among the elements."""
        return at_torque / len(self.lengths)


@dataclass(frozen=True)
class LuGre(Presliding):
    r"""LuGre friction, $f = f_c\,s + f_1\,\dot s$ with bristles bent by $s$ [CanudasDeWit1995].

    $$ \dot s = \frac{v}{\delta} - \frac{|v|}{\delta\,g(v)}\,s, \qquad
       g = 1 + (r - 1)\,e^{-(v / v_s)^2} $$

    In the customary form $\sigma_0 = f_c/\delta$ and $\sigma_1 = f_1/\delta$; its viscous part is
    the term `viscous`. $|s|$ never exceeds $r$. The velocity at a sample holds for the step into
    it: sample so that it changes by little, against $v_s$, from sample to sample.
    """

    law: ClassVar[str] = "lugre"
    dissipation: ClassVar[Dissipation] = "each"
    in_model_files: ClassVar[Place] = full_sliding(
        "lugre", unsupported=f"{PRESLIDING_DISPLACEMENT} and breakaway"
    )
    units: ClassVar[Mapping[str, str]] = {"": "{effort}", "_damping": "{force}/Hz"}
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {"lugre_damping": (0.3, 0.8)}
    state_only_fields: ClassVar[tuple[str, ...]] = ("length", "breakaway", "speed")
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {
        "length": (1e-5, 3e-2),
        "speed": (1e-3, 1.0),
    }
    # bristle deflection $\delta$ at which Coulomb friction is reached [rad; m]
    length: Field = 3e-4
    # ratio $r$ of breakaway to Coulomb friction, at least 1
    breakaway: float | tuple[float, ...] = 1.3
    speed: Field = 0.02  # stribeck speed $v_s$ [rad/s; m/s]

    def __post_init__(self) -> None:
        refuse_not_positive(
            self.law, length=self.length, breakaway=self.breakaway, speed=self.speed
        )
        ratios = self.breakaway if isinstance(self.breakaway, tuple) else (self.breakaway,)
        if min(ratios, default=1.0) < 1.0:
            raise unfit(
                f"LuGre friction breaks away at {min(ratios):g} times its Coulomb friction",
                "give `breakaway` as a ratio of at least 1, one for all or a list",
            )

    def n_channels(self, robot: Robot) -> int:
        """State and rate per coordinate."""
        return 2 * len(self.axes(robot))

    def lengths_of(self, axes: Axes) -> list[float]:
        """One per coordinate."""
        return per_axis(self.length, axes, self.law)

    def steps(self, axes: Axes, moved: Scalars, speeds: Scalars) -> list[StateStep]:
        """Bristles bend towards the level of their speed."""
        ratios = (max(x, 1.0) for x in per_axis(self.breakaway, axes, self.law))
        parts = zip(moved, self.lengths_of(axes), self._levels(axes, speeds), ratios, strict=True)
        return [relaxed(*x) for x in parts]

    def channels(
        self, robot: Robot, state: JointState, states: Scalars, torque: RigidTorque
    ) -> list[Scalar]:
        """The states and their rates."""
        axes = self.axes(robot)
        speeds = [axis.of(state.dq) for axis in axes]
        parts = zip(states, speeds, self._levels(axes, speeds), self.lengths_of(axes), strict=True)
        return [*states, *((v - np.abs(v) * s / level) / length for s, v, level, length in parts)]

    def _levels(self, axes: Axes, speeds: Scalars) -> list[Scalar]:
        """Steady states $g$ at speeds."""
        ratios, scales = (per_axis(x, axes, self.law) for x in (self.breakaway, self.speed))
        relative = [v / scale for v, scale in zip(speeds, scales, strict=True)]
        pairs = zip(relative, ratios, strict=True)
        return [1.0 + (ratio - 1.0) * np.exp(-(x * x)) for x, ratio in pairs]

    def typical_values(
        self, robot: Robot, at_torque: Array, inertia: Callable[[Axis], float]
    ) -> Array:
        r"""Dampings at which sticking is critically damped, $2 \sqrt{f_c\,\delta\,m}$."""
        axes = self.axes(robot)
        friction, lengths = at_torque[: len(axes)], self.lengths_of(axes)
        moved = np.array([inertia(axis) for axis in axes])
        damping = 2.0 * np.sqrt(np.mean(INVENTED_TORQUE_SHARE) * friction * lengths * moved)
        return np.concatenate((friction, damping))
