r"""A guess of the column and unit of time, of positions and of velocities, and how good these are.

If velocities $v$ have a scale $1/a$ and come late by $\delta$, positions are
$q = c_0 + c_1 t + a \int v + a \delta v$, a linear fit that needs no derivative. They are used if
they agree in every joint, are not late, and have less noise than differences of positions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.robot.file.sections import Side
from steelyard.robot.file.signals import POSITION_UNITS, TIME_UNITS, VELOCITY_UNITS
from steelyard.robot.init import guess_efforts_and_gears as efforts
from steelyard.robot.init.column_names import IN_FILE, Column, finite, give_up, listed
from steelyard.robot.robot import Coordinate

LEAST_ROWS, LEAST_SECONDS, LEAST_RANGE = 200, 0.5, 0.05
"""Rows and length of a sample [s], and range of a joint [rad; m], from which on velocities can be
judged."""
SCALE, OF_JOINT, STEPS, SECONDS, NOISE = 0.02, 0.1, 1.0, 0.01, 0.5
"""Most that the median scale and that of any joint differ from 1, most steps of the clock and
seconds that velocities are late, and most noise over that of differences of positions: with as
much noise they are worth nothing."""
ABSURD = 1e6  # values that no sensor has
SMOOTHED = 0.1  # moving average before noises are compared [s]: about what later filters leave

RATES = {"rad": "rad/s", "deg": "deg/s", "m": "m/s", "mm": "mm/s"}
"""Units of velocities by those of positions."""


@dataclass(frozen=True)
class MotionGuess:
    """What columns of positions or velocities hold, why, and what contradicts it.

    The unit is one for all, one per joint, or `None` for rad and m (per second); also of velocities
    that are left out.
    """

    unit: Any
    reason: str
    contradictions: tuple[str, ...] = ()  # to the model's limits, or to a rate that is given
    motors: bool = False  # whether positions are the motors'
    used: tuple[Column, ...] = ()  # velocity columns, all or none


def _stated(units: Sequence[str], usual: Sequence[str]) -> Any:
    """Units as the robot file states them: one for all or one each; `None` for the usual ones."""
    return None if units == usual else units[0] if len(set(units)) == 1 else units


@dataclass(frozen=True)
class Comparison:
    """Velocities of a log against its positions, medians over the joints that move."""

    scale: float  # of the positions over the integrated velocities
    late: float  # how late velocities come [s]
    step: float  # of the clock [s]
    noise: float  # of the velocities over that of differences of positions
    farthest: float  # the scale that differs most from 1, of any joint that moves

    @property
    def delay(self) -> str:
        """How late or early they are, in words."""
        return f"{_figures(abs(1e3 * self.late))} ms {'late' if self.late >= 0.0 else 'early'}"

    @property
    def scaled(self) -> bool:
        """Whether they are not the derivative, but a multiple of it."""
        return abs(self.scale - 1.0) > SCALE

    @property
    def faults(self) -> tuple[str, ...]:
        """Why they are not to be used, in words; empty if they are."""
        found = []
        if self.scaled:
            found.append(f"they are {_figures(1.0 / self.scale, 3)} times the derivative")
        elif abs(self.farthest - 1.0) > OF_JOINT:
            found.append("one joint's are not the derivative of its position")
        if abs(self.late) > min(STEPS * self.step, SECONDS):
            found.append(f"they are {self.delay}")
        times = f"{_figures(self.noise)} times"
        if self.noise >= 1.0:
            found.append(f"they are noisier than differentiated positions ({times})")
        elif self.noise > NOISE:
            found.append(
                f"they are hardly less noisy than differentiated positions (noise {times} as "
                f"large, at most {NOISE:g} allowed)"
            )
        return tuple(found)


def judged(
    velocity: Sequence[Column],
    position: Sequence[Column],
    joints: Sequence[Coordinate],
    unit: Any,
    clock: Mapping[str, Any],
    sample: Mapping[str, ArrayLike],
) -> MotionGuess:
    """Velocity columns that are used, all or none, their unit, and why.

    Columns are listed joint by joint; `unit` is that of the positions: one, one per joint, or
    `None` for rad and m; `sample` has values from the first row on.
    """
    names = [c.name for c in (*position, *velocity)]
    shown = listed(velocity)
    if not velocity or not sample.keys() >= {*names, *([clock["time"]] if "time" in clock else [])}:
        return MotionGuess(None, f"velocities ({shown}) are left out, as they are often late")
    values = [np.asarray(sample[name], dtype=np.float64) for name in names]
    rows = np.arange(len(values[0]), dtype=np.float64)
    t = rows / clock["rate"] if "rate" in clock else np.asarray(sample[clock["time"]], np.float64)
    t = t * TIME_UNITS[str(clock.get("time_unit", "s"))]
    given = [unit] * len(position) if unit is None or isinstance(unit, str) else unit
    units = [str(one or joint.unit) for one, joint in zip(given, joints, strict=True)]
    sizes = POSITION_UNITS["revolute"] | POSITION_UNITS["prismatic"]
    q = [sizes[one] * x for one, x in zip(units, values, strict=False)]
    own = [RATES[one] for one in units]
    found, rates = _in_unit(t, q, values[len(q) :], own, joints)
    unit_words = f"in {' and '.join(dict.fromkeys(rates))}" if rates != own else ""
    if found is None:
        why = f"left out, as the first {len(rows)} rows do not show whether they are good"
    elif found.faults:
        why = f"left out, as {' and '.join(found.faults)}"
        why += f"; they are {unit_words}" if unit_words else ""
    else:
        why = (
            f"used{f', {unit_words}' if unit_words else ''}: they are the derivative of the "
            f"positions, {found.delay}, with {found.noise:.2g} times the noise of differences of "
            "positions"
        )
    used = tuple(velocity) if found is not None and not found.faults else ()
    one = _stated(rates, [RATES[joint.unit] for joint in joints])
    against = () if found is None or "rate" not in clock else _other_rate(found, clock["rate"])
    return MotionGuess(one, f"velocities ({shown}) are {why}", against, used=used)


def _other_rate(found: Comparison, rate: float) -> tuple[str, ...]:
    """That velocities show another rate than the given one, if they do, in one sentence."""
    uneven = abs(found.farthest / found.scale - 1.0) > OF_JOINT
    if uneven or found.scale < 0.0 or abs(found.scale - 1.0) < OF_JOINT:
        return ()
    return (
        f"at the {rate:g} Hz that were given, velocities are {_figures(1.0 / found.scale, 3)} "
        f"times the derivative of the positions: the rate is {_figures(rate / found.scale, 3)} Hz",
    )


def _in_unit(
    t: Array,
    q: Sequence[Array],
    logged: Sequence[Array],
    own: Sequence[str],
    joints: Sequence[Coordinate],
) -> tuple[Comparison | None, list[str]]:
    """Velocities in the positions' unit per second, or in the one in which they are the derivative.

    Time `(N,)` [s], positions [rad; m] and velocities as logged joint by joint, each `(N,)`; `own`
    are the units of the positions per second.
    """

    def read(units: Sequence[str]) -> Comparison | None:
        scales = [VELOCITY_UNITS[j.kind][unit] for unit, j in zip(units, joints, strict=True)]
        return compared(t, q, [scale * v for scale, v in zip(scales, logged, strict=True)])

    first = read(own)
    if first is None or not first.scaled:
        return first, list(own)
    for other in VELOCITY_UNITS["revolute"]:
        units = [other if j.kind == "revolute" else u for u, j in zip(own, joints, strict=True)]
        found = read(units)
        if found is not None and not found.scaled:
            return found, units
    return first, list(own)


def compared(t: Array, q: Sequence[Array], v: Sequence[Array]) -> Comparison | None:
    """Compare velocities with positions; `None` where too little moves.

    Time `(N,)` [s]; positions and, in the same units per second, velocities, each `(N,)`.
    """
    rows = np.array([*q, *v])
    with np.errstate(invalid="ignore"):
        fine = np.isfinite(t) & (np.abs(rows) < ABSURD).all(axis=0)
    t = t[fine]
    if len(t) < LEAST_ROWS or not (np.diff(t) >= 0.0).all():
        return None
    step = float(np.median(np.diff(t)))
    if step <= 0.0 or not LEAST_SECONDS <= t[-1] - t[0] <= 2.0 * step * len(t):
        return None
    even, width, found = np.arange(t[0], t[-1], step), max(1, round(SMOOTHED / step)), []
    for position, velocity in zip(q, v, strict=True):
        if np.ptp(position[fine]) >= LEAST_RANGE:
            x, y = (np.interp(even, t, values[fine]) for values in (position, velocity))
            way = np.concatenate(([0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * step)))
            columns = np.column_stack((np.ones_like(x), even - even[0], way, y))
            _, _, scale, late = np.linalg.lstsq(columns, x, rcond=None)[0].tolist()
            noise = _noise(y, width) / _noise(np.gradient(x, step), width)
            found.append((scale or 1e-300, late / (scale or 1e-300), noise))
    if not found:
        return None
    scale, late, noise = (float(x) for x in np.median(found, axis=0))
    farthest = max((one[0] for one in found), key=lambda scale: abs(scale - 1.0))
    return Comparison(scale, late, step, noise, farthest)


def _noise(x: Array, width: int) -> float:
    smooth = np.convolve(x, np.full(width, 1.0 / width), "valid")
    return max(float(np.sqrt(np.mean(np.square(np.diff(smooth, 2))))), 1e-300)


def _figures(value: float, digits: int = 2) -> str:
    """A number to so many figures, never in the form `2e+02`."""
    return np.format_float_positional(value, digits, unique=True, fractional=False, trim="-")


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
    beyond = efforts.beyond_limits(columns, joints, units, values)
    limited = sum(x > 0.0 for x in beyond)
    if limited and 2 * sum(x > efforts.LEAST_MOTOR_BEYOND_LIMIT for x in beyond) > limited:
        if efforts.whole_numbers(columns, values):
            give_up(
                f"positions are whole numbers far beyond the joints' limits, such as counts of "
                f"encoders, which have no unit: {listed(columns)}",
                every,
                "state position_unit, rad (m) per count: 2 pi over the counts per turn (data "
                f"sheet), and if they are the motors', the gear ratios; {IN_FILE}",
            )
        degrees = ["deg" if unit == "rad" else unit for unit in units]
        within = (
            max(efforts.beyond_limits(columns, joints, degrees, values))
            <= efforts.LEAST_POSITION_BEYOND_LIMIT
        )
        times = f"up to {max(beyond):.3g} times the joints' limits"
        if (side == "joint" or not geared) and degrees != units and within:
            why = f"in deg though their names say rad, in which they would be {times}"
            return MotionGuess(_stated(degrees, usual), f"{why} (if they are of motors: --ratios)")
        if side != "joint":
            unit, unit_reason = _motor_unit(columns)
            why = f"{times}: of motors, not of joints; {unit_reason}"
            return MotionGuess(unit, why, motors=True)
    far = [(x, f"{j.name} ({c.name})") for c, j, x in zip(columns, joints, beyond, strict=True)]
    far = [(x, name) for x, name in far if x > efforts.LEAST_POSITION_BEYOND_LIMIT]
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
        most = efforts.reach(column.name, values)
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
