"""What effort columns hold: units, gains and gear side; the transmission that a file declares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.robot.robot import Coordinate, Transmission

if TYPE_CHECKING:
    from steelyard.robot.file.sections import EffortSection, SignalsSection, TransmissionSection

Locate = Callable[..., str]  # key path in the robot file to the words of a message's `where`

WORST = 1e8  # condition number, rows scaled, from which on a matrix counts as singular


def build_transmission(
    section: TransmissionSection, joints: Sequence[str], locate: Locate
) -> Transmission:
    """The gears between motors and the identified joints, as the robot file declares them."""
    motors = section.motors or tuple(f"motor_{k + 1}" for k in range(len(joints)))
    if len(motors) != len(joints):
        raise ModelError(
            f"{len(motors)} motors are named for {len(joints)} joints",
            where=locate("robot", "transmission", "motors"),
            fix=f"name one motor per joint: {', '.join(joints)}",
        )
    for motor in motors:
        twice = motors.count(motor) > 1
        if twice or motor in joints:
            other = "another one, so that terms can say which of the two they mean"
            raise ModelError(
                f"two motors are called '{motor}'"
                if twice
                else f"motor '{motor}' has the name of a joint",
                where=locate("robot", "transmission", "motors"),
                fix="give every motor a name of its own" if twice else f"give it {other}",
            )
    matrix = _matrix(section, motors, joints, locate)
    lengths = np.linalg.norm(matrix, axis=1)
    scaled = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    if not lengths.all() or np.linalg.cond(scaled) > WORST:
        raise ModelError(
            "the transmission cannot be inverted: " + _why(scaled, motors),
            where=locate("robot", "transmission"),
            fix="every motor must turn some joint, and no combination of joints may leave all "
            "motors at rest: check ratios, coupling and matrix",
        )
    return Transmission(motors, matrix)


def _matrix(
    section: TransmissionSection, motors: Sequence[str], joints: Sequence[str], locate: Locate
) -> Array:
    if (section.ratios is None) == (section.matrix is None):
        raise ModelError(
            "a transmission has ratios or a matrix, one of them",
            where=locate("robot", "transmission"),
            fix="give ratios = [...] (and coupling = [...]), or matrix = [[...], ...]",
        )
    n = len(joints)
    if section.matrix is not None:
        if len(section.matrix) != n or any(len(row) != n for row in section.matrix):
            raise ModelError(
                f"the transmission matrix is not {n} x {n}",
                where=locate("robot", "transmission", "matrix"),
                fix="give one row per motor with one ratio per identified joint",
            )
        matrix = np.array(section.matrix, dtype=np.float64)
    else:
        ratios = section.ratios or ()
        if len(ratios) != n:
            raise ModelError(
                f"{len(ratios)} ratios are given for {n} joints",
                where=locate("robot", "transmission", "ratios"),
                fix="give one ratio per identified joint, in the joints' order",
            )
        matrix = np.diag(np.array(ratios, dtype=np.float64))
    for index, coupling in enumerate(section.coupling):
        where = locate("robot", "transmission", "coupling", index)
        for name, names, kind in (
            (coupling.motor, motors, "motors"),
            (coupling.joint, joints, "joints"),
        ):
            refuse_unknown(name, names, f"'{name}' is none of the robot's {kind}", where, kind)
        matrix[motors.index(coupling.motor), joints.index(coupling.joint)] += coupling.ratio
    return matrix


def _why(scaled: Array, motors: Sequence[str]) -> str:
    idle = [m for m, row in zip(motors, scaled, strict=True) if not row.any()]
    if idle:
        return f"'{idle[0]}' turns no joint"
    weights = np.abs(np.linalg.svd(scaled.T)[2][-1])
    together = [m for m, w in zip(motors, weights, strict=True) if w > 1e-6]
    return f"{', '.join(together)} turn with the same combinations of joints"


MOTOR_KINDS = ("motor_current", "motor_torque")
EFFORT_UNITS = {
    "A": ("A", 1.0),
    "mA": ("A", 1e-3),
    "Nm": ("Nm", 1.0),
    "N": ("N", 1.0),
    "%": ("%", 1.0),
}
WITHOUT_TORQUE = {"A": "motor current", "%": "percent of an unknown effort"}
"""Base units that are no torque or force, and what columns in them hold."""


def check_sides(section: SignalsSection, gears: Transmission | None, locate: Locate) -> None:
    """Signals of the motors' side need a transmission."""
    for side, keys in (
        (section.coordinates, ("signals", "coordinates")),
        (section.effort.side, ("signals", "effort", "side")),
    ):
        if side == "motor" and gears is None:
            raise ModelError(
                "signals are those of the motors, but the robot has no transmission",
                where=locate(*keys),
                fix="give [robot.transmission] ratios = [...], or a matrix (in a file of "
                "`steelyard init`: fill in ratios, and remove the # before it and before "
                "[robot.transmission])",
            )
    if section.effort.side == "motor" and section.effort.kind not in MOTOR_KINDS:
        raise ModelError(
            f"an effort of kind '{section.effort.kind}' is not one of the motors",
            where=locate("signals", "effort", "side"),
            fix='use kind = "motor_torque" or "motor_current" with side = "motor"',
        )


def coupled_map(
    gears: Transmission, gains: Array, unknown: Sequence[bool], locate: Locate
) -> Array:
    r"""Joint efforts of motors' behind coupled gears, $\tau = R^T \operatorname{diag}(k)\,y$."""
    if any(unknown):
        raise ModelError(
            "gains behind coupled gears cannot be identified",
            where=locate("signals", "effort", "gain"),
            fix="give each motor's gain (its torque constant), or log joint torques",
        )
    return frozen(gears.matrix.T * gains)


def effort_units_of(
    effort: EffortSection, coordinates: Sequence[Coordinate], locate: Locate
) -> tuple[tuple[str, ...], Array]:
    """Base unit of each effort column, and base units per logged unit."""
    where = locate("signals", "effort", "unit")
    units = one_each(effort.unit, "units", coordinates, where)
    for unit, coordinate in zip(units, coordinates, strict=True):
        if effort.kind not in MOTOR_KINDS and unit != coordinate.effort_unit:
            raise ModelError(
                f"unit '{unit}' does not fit the joint torque of '{coordinate.name}', "
                f"which is {coordinate.kind}",
                where=where,
                fix=f"use '{coordinate.effort_unit}' there, or kind = \"motor_current\" with "
                "gains if the columns hold currents",
            )
        if effort.kind == "motor_torque" and unit in ("A", "mA"):
            raise ModelError(
                f"unit '{unit}' is a current's, but the effort's kind is motor_torque",
                where=where,
                fix='use kind = "motor_current", or unit = "Nm"',
            )
    if effort.kind == "motor_current" and not {"A", "mA", "%"} & set(units):
        raise ModelError(
            f"the effort's kind is motor_current, but no unit is a current's: {', '.join(units)}",
            where=where,
            fix='use unit = "A" or "mA" with gain in Nm per A, or kind = "motor_torque"',
        )
    return tuple(EFFORT_UNITS[u][0] for u in units), frozen([EFFORT_UNITS[u][1] for u in units])


def gains_of(
    effort: EffortSection,
    columns: Sequence[str],
    units: Sequence[str],
    coordinates: Sequence[Coordinate],
    locate: Locate,
) -> tuple[Array, tuple[bool, ...]]:
    """Joint effort per base unit, 1 where it is to be identified; and where it is."""
    where = locate("signals", "effort", "gain")
    n = len(coordinates)
    if effort.gain is None:
        for unit, column, coordinate in zip(units, columns, coordinates, strict=True):
            if unit in WITHOUT_TORQUE:
                raise ModelError(
                    f"column '{column}' holds {WITHOUT_TORQUE[unit]}, but joint "
                    f"'{coordinate.name}' has no drive gain",
                    where=where,
                    fix=f"give gain = [...] in {coordinate.effort_unit}/{unit} per joint, or "
                    'gain = "identify" with a known payload, in a robot file: steelyard init '
                    "MODEL LOG writes one with the ways to obtain gains",
                )
        return frozen(np.ones(n)), (False,) * n
    given = one_each(effort.gain, "gains", coordinates, where)
    unknown = tuple(gain == "identify" for gain in given)
    gains = frozen([1.0 if gain == "identify" else float(gain) for gain in given])
    if not np.all(gains):
        name = coordinates[int(np.argmin(np.abs(gains)))].name
        raise ModelError(
            f"the gain of joint '{name}' is zero",
            where=where,
            fix="give the torque at the joint per logged unit; its sign may be negative",
        )
    return gains, unknown


def one_each(
    given: Any, what: str, coordinates: Sequence[Coordinate], where: str
) -> tuple[Any, ...]:
    """A value per joint, from one for all or a list."""
    values = given if isinstance(given, tuple) else (given,) * len(coordinates)
    check_count(len(values), what, coordinates, where)
    return values


def check_count(got: int, what: str, coordinates: Sequence[Coordinate], where: str) -> None:
    """There is one of something per joint."""
    if got != len(coordinates):
        names = ", ".join(c.name for c in coordinates)
        raise ModelError(
            f"{got} {what} are given for {len(coordinates)} identified joints ({names})",
            where=where,
            fix="give one per joint, in the joints' order; [robot] joints = [...] says which "
            "joints are identified",
        )
