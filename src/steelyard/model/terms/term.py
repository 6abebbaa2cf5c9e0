"""A cause of torque, linear in its parameters: alone, or along coordinates.

`Placed` is what URDF and MJCF have a place for in a law: damping, dry friction, armature, springs;
the functions beside it make the `in_model_files` of laws.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from typing_extensions import Self

from steelyard.base.arrays import Array, Parameter
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.terms.axes_and_fields import Along, Axes, Axis, coordinates, each, spread
from steelyard.robot.robot import Robot

AxisPartKind = Literal["rotor", "dry", "viscous", "quadratic", "cubic", "stiffness", "preload"]
r"""$f = I\,a + f_c\,\mathrm{sign}\,v + d_1 v + d_2 |v| v + d_3 v^3 + k x - p$, in this order."""

Values = Mapping[str, float]  # standard parameters by name


class AxisPart(NamedTuple):
    """What acts along one coordinate."""

    axis: Axis
    kind: AxisPartKind
    value: float


class Curve(NamedTuple):
    """Friction over speed along one coordinate, in words; `force` is at speeds above zero."""

    axis: Axis
    words: str
    value: float
    unit: str
    force: Callable[[Array], Array]


class Pull(NamedTuple):
    """A spring between points of two links, of force `stiffness * length - preload` [N/m; N]."""

    name: str
    links: tuple[str, ...]
    points: tuple[tuple[float, ...], ...]
    stiffness: float
    preload: float


@dataclass(frozen=True)
class Placed:
    """One law in terms of what model files know; `unsupported` says what they do not."""

    parts: tuple[AxisPart, ...] = ()
    curves: tuple[Curve, ...] = ()
    pulls: tuple[Pull, ...] = ()
    unsupported: tuple[str, ...] = ()


Place = Callable[[Any, Robot, Values], Placed]


def placed(term: Any, robot: Robot, values: Values) -> Placed:
    """What of a term model files have a place for, and what not."""
    found: Placed = term.in_model_files(robot, values)
    if not term.per_run:
        return found
    own = f"values of single runs, their mean is used ({term.law})"
    return replace(found, unsupported=(*found.unsupported, own))


def listed(numbers: Iterable[tuple[str, float, str]]) -> str:
    """Names, values and units of numbers that are not zero."""
    shown = [f"{n} {x:.4g}" + ("" if u == "1" else f" {u}") for n, x, u in numbers if x != 0.0]
    return ", ".join(shown)


def under(
    term: Any, robot: Robot, values: Values, prefix: str, kind: AxisPartKind, factor: float = 1.0
) -> tuple[AxisPart, ...]:
    """Parameters named `prefix.axis` of a term, times a factor, as what a file has a place for."""
    return tuple(AxisPart(a, kind, factor * values[f"{prefix}.{a.name}"]) for a in term.axes(robot))


def as_one(kind: AxisPartKind) -> Place:
    """A parameter per coordinate that files know by another name; of both directions the mean."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        ends = [term.law + end for end in term.units]
        share = 1.0 / len(ends)
        parts = tuple(p for end in ends for p in under(term, robot, values, end, kind, share))
        return Placed(parts, unsupported=_difference(term, robot, values))

    return place


def left_out(words: str) -> Place:
    """Files know nothing of the law; the words say what it is."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        parameters = term.parameters(robot)
        named = listed((p.name.partition(".")[2], values[p.name], p.unit) for p in parameters)
        return Placed(unsupported=(f"{words} ({term.law}): {named}",) if named else ())

    return place


def curve_over_speed(words: str) -> Place:
    """A parameter per coordinate, or one per direction, times functions of speed; in words."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        axes, parameters = term.axes(robot), term.parameters(robot)
        curves = []
        for k, axis in enumerate(axes):
            own = {i: values[parameters[i].name] for i in range(k, len(parameters), len(axes))}
            force = partial(_friction, term, robot, axis, own)
            mean, unit = sum(own.values()) / len(own), parameters[k].unit
            curves.append(Curve(axis, f"{words} ({term.law})", mean, unit, force))
        return Placed(curves=tuple(curves), unsupported=_difference(term, robot, values))

    return place


def full_sliding(*prefixes: str, unsupported: str) -> Place:
    """Parameters whose names begin so, as dry friction: what a law with memory is in sliding."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        names = prefixes or tuple(f"{term.law}{k + 1}" for k in range(len(term.lengths)))
        parts = tuple(p for name in names for p in under(term, robot, values, name, "dry"))
        words = f"{unsupported}, friction in full sliding is used ({term.law})"
        return Placed(parts, unsupported=(words,) if any(p.value for p in parts) else ())

    return place


def _friction(
    term: Any, robot: Robot, axis: Axis, values: Mapping[int, float], speeds: Array
) -> Array:
    """Force of parameters along their coordinate, its part that is odd in speed."""
    row = np.array(axis.row)
    direction = row / (row @ row)

    def force(signed: Array) -> Array:
        rest = [np.zeros_like(signed)] * len(row)
        columns = term.columns(robot, JointState(rest, list(np.outer(direction, signed)), rest, []))
        parts = [values[k] * direction[j] * x for (j, k), x in columns.items() if k in values]
        return np.asarray(np.sum(parts, axis=0))

    return 0.5 * (force(speeds) - force(-speeds))


def _difference(term: Any, robot: Robot, values: Values) -> tuple[str, ...]:
    """By how much parameters forward and backward differ from their mean."""
    parameters, axes = term.parameters(robot), term.axes(robot)
    pairs = zip(axes, parameters, parameters[len(axes) :], strict=False)
    half = listed((a.name, 0.5 * (values[f.name] - values[b.name]), f.unit) for a, f, b in pairs)
    words = f"that friction differs between directions, their mean is used ({term.law})"
    return (f"{words}: ± {half}",) if half else ()


Columns = Mapping[tuple[int, int], Scalar]
"""`(joint, parameter)` to the torque per unit of that parameter; absent entries are zero."""

Dissipation = Literal["none", "each", "together"]
"""What a law knows of energy: nothing; that each of its coefficients takes some; or that it takes
some together with all others along the same coordinate, whatever the signs of its coefficients."""

Cause = Literal["inertia", "spring", "friction", "offset"]
"""What a law is about. Inertia and springs last; friction and offsets change from day to day."""

MovedInertia = Callable[[Axis], float]
"""The typical inertia that a coordinate moves [kg m²; kg]."""

Role = Literal["body", "rotor", "brake", "effort"]
"""How a simulation has a law: as mass of the bodies, as inertia of a rotor, as friction that sticks
and slips, or as an effort that is computed from the state."""

INVENTED_TORQUE_SHARE = (0.1, 0.25)
"""Least and largest share of a joint's typical torque that an invented law takes."""


class Term(ABC):
    """A cause of torque, and all that is known of it: no other file lists laws.

    A term is a frozen dataclass. What the torque is linear in are its parameters; what it is not
    linear in are its fields. Parameters are named `law.coordinate`, or with more behind the law's
    name. What has no default here, the register requires of every law.
    """

    law: ClassVar[str]
    """The term's name in files."""
    dissipation: ClassVar[Dissipation]
    """How the consistent estimate bounds it."""
    cause: ClassVar[Cause]
    """What kind of thing it is."""
    shown_by: ClassVar[str]
    """The motion that shows its parameters, to be followed by names of joints."""
    in_model_files: ClassVar[Place]
    """What of it model files have a place for: one of the functions that return a `Place`."""
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Fields that can be found from data, all speeds or lengths, to their least and greatest."""
    symbol: ClassVar[str] = ""
    """Customary letters of the parameters named `law.coordinate`; empty where none are."""
    unnamed: ClassVar[tuple[str, ...]] = ("joints", "per_run")
    """Fields that are left out where a mix of laws is named for people."""
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Shares of `typical_values` of invented parameters, by their name up to the dot, if others
    than `INVENTED_TORQUE_SHARE`, of either sign where the parameter may have either."""
    needs_reference: ClassVar[bool] = False
    """Whether its columns need a reference model, see `with_reference`."""
    per_run: bool = False
    """Whether every run has parameters of its own."""

    @abstractmethod
    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Names, units and bounds, in the order of the columns."""

    @abstractmethod
    def columns(self, robot: Robot, state: JointState) -> Columns:
        """Torque of all joints per unit of each parameter, over symbols or samples."""

    def n_channels(self, robot: Robot) -> int:
        """Number of channels, which are computed along a motion; see `StatefulTerm`."""
        return 0

    @classmethod
    def drifts(cls) -> bool:
        """Whether its parameters change from day to day."""
        return cls.cause in ("friction", "offset")

    @property
    def role(self) -> Role:
        """How a simulation has it."""
        return "effort"

    @property
    def on_motors(self) -> bool:
        """Whether it acts before the gears, so that a sensor behind them does not feel it."""
        return False

    def with_reference(self, values: Mapping[str, float]) -> Self:
        """The same term with another reference model, the numbers of its bodies by name."""
        return self

    def typical_values(self, robot: Robot, at_torque: Array, inertia: MovedInertia) -> Array:
        """What invented parameters are measured by, shape `(parameters,)`.

        `at_torque` has the value at which each parameter alone loads a joint with its typical
        torque, `inertia` the typical inertia that a coordinate moves [kg m²; kg].
        """
        return at_torque


@dataclass(frozen=True, eq=False)
class TermSamples:
    """Consecutive samples of all joints, `(n_joints, N)`, as a term with channels sees them.

    `rigid_torque` gives torques of the bodies, likewise, for ten numbers per body, `(10
    n_bodies,)`.
    """

    q: Array
    dq: Array
    ddq: Array
    rigid_torque: Callable[[Array], Array]


class StatefulTerm(Term):
    """A term whose columns need a scan along the motion: its channels are in the state."""

    state_only_fields: ClassVar[tuple[str, ...]]
    """Fields that act on the channels alone; the columns over the channels do not know them."""

    @abstractmethod
    def n_channels(self, robot: Robot) -> int:
        """Number of channels."""

    def warm_up(self, robot: Robot) -> Array:
        """Travel of each joint after which the unknown start is forgotten, `(n_joints,)`."""
        return np.zeros(robot.n_joints)

    @abstractmethod
    def remember(self, robot: Robot, samples: TermSamples, memory: Any) -> tuple[Array, Any]:
        """Channels `(n_channels, N)` of consecutive samples, and the memory at their end.

        `memory` is what the call before returned; `None` at the start of a motion.
        """


def has_memory(terms: Sequence[Term]) -> bool:
    """Whether friction at rest is known: some law has a memory of where the joint came from."""
    return any(isinstance(term, StatefulTerm) for term in terms)


def columns_at_rest(term: Term, robot: Robot) -> Columns:
    """Columns over one sample of zeros."""
    still = [np.zeros(1)] * robot.n_joints
    channels = [np.zeros(1)] * term.n_channels(robot)
    return term.columns(robot, JointState(still, still, still, channels))


@dataclass(frozen=True, kw_only=True)
class ActsOnAxes(Term):
    """Where a term acts; every law that acts along coordinates has these fields."""

    lower: ClassVar[float] = 0.0
    """Least value of the parameters."""
    units: ClassVar[Mapping[str, str]] = {"": "{effort}"}
    """What stands behind the law's name in that of a parameter, such as `_forward`, to the unit,
    see `Axis.unit`."""
    # names of the joints it acts on, or one name; all independent ones if nothing is named
    joints: tuple[str, ...] | str | None = None
    # names of motors of the robot's transmission, or one name
    motors: tuple[str, ...] | str | None = None
    # coordinates of its own, by name: `{wrist = {joint_5 = 1.0, joint_6 = 1.0}}`; sizes of
    # coefficients from 1e-6 to 1e6
    along: Along | None = None
    per_run: bool = False  # whether every run has parameters of its own

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate and entry of `units`, not negative unless the law says so."""
        axes, units = self.axes(robot), self.units.items()
        return tuple(p for end, unit in units for p in each(axes, self.law + end, unit, self.lower))

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """Efforts along its coordinates, as torques of the joints."""
        axes = self.axes(robot)
        return spread(axes, self.efforts(axes, state))

    @abstractmethod
    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """Effort per unit of each parameter, those of all axes one after another."""

    def axes(self, robot: Robot) -> tuple[Axis, ...]:
        """The coordinates it acts along."""
        return coordinates(robot, self.joints, self.motors, self.along)

    @property
    def on_motors(self) -> bool:
        """Whether it names motors."""
        return self.motors is not None
