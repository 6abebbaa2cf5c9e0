r"""Friction with memory: what a contact does before it slides, and friction that grows with load.

All laws here follow states $s$ along the position, exactly over every monotone step $\Delta$
between samples. Where a motion is sampled more finely, states at the old samples stay as they were;
only LuGre, whose steady state depends on the velocity, takes the velocity of a step's end for the
whole step.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any, ClassVar

import numpy as np
from typing_extensions import Self

from steelyard.base.arrays import Array, Parameter
from steelyard.base.errors import advice
from steelyard.model.equations import inverse_dynamics as rigid
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.terms import axes_and_fields as fields
from steelyard.model.terms import term as terms
from steelyard.model.terms.axes_and_fields import Axes, Field
from steelyard.model.terms.stateful_terms import Presliding, RigidTorque, StateStep, relaxed
from steelyard.model.terms.term import Dissipation, Place
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.robot import Robot

PRESLIDING_DISPLACEMENT = "presliding displacement"


@dataclass(frozen=True)
class OneState(Presliding):
    """A law whose torque is one channel per coordinate, from a state over a length [rad; m]."""

    state_only_fields: ClassVar[tuple[str, ...]] = ("length",)
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"length": (1e-5, 3e-2)}
    length: Field = 3e-4

    def __post_init__(self) -> None:
        fields.refuse_not_positive(self.law, length=self.length)

    def lengths_of(self, axes: Axes) -> list[float]:
        """One per coordinate."""
        return fields.per_axis(self.length, axes, self.law)

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
    in_model_files: ClassVar[Place] = terms.full_sliding(
        "dahl", unsupported=PRESLIDING_DISPLACEMENT
    )


@dataclass(frozen=True)
class MaxwellSlip(Presliding):
    r"""Generalised Maxwell slip, $f = \sum_i f_i\,s_i$: elastic elements that slip [AlBender2005].

    An element stretches by the position and slips at the end of its length,
    $s_i \leftarrow \operatorname{clip}(s_i + \Delta/\delta_i, \pm 1)$; with `relaxing` it gives way
    gradually, as a Dahl state of length $\delta_i$ does.
    """

    law: ClassVar[str] = "maxwell_slip"
    dissipation: ClassVar[Dissipation] = "together"
    in_model_files: ClassVar[Place] = terms.full_sliding(unsupported=PRESLIDING_DISPLACEMENT)
    state_only_fields: ClassVar[tuple[str, ...]] = ("lengths", "relaxing")
    # lengths $\delta_i$ of the elements [rad; m]
    lengths: tuple[float, ...] = (3e-4, 1e-3, 3e-3, 1e-2)
    relaxing: bool = False  # whether elements give way gradually

    def __post_init__(self) -> None:
        lengths = self.lengths if isinstance(self.lengths, tuple) else ()
        if not lengths or not all(isinstance(x, float | int) and 0.0 < x < inf for x in lengths):
            raise fields.unfit(
                f"Maxwell slip with lengths {self.lengths!r}",
                "give one length above zero per element: lengths = [3e-4, 1e-3]",
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate and element, not negative."""
        names = [f"{self.law}{k + 1}" for k in range(len(self.lengths))]
        return tuple(
            p for name in names for p in fields.each(self.axes(robot), name, "{effort}", 0.0)
        )

    def lengths_of(self, axes: Axes) -> list[float]:
        """One per element and coordinate."""
        return [length for length in self.lengths for _ in axes]

    def steps(self, axes: Axes, moved: Scalars, speeds: Scalars) -> list[StateStep]:
        """Elements stretch, and slip at one or give way."""
        pairs = [(x, length) for length in self.lengths for x in moved]
        if self.relaxing:
            return [relaxed(x, length) for x, length in pairs]
        return [(1.0, x / length, 1.0) for x, length in pairs]

    def typical_values(self, robot: Robot, at_torque: Array, inertia: terms.MovedInertia) -> Array:
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
    in_model_files: ClassVar[Place] = terms.full_sliding(
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
        fields.refuse_not_positive(
            self.law, length=self.length, breakaway=self.breakaway, speed=self.speed
        )
        ratios = self.breakaway if isinstance(self.breakaway, tuple) else (self.breakaway,)
        if min(ratios, default=1.0) < 1.0:
            raise fields.unfit(
                f"LuGre friction breaks away at {min(ratios):g} times its Coulomb friction",
                "give `breakaway` as a ratio of at least 1, one for all or a list",
            )

    def n_channels(self, robot: Robot) -> int:
        """State and rate per coordinate."""
        return 2 * len(self.axes(robot))

    def lengths_of(self, axes: Axes) -> list[float]:
        """One per coordinate."""
        return fields.per_axis(self.length, axes, self.law)

    def steps(self, axes: Axes, moved: Scalars, speeds: Scalars) -> list[StateStep]:
        """Bristles bend towards the level of their speed."""
        ratios = (max(x, 1.0) for x in fields.per_axis(self.breakaway, axes, self.law))
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
        ratios, scales = (fields.per_axis(x, axes, self.law) for x in (self.breakaway, self.speed))
        relative = [v / scale for v, scale in zip(speeds, scales, strict=True)]
        pairs = zip(relative, ratios, strict=True)
        return [1.0 + (ratio - 1.0) * np.exp(-(x * x)) for x, ratio in pairs]

    def typical_values(self, robot: Robot, at_torque: Array, inertia: terms.MovedInertia) -> Array:
        r"""Dampings at which sticking is critically damped, $2 \sqrt{f_c\,\delta\,m}$."""
        axes = self.axes(robot)
        friction, lengths = at_torque[: len(axes)], self.lengths_of(axes)
        moved = np.array([inertia(axis) for axis in axes])
        damping = 2.0 * np.sqrt(np.mean(terms.INVENTED_TORQUE_SHARE) * friction * lengths * moved)
        return np.concatenate((friction, damping))


PLAUSIBLE = 0.5
r"""Largest $\mu$ of robots' gears: an efficiency of 67 %, about that of strain wave gears in the
cold or at small torque; planetary and cycloidal gears have 80 to 95 %."""


@dataclass(frozen=True)
class LoadDependent(OneState):
    r"""Load-dependent friction, $f = \mu\,|\tau_\mathrm{rigid}|\,s$, without a unit.

    $\tau_\mathrm{rigid}$ is what the rigid bodies of a reference model load the coordinate with,
    $s$ the direction of motion as a Dahl state [Dahl1968]. The reference is frozen, so the torque
    stays linear in $\mu$; an outer loop may refit it.

    Attributes:
        length: Presliding length of the direction, one for all or one per coordinate [rad; m].
        reference: Ten numbers per body by name, `{"m.forearm": 3.2, ...}`, absent ones zero; the
            robot's nominal bodies if nothing is named.
    """

    law: ClassVar[str] = "load_dependent"
    dissipation: ClassVar[Dissipation] = "none"
    shown_by: ClassVar[str] = "motion in both directions under several loads of"
    in_model_files: ClassVar[Place] = terms.left_out("friction that grows with load")
    unnamed: ClassVar[tuple[str, ...]] = ("per_run", "reference")
    units: ClassVar[Mapping[str, str]] = {"": "1"}
    needs_reference: ClassVar[bool] = True
    state_only_fields: ClassVar[tuple[str, ...]] = ("length", "reference")
    reference: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "reference", _numbers(self.reference))

    def with_reference(self, values: Mapping[str, float]) -> Self:
        """The same law with another reference model; parameters of other laws do not matter."""
        bodies = {n: float(v) for n, v in values.items() if n.split(".")[0] in INERTIAL_NAMES}
        if not bodies:
            raise fields.unfit(
                "the reference of load-dependent friction names no number of a body",
                'list "rigid_body" among the terms, or give standard parameters by name: '
                '{"m.forearm": 3.2, ...}',
            )
        return replace(self, reference=tuple(bodies.items()))

    def channels(
        self, robot: Robot, state: JointState, states: Scalars, torque: RigidTorque
    ) -> list[Scalar]:
        """Load times direction."""
        borne = _borne(robot, state, list(torque(self.reference_of(robot))))
        found = []
        for share, sense in zip(_shares(robot, self.axes(robot)), states, strict=True):
            load, *others = (float(c) * x for c, x in zip(share, borne, strict=True) if c)
            found.append(np.abs(sum(others, load)) * sense)
        return found

    def reference_of(self, robot: Robot) -> Array:
        """Ten numbers per body of the reference, shape `(10 n_bodies,)`."""
        if not self.reference:
            if not robot.nominal.any():
                raise fields.unfit(
                    "load-dependent friction needs a reference model, but no body has a mass",
                    "give the robot's links masses, or the term a `reference` from an "
                    "earlier result",
                    robot,
                )
            return robot.nominal.ravel()
        names = [p.name for p in RigidBody().parameters(robot)]
        values = dict(self.reference)
        if strange := [name for name in values if name not in names]:
            raise fields.unfit(
                f"the reference of load-dependent friction names '{strange[0]}'",
                advice(strange[0], names, "numbers of bodies"),
                robot,
            )
        return RigidBody.numbers_of(robot, values)


def _numbers(reference: Any) -> tuple[tuple[str, float], ...]:
    """Named finite numbers, from a table or named pairs."""
    try:
        values = tuple((str(name), float(x)) for name, x in dict(reference).items())
    except (TypeError, ValueError):
        values = None
    if values is None or not all(isfinite(x) for _, x in values):
        raise fields.unfit(
            f"load-dependent friction has reference = {reference!r}",
            'give finite numbers of bodies by name: reference = {"m.forearm" = 3.2}',
        )
    return values


def _borne(robot: Robot, state: JointState, torque: list[Scalar]) -> list[Scalar]:
    """What the joints bear of the rigid bodies' torque; passive joints bear nothing."""
    if not robot.passive:
        return torque
    n = robot.n
    _, torque_map = rigid.completed(
        robot, JointState(state.q[:n], state.dq[:n], state.ddq[:n], state.q[n:])
    )
    rows = rigid.projected(robot, {(row, 0): x for row, x in enumerate(torque)}, torque_map)
    return [*(rows[row, 0] for row in range(n)), *(0.0 * x for x in torque[n:])]


def _shares(robot: Robot, axes: Axes) -> Array:
    r"""Loads along the axes per torque of the joints, shape `(axes, n_joints)`.

    A motor bears its row of $R^{-T}\tau$; another coordinate $c$ bears $c \cdot \tau / \|c\|^2$.
    """
    gears, rows = robot.transmission, []
    for axis in axes:
        row = np.array(axis.row)
        share = row / (row @ row)
        if gears is not None and axis.name in gears.motors:
            motor = gears.motors.index(axis.name)
            if np.array_equal(row[: robot.n], gears.matrix[motor]):
                share = np.zeros(robot.n_joints)
                share[: robot.n] = np.linalg.inv(gears.matrix)[:, motor]
        rows.append(share)
    return np.array(rows)
