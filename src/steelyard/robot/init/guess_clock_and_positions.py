"""A guess of the column and unit of time, and of the unit and gear side of positions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.robot.file.sections import Side
from steelyard.robot.file.signals import POSITION_UNITS, TIME_UNITS
from steelyard.robot.init.column_names import IN_FILE, Column, finite, give_up, listed
from steelyard.robot.init.guess_efforts_and_gears import (
    LEAST_MOTOR_BEYOND_LIMIT,
    LEAST_POSITION_BEYOND_LIMIT,
    beyond_limits,
    reach,
    whole_numbers,
)
from steelyard.robot.init.guess_velocities import MotionGuess, _stated
from steelyard.robot.robot import Coordinate


def guess_time(columns: Sequence[str], sample: Mapping[str, ArrayLike]) -> tuple[str, str] | None:
    """The column of time and its unit; `None` if no column looks like time."""
    values = {name: finite(values) for name, values in sample.items()}
    candidates = [c for c in map(Column, columns) if c.quantity == "time"]
    try:
        time = _time(candidates, columns, values)
    except LogError:
        return None
    return time.name, _time_unit(time, values)[0]


def clock_of(
    candidates: Sequence[Column],
    position: Column,
    columns: Sequence[str],
    values: Mapping[str, Array],
    rate: float | None,
) -> tuple[dict[str, Any], str]:
    """What the robot file says of time, and why; of messages, times of the positions' topic."""
    topic = position.name.rpartition("/position/")[0]
    candidates = [c for c in candidates if topic and c.topic == topic] or candidates
    if rate is not None:
        instead = f", not {listed(candidates)}" if candidates else ""
        why = f"time is the number of the row at the {rate:g} Hz that were given{instead}"
        return {"rate": rate}, why
    time = _time(candidates, columns, values)
    unit, reason = _time_unit(time, values)
    return {"time": time.name, "time_unit": unit}, f"time is '{time.name}' in {unit}, {reason}"


def _time(
    candidates: Sequence[Column], columns: Sequence[str], values: Mapping[str, Array]
) -> Column:
    steps = [np.diff(values.get(column.name, np.zeros(0))) for column in candidates]
    rises = [len(x) == 0 or np.mean(x >= 0.0) > 0.9 for x in steps]
    rising = [c for c, good in zip(candidates, rises, strict=True) if good]
    rising = [c for c in rising if len(values.get(c.name, ()))] or rising
    if not rising:
        give_up(
            "no column looks like time",
            columns,
            "give the log's rate: `steelyard init URDF LOG --rate HZ` writes a robot file with "
            f'[signals] rate = HZ instead of time = "..."; or {IN_FILE}',
        )
    return min(rising, key=lambda c: (c.topic != rising[0].topic, len(c.words)))


def _time_unit(time: Column, values: Mapping[str, Array]) -> tuple[str, str]:
    if unit := time.unit_named(TIME_UNITS):
        return unit, "by its name"
    steps = np.diff(values.get(time.name, np.zeros(0)))
    step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    if step == 0.0:
        return "s", "by default"
    unit = "s" if step < 0.5 else "ms" if step < 500.0 else "us" if step < 5e5 else "ns"
    return unit, f"as its steps are {step:.4g}"


def guess_positions(
    columns: Sequence[Column],
    joints: Sequence[Coordinate],
    values: Mapping[str, Array],
    every: Sequence[str],
    geared: bool = False,
    side: Side | None = None,
) -> MotionGuess:
    """Unit and side of position columns, by their names and by the joints' limits.

    Positions far beyond the limits in rad, but within them in deg, are in deg whatever their names
    say, unless they are known to be behind gears: ratios are given, or efforts are of motors by
    their names. If all signals are stated to be of joints (`side`), none are of motors. Counts have
    no unit, which is a `LogError` that lists `every` column of the log.
    """
    if side != "joint" and all(column.of_motor for column in columns):
        unit, reason = _motor_unit(columns)
        why = f"of motors, not of joints, by their names; {reason}"
        return MotionGuess(unit, why, motors=True)
    units, reason = _position_units(columns, joints, values)
    usual = [joint.unit for joint in joints]
    beyond = beyond_limits(columns, joints, units, values)
    limited = sum(x > 0.0 for x in beyond)
    if limited and 2 * sum(x > LEAST_MOTOR_BEYOND_LIMIT for x in beyond) > limited:
        if whole_numbers(columns, values):
            give_up(
                f"positions are whole numbers far beyond the joints' limits, such as counts of "
                f"encoders, which have no unit: {listed(columns)}",
                every,
                "convert them to rad or m in the log: counts per turn (data sheet) and, if they "
                f"are the motors', gear ratios; then {IN_FILE}",
            )
        degrees = ["deg" if unit == "rad" else unit for unit in units]
        within = max(beyond_limits(columns, joints, degrees, values)) <= LEAST_POSITION_BEYOND_LIMIT
        times = f"up to {max(beyond):.3g} times the joints' limits"
        if (side == "joint" or not geared) and degrees != units and within:
            why = f"in deg though their names say rad, in which they would be {times}"
            return MotionGuess(_stated(degrees, usual), f"{why} (if they are of motors: --ratios)")
        if side != "joint":
            unit, unit_reason = _motor_unit(columns)
            why = f"{times}: of motors, not of joints; {unit_reason}"
            return MotionGuess(unit, why, motors=True)
    far = [(x, f"{j.name} ({c.name})") for c, j, x in zip(columns, joints, beyond, strict=True)]
    far = [(x, name) for x, name in far if x > LEAST_POSITION_BEYOND_LIMIT]
    if not far:
        return MotionGuess(_stated(units, usual), reason)
    more = f" (and {len(far) - 1} more joints)" * (len(far) > 1)
    contradiction = (
        f"positions go beyond the limits of the model, up to {max(far)[0]:.2g} times for "
        f"{max(far)[1]}{more}: unit, columns or joint order are wrong, or the limits"
    )
    return MotionGuess(_stated(units, usual), reason, (contradiction,))


def _motor_unit(columns: Sequence[Column]) -> tuple[str | None, str]:
    """The unit of motor positions: ranges do not determine it."""
    named = {column.unit_named(("rad", "deg")) for column in columns}
    unit = named.pop() if len(named) == 1 else ""
    return (unit, f"in {unit} by their names") if unit else ("rad", "in rad, by default")


def _position_units(
    columns: Sequence[Column], joints: Sequence[Coordinate], values: Mapping[str, Array]
) -> tuple[list[str], str]:
    units, why = [], "in rad or m, by default"
    for column, joint in zip(columns, joints, strict=True):
        most = reach(column.name, values)
        si, other = POSITION_UNITS[joint.kind]
        if named := column.unit_named((si, other)):
            units.append(named)
            why = "units by their names"
        else:
            limit = max(abs(joint.limits.lower), abs(joint.limits.upper))
            far = 4.0 * np.pi if joint.kind == "revolute" else 10.0 * min(limit, 1.0)
            units.append(other if most > far else si)
            if most > 0.0:
                why = f"in {units[-1]} by their range (up to {most:.3g})"
    return units, why
