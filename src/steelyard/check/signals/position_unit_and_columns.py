"""Are positions the joints' own, in the declared unit, and not in the columns of velocities?"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, log_check, remembered
from steelyard.check.finding import Edit, Finding, Fix, Picture, Severity, of_joints
from steelyard.check.signals.motion_units import (
    OUTSIDE_RANGE,
    SAME_SCALE,
    UnitReading,
    motion_in_units,
    unit_reading,
    unit_value,
)
from steelyard.check.signals.usable_rows import gaussian_slope, gaussian_smoothed
from steelyard.check.signals.velocity_scale_and_lag import AGREEING_CORRELATION
from steelyard.robot.file.signals import POSITION_UNITS
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_efforts_and_gears import beyond_range
from steelyard.runs.first_pass_over_recording import EXCERPT_ROWS

RATE_UNIT_WORDS = {"s", "rpm", "rads", "degs"}  # last words of the units of velocities


@dataclass(frozen=True)
class MisplacedVelocity:
    """A position column that holds velocities."""

    joint: int  # number of its joint
    column: str  # its name
    correlation: float  # with the derivative of `position`; 0 where only the name says so
    position: str  # the column that holds the positions; empty if none is known


@remembered
def misplaced_velocities(case: Case, log: CheckedLog) -> tuple[MisplacedVelocity, ...]:
    """Position columns that are derivatives of a column beside them, or are called velocities.

    Columns beside one are called alike but for words of positions, velocities and units.
    """
    signals, found = log.recording.signals, []
    motions = ("position", "velocity")
    columns = [c for c in map(Column, log.log.columns) if c.quantity in motions]
    for joint, column in enumerate(map(Column, signals.position)):
        beside = [c for c in columns if c.name != column.name and c.stem == column.stem]
        own, of_own = _misplaced_correlations(case, log, joint, [c.name for c in beside])
        best, called = int(np.argmax(own)) if beside else 0, column.quantity == "velocity"
        one_frequency = of_own >= AGREEING_CORRELATION
        if beside and own[best] >= AGREEING_CORRELATION and (called or not one_frequency[best]):
            correlation, position = float(own[best]), beside[best].name
            found.append(MisplacedVelocity(joint, column.name, correlation, position))
        elif called and not one_frequency.any():
            positions = [c.name for c in beside if c.quantity == "position"]
            free = [name for name in positions if name not in signals.columns]
            position = free[0] if len(free) == 1 else ""
            found.append(MisplacedVelocity(joint, column.name, 0.0, position))
    return tuple(found)


def _misplaced_correlations(
    case: Case, log: CheckedLog, joint: int, others: Sequence[str]
) -> tuple[Array, Array]:
    """Of a joint's positions with the others' derivatives, and size of the derivative's with them.

    In motion of one frequency positions are opposite to derivatives of their velocities, so the
    sign of the former counts. Zero where positions are of motors behind coupled gears, or nothing
    moves.
    """
    overview, start = log.overview, log.window[0]
    none = np.zeros(len(others)), np.zeros(len(others))
    if not others or log.recording.signals.position_map is not None:
        return none
    rows = (start, start + len(overview.kept))
    values = np.concatenate(list(log.log.parts(others, rows, EXCERPT_ROWS)))[overview.kept]
    values = np.where(np.isfinite(values), values, 0.0)
    mine = overview.q[:, joint : joint + 1]
    even, rate = overview.even(
        np.concatenate((mine, values), axis=1), unit_reading(case, log).second
    )
    x, v = (
        np.concatenate([np.zeros((values.shape[1] + 1, 0)), *(of(y, rate) for y in even)], axis=1)
        for of in (gaussian_smoothed, gaussian_slope)
    )
    if x.shape[1] < 2:
        return none
    with np.errstate(invalid="ignore"):  # of columns that never change
        own, of_own = np.corrcoef(x[0], v[1:])[0, 1:], np.corrcoef(v[0], x[1:])[0, 1:]
    return np.nan_to_num(own), np.abs(np.nan_to_num(of_own))


NAMED_UNITS = {unit for units in POSITION_UNITS.values() for unit in units}
MOTOR_RANGE = 3.0  # how far outside positions of motors are at least


@log_check("position", "Are positions in the declared unit?", of_rows=True)
def position_check(case: Case, log: CheckedLog) -> Finding:
    """Whether positions are positions, their unit and side of the gears, and their limits."""
    if wrong := misplaced_velocities(case, log):
        return _misplaced(case, log, wrong)
    low, high = np.quantile(log.overview.q, [0.005, 0.995], axis=0)
    ranges = list(zip(low.tolist(), high.tolist(), strict=True))
    each = np.array([[beyond_range(c, *x) for x in ranges] for c in case.loaded.robot.coordinates])
    off = np.diag(each)
    units = unit_reading(case, log)
    pairs = enumerate(zip(units.as_declared, units.joints, strict=True))
    other = [j for j, (a, b) in pairs if a.position_unit != b.position_unit]
    picture = _picture(case, low, high)
    if _of_motors(log, off, units):
        return replace(_motors(case, high - low, off), picture=picture)
    if other:
        return replace(_other_unit(case, log, units, other, each), picture=picture)
    names = tuple(case.joints[j] for j in np.flatnonzero(off > OUTSIDE_RANGE))
    are = "are outside their limits" if len(names) > 1 else "is outside its limits"
    facts = _facts(
        case, log, {joint.position_unit for joint in units.as_declared[log.channels.base :]}
    )
    return Finding.doubtful_if(
        bool(names),
        f"{', '.join(names)} {are}; {facts}" if names else f"{facts}, within the joints' limits",
        _value_text(case, off),
        Fix(
            "check position_offset under [signals], the zero of the joints, and their limits; "
            "or the model file is of another robot"
        ),
        joints=names,
        picture=picture,
    )


def _misplaced(case: Case, log: CheckedLog, wrong: Sequence[MisplacedVelocity]) -> Finding:
    signals, first = log.recording.signals, wrong[0]
    more = f" (and {len(wrong) - 1} more)" * (len(wrong) > 1)
    why = f"its values are the derivative of '{first.position}'"
    # by values, or by the unit in the name
    sure = all(
        one.correlation or {*Column(one.column).unit_words[-1:]} & RATE_UNIT_WORDS for one in wrong
    )
    edits: tuple[Edit, ...] = ()
    if all(one.position for one in wrong):
        instead = {one.column: one.position for one in wrong}
        position = [instead.get(name, name) for name in signals.position]
        edits = (Edit(("signals", "position"), position),)
        back = {position: column for column, position in instead.items()}
        if signals.velocity is not None and set(back) & set(signals.velocity):  # exchanged
            velocity = [back.get(name, name) for name in signals.velocity]
            edits = (*edits, Edit(("signals", "velocity"), velocity))
    return Finding.of(
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"position column '{first.column}'{more} holds velocities: "
        + (why if first.correlation else "by its name"),
        f"correlation of {first.correlation:.3g} with the derivative, velocities from "
        f"{AGREEING_CORRELATION:g} on"
        if first.correlation
        else "",
        joints=tuple(case.joints[one.joint] for one in wrong),
        fix=Fix("declare the columns that hold positions, or log them", edits),
    )


def _of_motors(log: CheckedLog, off: Array, units: UnitReading) -> bool:
    """Whether positions are motors', but not declared so: by their names, or as nothing fits."""
    signals = log.recording.signals
    if signals.position_map is not None:
        return False
    far = off > MOTOR_RANGE
    if all(Column(name).has("motor", "motors") for name in signals.position):
        declared = [joint.position_unit for joint in units.as_declared]
        return bool(far.any()) or declared != [joint.position_unit for joint in units.joints]
    corrected = np.array([j.position_scale for j in units.joints])
    return bool(far.all() and (off * np.minimum(corrected, 1.0) > MOTOR_RANGE).all())


def _motors(case: Case, reach: Array, off: Array) -> Finding:
    span = np.array([c.limits.upper - c.limits.lower for c in case.loaded.robot.coordinates])
    ranged = np.isfinite(span) & (span > 0.0)
    ratios = np.ceil(np.divide(reach, span, out=np.ones(len(span)), where=ranged))
    outside = bool((off > OUTSIDE_RANGE).any())
    far = f"up to {off.max():.0f} times farther than the joints can go"
    least = " ".join(f"{ratio:.0f}" for ratio in ratios)
    return Finding.wrong(
        "positions appear to be those of motors, not joints: they are "
        + (far if outside else "named so, and faster than joints"),
        _value_text(case, off),
        joints=tuple(case.joints[j] for j in np.flatnonzero(off > OUTSIDE_RANGE)),
        fix=Fix(
            'declare coordinates = "motor" under [signals], and the gears as ratios = [...] under '
            "[robot.transmission]"
            + (f"; for positions to be within limits they must be at least {least}" * outside)
        ),
    )


def _other_unit(
    case: Case, log: CheckedLog, units: UnitReading, other: list[int], each: Array
) -> Finding:
    off, within = np.diag(each), (each > 0.0) & (each <= OUTSIDE_RANGE)  # joints by columns
    exchanged = [j for j in other if not within[j, j] and (within[j] & within[:, j]).any()]
    clear = max(other, key=lambda j: units.as_declared[j].cost - units.joints[j].cost)
    unit = " and ".join(sorted({units.joints[j].position_unit for j in other}))
    of_joints = units.joints[log.channels.base :]
    value = unit_value([j.position_unit for j in of_joints], case, POSITION_UNITS)
    gears = case.loaded.robot.transmission
    geared = gears is not None and bool(np.all(np.abs(np.diag(gears.matrix)) == 1.0))
    sure = units.sure and not geared and not exchanged
    says = f"declare these positions in {unit}"
    if exchanged:
        says = f"compare the order of columns with the joints, or {says}"
    if geared:
        says = f"give the gear ratios, which are all 1, under [robot.transmission], or {says}"
    return Finding.of(
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"positions of {case.listed(other)} {'are' if sure else 'may be'} in {unit}: as declared, "
        f"{case.joints[clear]} would {_reasons(case, log, units, clear, off)}",
        _value_text(case, off),
        joints=tuple(case.joints[j] for j in other),
        fix=Fix(says, (Edit(("signals", "position_unit"), value),))
        if sure
        else Fix(says if geared else f"examine the log, and {says} if they are"),
    )


def _reasons(case: Case, log: CheckedLog, units: UnitReading, joint: int, off: Array) -> str:
    v, coordinate = motion_in_units(case, log).v[joint], case.loaded.robot.coordinates[joint]
    speed = np.quantile(np.abs(v), 0.995) if len(v) else 0.0
    found = []
    if off[joint] > OUTSIDE_RANGE:
        found.append(f"reach {off[joint]:.2g} times its limits")
    if speed > 0.0:
        unit, limit = f"{coordinate.unit}/s", coordinate.limits.velocity
        known = f" (limit {limit:.2g} {unit})" if np.isfinite(limit) else ""
        found.append(f"move at {speed:.2g} {unit}{known}")
    if units.agreement is not None and units.agreement.reliable_joints[joint]:
        scale = abs(float(units.agreement.scale[joint]))
        if abs(np.log(scale)) > np.log(SAME_SCALE):
            found.append(f"have logged velocities of {scale:.3g} times the derivative")
    return ", ".join(found) or "hardly move"


def _facts(case: Case, log: CheckedLog, declared: set[str]) -> str:
    signals, gears = log.recording.signals, case.loaded.robot.transmission
    named = [one if one in NAMED_UNITS else f"units of {float(one):.4g}" for one in declared]
    units = " and ".join(sorted(named))
    if wrapped := log.recording.wrapped:
        units += f" ({', '.join(wrapped)} wrap after a turn: unwrapped)"
    if signals.position_map is None or gears is None:
        return f"positions in {units}"
    ratios = " ".join(f"{r:g}" for r in np.diag(gears.matrix))
    coupled = ", coupled" if gears.coupled else ""
    return f"motor-side signals, ratios {ratios}{coupled}; positions in {units}"


def _value_text(case: Case, off: Array) -> str:
    far = int(np.argmax(off))
    if off[far] <= OUTSIDE_RANGE:
        return "every joint stays within its limits"
    return (
        f"{case.joints[far]} reaches {off[far]:.3g} times its limits, from the middle of its "
        f"range, at most {OUTSIDE_RANGE:g} times allowed"
    )


def _picture(case: Case, low: Array, high: Array) -> Picture:
    limits = np.array([(c.limits.lower, c.limits.upper) for c in case.loaded.robot.coordinates])
    lower, upper = np.where(np.isfinite(limits), limits, np.nan).T
    return of_joints(
        "position as declared [rad; m]",
        (
            ("lowest", low, "bars"),
            ("highest", high, "bars"),
            ("lower limit", lower, "points"),
            ("upper limit", upper, "points"),
        ),
    )
