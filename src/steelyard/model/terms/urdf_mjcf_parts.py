"""What URDF and MJCF have a place for in a law: damping, dry friction, armature, springs.

Here are the functions from which a law takes its `in_model_files`.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from steelyard.base.arrays import Array
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.terms.axes_and_fields import Axis
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
