r"""Coordinates that a term can act along: joints, motors, or any $c \cdot q$.

Along the row $c$ the velocity is $c \cdot \dot q$, and an effort $f$ loads the joints with
$c^T f$: the motor behind a differential that turns with $q_5 + q_6$ brakes both joints.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from typing import Any

from steelyard.errors import ModelError
from steelyard.kernel.equations.dynamics import Scalar
from steelyard.parameters import Parameter
from steelyard.robot.robot import JointKind, Robot
from steelyard.terms.open_fields import Find

Along = tuple[tuple[str, tuple[tuple[str, float], ...]], ...]
"""Named coordinates, each the joints it is made of with their coefficients."""


COEFFICIENTS = (1e-6, 1e6)
"""Sizes that coefficients of a joint in a coordinate may have, if they are not zero."""


@dataclass(frozen=True)
class Axis:
    """A coordinate along which a term acts.

    Attributes:
        name: Name, for the parameters.
        row: Coefficients `c`, one per joint of `robot.joints`.
        kind: Its kind, which gives the units.
    """

    name: str
    row: tuple[float, ...]
    kind: JointKind

    def of(self, values: Sequence[Scalar]) -> Scalar:
        """`c` times the joints' positions, velocities or accelerations."""
        total: Scalar = None
        for coefficient, value in zip(self.row, values, strict=True):
            if coefficient:
                part = value if coefficient == 1.0 else coefficient * value
                total = part if total is None else total + part
        return total

    @property
    def effort_unit(self) -> str:
        """Unit of effort."""
        return "N" if self.kind == "prismatic" else "Nm"

    @property
    def speed_unit(self) -> str:
        """Unit of velocity."""
        return "m/s" if self.kind == "prismatic" else "rad/s"

    @property
    def rate_unit(self) -> str:
        """Unit of effort per velocity."""
        return "N s/m" if self.kind == "prismatic" else "N m s/rad"

    @property
    def inertia_unit(self) -> str:
        """Unit of effort per acceleration."""
        return "kg" if self.kind == "prismatic" else "kg m²"

    @property
    def stiffness_unit(self) -> str:
        """Unit of effort per position."""
        return "N/m" if self.kind == "prismatic" else "N m/rad"

    def effort_per(self, unit: str) -> str:
        """Unit of effort per something of another unit."""
        return f"{'N' if self.kind == 'prismatic' else 'N m'}/{unit}"


def coordinates(
    robot: Robot, joints: Any = None, motors: Any = None, along: Any = None
) -> tuple[Axis, ...]:
    """Coordinates by the names of joints and motors, and as sums; all joints if nothing is named.

    Raises:
        ModelError: The robot has no joint or motor of a name, or a coordinate is none.
    """
    if joints is None and motors is None and along is None:
        return tuple(_joint(robot, c.name) for c in robot.coordinates)
    named = [_joint(robot, name) for name in _listed(joints, "joints")]
    named += [_motor(robot, name) for name in _listed(motors, "motors")]
    named += [_combined(robot, name, parts) for name, parts in _sums(along)]
    return tuple(named)


def each(
    axes: Sequence[Axis], law: str, unit: Callable[[Axis], str], lower: float = float("-inf")
) -> tuple[Parameter, ...]:
    """One parameter named `law.axis` for every axis."""
    return tuple(Parameter(f"{law}.{axis.name}", unit(axis), lower=lower) for axis in axes)


def spread(
    axes: Sequence[Axis], value: Callable[[int, Axis], Scalar], first: int = 0
) -> dict[tuple[int, int], Scalar]:
    """Columns of one parameter per axis: an effort of `value` along it, per unit.

    Args:
        axes: The coordinates.
        value: Effort along the axis of a number.
        first: Number of the first parameter.
    """
    columns: dict[tuple[int, int], Scalar] = {}
    for k, axis in enumerate(axes):
        effort = value(k, axis)
        for joint, coefficient in enumerate(axis.row):
            if coefficient:
                columns[joint, first + k] = effort if coefficient == 1.0 else coefficient * effort
    return columns


def per_axis(values: float | tuple[float, ...], axes: Sequence[Axis], law: str) -> list[float]:
    """One value of a field for every axis, from one for all or a list.

    Raises:
        ModelError: Their number does not fit, one is not above zero, or they are not known yet.
    """
    if isinstance(values, Find):
        raise ModelError(
            f"a nonlinear parameter of term '{law}' is not estimated yet",
            where="list of terms",
            fix="estimate it from logs first, with `steelyard identify` or `find_fields`, or give "
            "a number",
        )
    given = values if isinstance(values, tuple) else (values,) * len(axes)
    if len(given) != len(axes) or not all(value > 0.0 for value in given):
        raise ModelError(
            f"term '{law}' has {values} for {len(axes)} coordinates",
            where="list of terms",
            fix="give one value above zero for all, or a list with one per coordinate",
        )
    return list(given)


def named_axis(robot: Robot, name: str) -> Axis:
    """The coordinate of a joint or, where no joint has the name, of a motor.

    Raises:
        ModelError: The robot has neither.
    """
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
        raise ModelError(
            f"a term acts on {what} = {names!r}",
            where="list of terms",
            fix=f'list names: {what} = ["...", "..."], or leave `{what}` out',
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
        raise ModelError(
            f"a term acts along {along!r}",
            where="list of terms",
            fix="give every coordinate the joints it is made of: "
            "along = {wrist = {joint_5 = 1.0, joint_6 = 1.0}}",
        )
    return sums


def _joint(robot: Robot, name: str) -> Axis:
    names = [c.name for c in robot.joints]
    if name not in names:
        raise ModelError(
            f"a term acts on joint '{name}', which is not identified",
            where=f"robot '{robot.name}', list of terms",
            fix=f"use names of {', '.join(names)}",
        )
    k = names.index(name)
    return Axis(name, tuple(float(j == k) for j in range(len(names))), robot.joints[k].kind)


def _motor(robot: Robot, name: str) -> Axis:
    gears = robot.transmission
    if gears is None or name not in gears.motors:
        raise ModelError(
            f"a term acts on motor '{name}', which the robot does not have",
            where=f"robot '{robot.name}', list of terms",
            fix="give the robot a [robot.transmission]"
            if gears is None
            else f"use names of {', '.join(gears.motors)}",
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
        raise ModelError(
            wrong,
            where=f"robot '{robot.name}', list of terms",
            fix=f"combine joints of one kind, with coefficients of sizes from {least:g} to "
            f"{most:g}: {{wrist = {{joint_5 = 1.0, joint_6 = 1.0}}}}",
        )
    return Axis(name, tuple(total), kinds.pop())
