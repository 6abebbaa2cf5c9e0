"""A guess of the unit of positions, and of the side of the gears they are logged on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.robot.robot import Coordinate
from steelyard.robot_file.column_names import Column
from steelyard.robot_file.template.give_up import IN_FILE, give_up, listed
from steelyard.robot_file.template.guess_efforts import reach
from steelyard.robot_file.template.guess_motors import (
    BEYOND,
    MOTOR_BEYOND,
    beyond_limits,
    whole_numbers,
)
from steelyard.robot_file.template.guess_velocities import SMALL_UNITS


@dataclass(frozen=True)
class PositionGuess:
    """Unit and side of the position columns, why, and what contradicts the model's limits."""

    unit: Any
    reason: str
    motors: bool = False
    contradictions: tuple[str, ...] = ()


def guess_positions(
    columns: Sequence[Column],
    joints: Sequence[Coordinate],
    values: Mapping[str, Array],
    every: Sequence[str],
    geared: bool = False,
) -> PositionGuess:
    """Unit and side of position columns, by their names and by the joints' limits.

    Positions far beyond the limits in rad, but within them in deg, are in deg whatever their names
    say, unless they are known to be behind gears.

    Args:
        columns: The position columns.
        joints: Their joints.
        values: Finite values of columns.
        every: All columns of the log, for messages.
        geared: Whether gear ratios are given, or efforts are of motors by their names.

    Raises:
        LogError: They are counts, which have no unit.
    """
    if all(column.of_motor for column in columns):
        unit, reason = _motor_unit(columns)
        return PositionGuess(
            unit, f"of motors, not of joints, by their names; {reason}", motors=True
        )
    unit, reason = _position_unit(columns, joints, values)
    units = [unit] * len(columns) if unit is None or isinstance(unit, str) else unit
    scales = [SMALL_UNITS.get(str(one), 1.0) for one in units]
    beyond = beyond_limits(columns, joints, scales, values)
    limited = sum(x > 0.0 for x in beyond)
    if limited and 2 * sum(x > MOTOR_BEYOND for x in beyond) > limited:
        if whole_numbers(columns, values):
            give_up(
                f"positions are whole numbers far beyond the joints' limits, such as counts of "
                f"encoders, which have no unit: {listed(columns)}",
                every,
                "convert them to rad or m in the log: counts per turn (data sheet) and, if they "
                f"are the motors', gear ratios; then {IN_FILE}",
            )
        degrees = None if geared else _degrees(columns, joints, units, values)
        if degrees is not None:
            return PositionGuess(
                degrees,
                f"in deg though their names say rad, in which they would be up to "
                f"{max(beyond):.3g} times the joints' limits (if they are of motors: --ratios)",
            )
        unit, unit_reason = _motor_unit(columns)
        why = f"up to {max(beyond):.3g} times the joints' limits: of motors, not of joints"
        return PositionGuess(unit, f"{why}; {unit_reason}", motors=True)
    far = [(x, f"{j.name} ({c.name})") for c, j, x in zip(columns, joints, beyond, strict=True)]
    far = [(x, name) for x, name in far if x > BEYOND]
    if not far:
        return PositionGuess(unit, reason)
    more = f" (and {len(far) - 1} more joints)" * (len(far) > 1)
    contradiction = (
        f"positions go beyond the limits of the model, up to {max(far)[0]:.2g} times for "
        f"{max(far)[1]}{more}: unit, columns or joint order are wrong, or the limits"
    )
    return PositionGuess(unit, reason, contradictions=(contradiction,))


def _degrees(
    columns: Sequence[Column],
    joints: Sequence[Coordinate],
    units: Sequence[str | None],
    values: Mapping[str, Array],
) -> Any:
    """Units with deg for rad, if all positions are within the joints' limits then; else `None`."""
    own = [unit or joint.unit for unit, joint in zip(units, joints, strict=True)]
    other = ["deg" if unit == "rad" else unit for unit in own]
    scales = [SMALL_UNITS.get(unit, 1.0) for unit in other]
    if own == other or max(beyond_limits(columns, joints, scales, values)) > BEYOND:
        return None
    return other[0] if len(set(other)) == 1 else other


def _motor_unit(columns: Sequence[Column]) -> tuple[str | None, str]:
    """The unit of motor positions: ranges do not determine it."""
    degrees = all(column.has("deg", "degs", "degree", "degrees") for column in columns)
    named = degrees or all(column.has("rad", "rads") for column in columns)
    unit = "deg" if degrees else "rad"
    return unit, f"in {unit} by their names" if named else "in rad, by default"


def _position_unit(
    columns: Sequence[Column], joints: Sequence[Coordinate], values: Mapping[str, Array]
) -> tuple[Any, str]:
    units, why = [], "in rad or m, by default"
    for column, joint in zip(columns, joints, strict=True):
        most = reach(column.name, values)
        si, other = ("rad", "deg") if joint.kind == "revolute" else ("m", "mm")
        if column.has(si, other, "degree", "degrees"):
            units.append(si if column.has(si) else other)
            why = "units by their names"
        else:
            limit = max(abs(joint.limits.lower), abs(joint.limits.upper))
            far = 4.0 * np.pi if joint.kind == "revolute" else 10.0 * min(limit, 1.0)
            units.append(other if most > far else si)
            if most > 0.0:
                why = f"in {units[-1]} by their range (up to {most:.3g})"
    if set(units) <= {"rad", "m"}:
        return None, why
    return (units[0] if len(set(units)) == 1 else units), why
