"""Where model files have a place for each cause of torque: one line per law."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Axis
from steelyard.terms.direction import is_zero
from steelyard.terms.term import Term

Kind = Literal["rotor", "dry", "viscous", "quadratic", "cubic", "stiffness", "preload"]
r"""$f = I\,a + f_c\,\mathrm{sign}\,v + d_1 v + d_2 |v| v + d_3 v^3 + k x - p$, in this order."""

Values = Mapping[str, float]
"""Standard parameters by name."""


class Part(NamedTuple):
    """What acts along one coordinate."""

    axis: Axis
    kind: Kind
    value: float


class Curve(NamedTuple):
    """Friction over speed along one coordinate that is no power of speed.

    Attributes:
        axis: The coordinate.
        words: What it is.
        value: Its parameter.
        unit: Unit of that.
        force: Friction at speeds above zero [rad/s; m/s], in the unit of effort.
    """

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
    """One law in terms of what model files know.

    Attributes:
        parts: What acts along coordinates.
        curves: Friction along coordinates that is no power of speed.
        pulls: Springs between points.
        lost: What no model file has a place for, one sentence each.
    """

    parts: tuple[Part, ...] = ()
    curves: tuple[Curve, ...] = ()
    pulls: tuple[Pull, ...] = ()
    lost: tuple[str, ...] = ()


Place = Callable[[Any, Robot, Values], Placed]


def placed(term: Term, robot: Robot, values: Values) -> Placed:
    """What of a law model files have a place for, and what not."""
    found = PLACES[term.law](term, robot, values)
    if not getattr(term, "per_run", False):
        return found
    own = f"values of single runs, their mean is held ({term.law})"
    return replace(found, lost=(*found.lost, own))


def listed(numbers: Iterable[tuple[str, float, str]]) -> str:
    """Names, values and units of numbers that are not zero."""
    shown = [f"{n} {x:.4g}" + ("" if u == "1" else f" {u}") for n, x, u in numbers if x != 0.0]
    return ", ".join(shown)


def _held(kind: Kind) -> Place:
    """One parameter per coordinate that files know by another name."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        return Placed(_parts(term, robot, values, term.law, kind))

    return place


def _without(words: str) -> Place:
    """A law that files know nothing of."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        parameters = term.parameters(robot)
        named = listed((p.name.partition(".")[2], values[p.name], p.unit) for p in parameters)
        return Placed(lost=(f"{words} ({term.law}): {named}",) if named else ())

    return place


def _over_speed(words: str) -> Place:
    """One parameter per coordinate, times a function of its speed."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        named = f"{words} ({term.law})"
        curves = []
        for k, (axis, p) in enumerate(zip(term.axes(robot), term.parameters(robot), strict=True)):
            force = partial(_friction, term, robot, axis, k, values[p.name])
            curves.append(Curve(axis, named, values[p.name], p.unit, force))
        return Placed(curves=tuple(curves))

    return place


def _friction(
    term: Term, robot: Robot, axis: Axis, number: int, value: float, speeds: Array
) -> Array:
    """Force of one parameter along its coordinate, at speeds of that."""
    row = np.array(axis.row)
    direction = row / (row @ row)
    rest = [np.zeros_like(speeds)] * len(row)
    state = JointState(rest, list(np.outer(direction, speeds)), rest, [])
    columns = term.columns(robot, state)
    parts = [direction[joint] * x for (joint, k), x in columns.items() if k == number]
    return np.asarray(value * np.sum(parts, axis=0))


def _parts(
    term: Any, robot: Robot, values: Values, prefix: str, kind: Kind, factor: float = 1.0
) -> tuple[Part, ...]:
    """Parameters named `prefix.axis`, times a factor."""
    return tuple(Part(a, kind, factor * values[f"{prefix}.{a.name}"]) for a in term.axes(robot))


def _nothing(term: Any, robot: Robot, values: Values) -> Placed:
    return Placed()


def _coulomb(term: Any, robot: Robot, values: Values) -> Placed:
    parts = _parts(term, robot, values, term.law, "dry")
    lost = tuple(
        f"{words} {getattr(term, name)} rad/s or m/s ({term.law})"
        for name, words in (
            ("smoothing", "that dry friction turns smoothly within"),
            ("threshold", "that dry friction begins above"),
        )
        if any(part.value for part in parts) and not is_zero(getattr(term, name))
    )
    return Placed(parts, lost=lost)


def _directional(kind: Kind) -> Place:
    """The mean of both directions has a place."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        ends = [f"{term.law}_{end}" for end in ("forward", "backward")]
        parts = tuple(p for end in ends for p in _parts(term, robot, values, end, kind, 0.5))
        half = listed(
            (a.name, 0.5 * (values[f"{ends[0]}.{a.name}"] - values[f"{ends[1]}.{a.name}"]), unit)
            for a in term.axes(robot)
            for unit in [a.effort_unit if kind == "dry" else a.rate_unit]
        )
        words = f"that friction differs between directions, their mean is held ({term.law})"
        return Placed(parts, lost=(f"{words}: ± {half}",) if half else ())

    return place


def _sliding(*prefixes: str, lost: str) -> Place:
    """A law with memory: its friction in full sliding has a place."""

    def place(term: Any, robot: Robot, values: Values) -> Placed:
        names = prefixes or tuple(f"{term.law}{k + 1}" for k in range(len(term.lengths)))
        parts = tuple(p for name in names for p in _parts(term, robot, values, name, "dry"))
        words = f"{lost}, friction in full sliding is held ({term.law})"
        return Placed(parts, lost=(words,) if any(p.value for p in parts) else ())

    return place


def _spring(term: Any, robot: Robot, values: Values) -> Placed:
    stiffness = _parts(term, robot, values, term.law, "stiffness")
    if term.free == "unknown":
        return Placed((*stiffness, *_parts(term, robot, values, f"{term.law}_preload", "preload")))
    free = term.free if isinstance(term.free, tuple) else (term.free,) * len(stiffness)
    preload = [Part(p.axis, "preload", p.value * x) for p, x in zip(stiffness, free, strict=True)]
    return Placed((*stiffness, *preload))


def _compensator(term: Any, robot: Robot, values: Values) -> Placed:
    stiffness, preload = (p.name for p in term.parameters(robot))
    name = stiffness.partition(".")[2]
    return Placed(pulls=(Pull(name, term.links, term.points, values[stiffness], values[preload]),))


PLACES: dict[str, Place] = {
    "rigid_body": _nothing,
    "rotor_inertia": _held("rotor"),
    "coulomb": _coulomb,
    "viscous": _held("viscous"),
    "offset": _without("constant efforts"),
    "directional_coulomb": _directional("dry"),
    "directional_viscous": _directional("viscous"),
    "quadratic": _held("quadratic"),
    "cubic": _held("cubic"),
    "root": _over_speed("friction with the root of speed"),
    "stribeck": _over_speed("excess of friction at breakaway"),
    "coupled": _without("friction of one joint that loads another"),
    "load_dependent": _without("friction that grows with load"),
    "dahl": _sliding("dahl", lost="how friction gives way before it slides"),
    "maxwell_slip": _sliding(lost="how friction gives way before it slides"),
    "lugre": _sliding("lugre", lost="how friction gives way before it slides, and breaks away"),
    "spring": _spring,
    "gravity_compensator": _compensator,
}
"""By law; bodies are no matter of this table, every format holds them."""
