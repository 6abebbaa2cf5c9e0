r"""Coordinates that terms act along, their directions, and fields to be found from data.

Along the row $c$ the velocity is $c \cdot \dot q$, and an effort $f$ loads the joints with
$c^T f$: the motor behind a differential that turns with $q_5 + q_6$ brakes both joints.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

import numpy as np

from steelyard.base.arrays import Parameter
from steelyard.base.errors import ModelError
from steelyard.model.equations.inverse_dynamics import Scalar, Scalars
from steelyard.robot.robot import JointKind, Robot

Along = tuple[tuple[str, tuple[tuple[str, float], ...]], ...]
"""Named coordinates, each the joints it is made of with their coefficients."""

COEFFICIENTS = (1e-6, 1e6)
"""Sizes that coefficients of a joint in a coordinate may have, if they are not zero."""


@dataclass(frozen=True)
class Axis:
    """A named coordinate that a term acts along, `row` of all joints' coefficients."""

    name: str
    row: tuple[float, ...]
    kind: JointKind

    def of(self, values: Scalars) -> Scalar:
        """`c` times the joints' positions, velocities or accelerations."""
        total: Scalar = None
        for coefficient, value in zip(self.row, values, strict=True):
            if coefficient:
                part = value if coefficient == 1.0 else coefficient * value
                total = part if total is None else total + part
        return total

    def unit(self, words: str) -> str:
        """A unit from those of `_UNITS` in braces, such as `{force}/({speed})²`."""
        return words.format(**_UNITS[self.kind])

    @property
    def effort_unit(self) -> str:
        """Unit of effort."""
        return self.unit("{effort}")

    @property
    def speed_unit(self) -> str:
        """Unit of velocity."""
        return self.unit("{speed}")


_WORDS = ("effort", "force", "speed", "rate", "inertia", "stiffness", "position")
_TURNING = ("Nm", "N m", "rad/s", "N m s/rad", "kg m²", "N m/rad", "rad")
_SLIDING = ("N", "N", "m/s", "N s/m", "kg", "N/m", "m")
_UNITS = {
    "revolute": dict(zip(_WORDS, _TURNING, strict=True)),
    "prismatic": dict(zip(_WORDS, _SLIDING, strict=True)),
}
"""Units of effort (alone, and in a product), velocity, effort per velocity, acceleration and
position, and of position."""

Axes = Sequence[Axis]


def coordinates(
    robot: Robot, joints: Any = None, motors: Any = None, along: Any = None
) -> tuple[Axis, ...]:
    """Coordinates by the names of joints and motors, and as sums; all joints if none is named."""
    if joints is None and motors is None and along is None:
        return tuple(_joint(robot, c.name) for c in robot.coordinates[robot.n_base :])
    named = [_joint(robot, name) for name in _listed(joints, "joints")]
    named += [_motor(robot, name) for name in _listed(motors, "motors")]
    named += [_combined(robot, name, parts) for name, parts in _sums(along)]
    return tuple(named)


def each(axes: Axes, law: str, unit: str, lower: float = float("-inf")) -> tuple[Parameter, ...]:
    """One parameter named `law.axis` for every axis, of a unit as of `Axis.unit`."""
    return tuple(Parameter(f"{law}.{axis.name}", axis.unit(unit), lower=lower) for axis in axes)


def spread(axes: Axes, efforts: Scalars) -> dict[tuple[int, int], Scalar]:
    """Columns of efforts per unit of each parameter, along one axis after another."""
    columns: dict[tuple[int, int], Scalar] = {}
    for k, effort in enumerate(efforts):
        for joint, coefficient in enumerate(axes[k % len(axes)].row):
            if coefficient:
                columns[joint, k] = effort if coefficient == 1.0 else coefficient * effort
    return columns


def directional(values: Scalars) -> list[Scalar]:
    """The parts of directions of motion above zero, then those below."""
    return [0.5 * (x + sign * np.abs(x)) for sign in (1.0, -1.0) for x in values]


def per_axis(values: float | tuple[float, ...], axes: Axes, law: str) -> list[float]:
    """One positive value of a field for every axis, from one for all or a list."""
    if isinstance(values, Find):
        raise unfit(
            f"a nonlinear parameter of term '{law}' is not estimated yet",
            "estimate it from logs first, with `steelyard identify` or `find_fields`, or give "
            "a number",
        )
    given = values if isinstance(values, tuple) else (values,) * len(axes)
    if len(given) != len(axes) or not all(value > 0.0 for value in given):
        raise unfit(
            f"term '{law}' has {values} for {len(axes)} coordinates",
            "give one value above zero for all, or a list with one per coordinate",
        )
    return list(given)


def unfit(wrong: str, fix: str, robot: Robot | None = None) -> ModelError:
    """What is wrong with a term, by itself or of a robot."""
    place = "list of terms" if robot is None else f"robot '{robot.name}', list of terms"
    return ModelError(wrong, where=place, fix=fix)


def named_axis(robot: Robot, name: str) -> Axis:
    """The coordinate of a joint or, where no joint has the name, of a motor."""
    gears = robot.transmission
    if gears is not None and name in gears.motors and name not in (c.name for c in robot.joints):
        return _motor(robot, name)
    return _joint(robot, name)


def _listed(names: Any, what: str) -> tuple[str, ...]:
    """Names, none if nothing is given; one alone may come without a list."""
    listed = (names,) if isinstance(names, str) else () if names is None else names
    if (
        not isinstance(listed, tuple | list)
        or (names is not None and not listed)
        or not all(isinstance(name, str) for name in listed)
    ):
        raise unfit(
            f"a term acts on {what} = {names!r}",
            f'list names: {what} = ["...", "..."], or leave `{what}` out',
        )
    return tuple(listed)


def _sums(along: Any) -> Along:
    """Coordinates of a term's own, none if nothing is given; their form is checked."""
    if along is None:
        return ()
    sums: Along = ()
    with suppress(TypeError, ValueError):
        sums = tuple((str(n), tuple((str(j), float(c)) for j, c in p)) for n, p in along)
    if not sums or not all(isfinite(c) for _, parts in sums for _, c in parts):
        raise unfit(
            f"a term acts along {along!r}",
            "give every coordinate the joints it is made of: "
            "along = {wrist = {joint_5 = 1.0, joint_6 = 1.0}}",
        )
    return sums


def _joint(robot: Robot, name: str) -> Axis:
    names = [c.name for c in robot.joints]
    if name not in names:
        raise unfit(
            f"a term acts on joint '{name}', which is not identified",
            f"use names of {', '.join(names)}",
            robot,
        )
    k = names.index(name)
    return Axis(name, tuple(float(j == k) for j in range(len(names))), robot.joints[k].kind)


def _motor(robot: Robot, name: str) -> Axis:
    gears = robot.transmission
    if gears is None or name not in gears.motors:
        raise unfit(
            f"a term acts on motor '{name}', which the robot does not have",
            "give the robot a [robot.transmission]"
            if gears is None
            else f"use names of {', '.join(gears.motors)}",
            robot,
        )
    row = gears.matrix[gears.motors.index(name)].tolist()
    return Axis(name, (*row, *(0.0 for _ in robot.passive)), "revolute")


def _combined(robot: Robot, name: str, parts: tuple[tuple[str, float], ...]) -> Axis:
    total = [0.0] * robot.n_joints
    kinds = set()
    for joint, coefficient in parts:
        axis = _joint(robot, joint)
        kinds.add(axis.kind)
        total[axis.row.index(1.0)] += coefficient
    wrong = None
    least, most = COEFFICIENTS
    if len(kinds) != 1:
        wrong = f"coordinate '{name}' mixes kinds of joints" if kinds else f"'{name}' has no joint"
    elif not any(total):
        wrong = f"coordinate '{name}' does not move: all its coefficients are zero"
    elif beyond := [c for c in total if c and not least <= abs(c) <= most]:
        wrong = f"coordinate '{name}' has a coefficient of {beyond[0]:g}"
    if wrong is not None:
        raise unfit(
            wrong,
            f"combine joints of one kind, with coefficients of sizes from {least:g} to "
            f"{most:g}: {{wrist = {{joint_5 = 1.0, joint_6 = 1.0}}}}",
            robot,
        )
    return Axis(name, tuple(total), kinds.pop())


SHAPES: dict[str, Callable[[Scalar], Scalar]] = {
    "tanh": np.tanh,
    "arctan": lambda x: 2.0 / np.pi * np.arctan(x),
    # 2 / (1 + exp(-x)) - 1, without overflow
    "logistic": lambda x: np.tanh(0.5 * x),
}
"""Smooth laws over the velocity in units of the smoothing speed; from -1 to 1, odd."""

DEFAULT_SHAPE = "tanh"

Field = float | tuple[float, ...]  # one value for all coordinates of a term, or one per coordinate


def directions(
    axes: Axes, dq: Scalars, smoothing: Field, law: str, shape: str = DEFAULT_SHAPE
) -> list[Scalar]:
    """Direction of motion along every axis, -1 to 1: the sign, or $s(v/w)$ of `SHAPES`."""
    speeds = [axis.of(dq) for axis in axes]
    if is_zero(smoothing):
        return [np.sign(speed) for speed in speeds]
    widths = per_axis(smoothing, axes, law)
    return [SHAPES[shape](v / w) for v, w in zip(speeds, widths, strict=True)]


def is_zero(value: Any) -> bool:
    """Whether a field is the number zero, which switches it off."""
    return isinstance(value, float | int) and value == 0.0


def refuse_shape(law: str, shape: str, smoothing: Field) -> None:
    """The name of a smooth law goes with a speed within which it turns."""
    refuse_unknown(law, "shape", shape, tuple(SHAPES))
    if is_zero(smoothing) and shape != DEFAULT_SHAPE:
        raise unfit(
            f"term '{law}' has shape = {shape!r}, but its direction is the plain sign",
            "give `smoothing`, the speed within which it turns, or leave out `shape`",
        )


def refuse_negative(law: str, **fields: Any) -> None:
    """Fields that are speeds or lengths are finite numbers, not negative; or still to be found."""
    for name, value in fields.items():
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, Find):
                continue
            if not isinstance(number, float | int) or not 0.0 <= number < float("inf"):
                raise unfit(
                    f"term '{law}' has {name} = {number!r}",
                    f"give '{name}' as a positive number, one for all or a list with one per "
                    "coordinate",
                )


def refuse_not_positive(law: str, **fields: Any) -> None:
    """Fields that a law divides by are finite numbers above zero; or still to be found."""
    refuse_negative(law, **fields)
    for name, value in fields.items():
        if 0.0 in (value if isinstance(value, tuple) else (value,)):
            raise unfit(
                f"term '{law}' has {name} = {value!r}",
                f"give '{name}' above zero; to leave the effect out, leave out the term",
            )


def refuse_unknown(law: str, name: str, value: Any, known: Sequence[Any]) -> None:
    """A field with a choice has one of its values."""
    if value not in known:
        raise unfit(
            f"term '{law}' has {name} = {value!r}",
            f"give '{name}' one of {', '.join(repr(x) for x in known)}",
        )


FIND = "find"  # the word in robot files: `speed = "find"` or `speed = {find = [0.001, 1.0]}`


@dataclass(frozen=True)
class Find:
    """Stands in a field until found between two bounds; if `shared`, one for all axes."""

    lower: float
    upper: float
    shared: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.lower < self.upper < float("inf"):
            raise unfit(
                f"a nonlinear parameter is to be estimated between {self.lower} and {self.upper}",
                "give two numbers above zero, the smaller one first: {find = [0.001, 1.0]}",
            )

    @property
    def description(self) -> dict[str, Any]:
        """The table of a robot file."""
        return {FIND: [self.lower, self.upper], "per_joint": not self.shared}


def is_search(given: Any) -> bool:
    """Whether a value of a file, or a part of it, requests a search."""
    if isinstance(given, list | tuple):
        return any(is_search(x) for x in given)
    if isinstance(given, Mapping):
        return FIND in given and not isinstance(given[FIND], Mapping)
    return bool(given == FIND)


def search_of(law: type[Any], field: str, given: Any, where: str) -> Find:
    """The search that `"find"`, or a table with bounds and `per_joint`, requests for a field."""
    default = searchable(law, field, where)
    table = {FIND: True} if given == FIND else given
    strange = not isinstance(table, Mapping) or not set(table) <= {FIND, "per_joint"}
    bounds = None if strange else table[FIND]
    bounds = default if bounds is True else bounds
    per_joint = False if strange else table.get("per_joint", False)
    if (
        not isinstance(bounds, list | tuple)
        or len(bounds) != 2
        or not all(isinstance(x, float | int) and not isinstance(x, bool) for x in bounds)
        or not isinstance(per_joint, bool)
    ):
        raise ModelError(
            f"term '{law.law}' has {field} = {given!r}",
            where=where,
            fix=f'write {field} = "find", or '
            f"{field} = {{find = [{default[0]:g}, {default[1]:g}], per_joint = true}}; "
            "for numbers on some joints only, give each its own term (see `joints`)",
        )
    return Find(float(bounds[0]), float(bounds[1]), not per_joint)


def searchable(law: type[Any], field: str, where: str) -> tuple[float, float]:
    """The law's own bounds of a field; `ModelError` if it cannot be found."""
    bounds: Mapping[str, tuple[float, float]] = law.bounds
    if field not in bounds:
        others = " and ".join(f"'{name}'" for name in bounds) or "none of its keys"
        raise ModelError(
            f"the key '{field}' of term '{law.law}' cannot be estimated from data",
            where=where,
            fix=f"give '{field}' a value; {others} can be estimated",
        )
    return bounds[field]


def finds_of(term: Any) -> dict[str, Find]:
    """The fields of a term that are to be found, by name."""
    given = {f.name: getattr(term, f.name) for f in fields(term)}
    found = {name: value for name, value in given.items() if isinstance(value, Find)}
    for name in found:
        searchable(type(term), name, "list of terms")
    return found
