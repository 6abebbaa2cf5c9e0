"""Are positions the joints' own, and in the declared unit?"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Edit, Finding, Fix, Picture, Severity
from steelyard.diagnosis.pictures import of_joints
from steelyard.diagnosis.signal_overview import look, with_rows
from steelyard.diagnosis.signals.agreement import ALIKE
from steelyard.diagnosis.signals.misplaced import Misplaced, misplaced
from steelyard.diagnosis.signals.unit_costs import SAME, beyond
from steelyard.diagnosis.signals.units import Reading, declared_units, motion, reading, unit_value
from steelyard.robot_file.column_names import Column
from steelyard.robot_file.signals import POSITION_UNITS, Signals

OUTSIDE = 1.1
"""Distance from the middle of a joint's range over half of it, above which positions are
doubtful."""
MOTOR = 3.0
"""How far outside positions of motors are at least."""


@dataclass(frozen=True)
class Position:
    """Whether positions are positions, their unit and side of the gears, and their limits."""

    name: ClassVar[str] = "position"
    question: ClassVar[str] = "Are positions in the declared unit?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that has rows."""
        return tuple(self._look(case, evidence) for evidence in with_rows(case))

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        if wrong := misplaced(case, evidence):
            return _misplaced(case, evidence, wrong)
        low, high = np.quantile(look(case, evidence).q, [0.005, 0.995], axis=0)
        off = _off(case, low, high)
        units = reading(case, evidence)
        declared = declared_units(evidence, case)
        other = [j for j, unit in enumerate(declared) if units.joints[j].position_unit != unit]
        picture = _picture(case, low, high)
        if _of_motors(case, evidence, off, units):
            return _motors(case, evidence, low, high, picture)
        if other:
            return _other_unit(case, evidence, units, other, off, picture)
        outside = np.flatnonzero(off > OUTSIDE)
        names = tuple(case.joints[j] for j in outside)
        are = "are outside their limits" if len(names) > 1 else "is outside its limits"
        clause = f"{', '.join(names)} {are}; " if names else ""
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL if names else Severity.OK,
            clause + _facts(case, evidence) + ("" if names else ", within the joints' limits"),
            _value_text(case, off),
            joints=names,
            fix=Fix(
                "check position_offset under [signals], the zero of the joints, and their limits; "
                "or the model file is of another robot"
            )
            if names
            else None,
            picture=picture,
        )


def _misplaced(case: Case, evidence: Evidence, wrong: Sequence[Misplaced]) -> Finding:
    """The finding on position columns that hold velocities."""
    signals, first = evidence.recording.signals, wrong[0]
    more = f" (and {len(wrong) - 1} more)" * (len(wrong) > 1)
    why = f"its values are the derivative of '{first.position}'"
    sure = all(one.sure for one in wrong)
    return Finding(
        Position.name,
        evidence.name,
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"position column '{first.column}'{more} holds velocities: "
        + (why if first.correlation else "by its name"),
        f"correlation of {first.correlation:.3g} with the derivative, velocities from {ALIKE:g} on"
        if first.correlation
        else "",
        joints=tuple(case.joints[one.joint] for one in wrong),
        fix=Fix(
            "declare the columns that hold positions, or log them", _with_positions(signals, wrong)
        ),
    )


def _with_positions(signals: Signals, wrong: Sequence[Misplaced]) -> tuple[Edit, ...]:
    """The position columns with those that hold positions; velocities where they are exchanged."""
    if not all(one.position for one in wrong):
        return ()
    instead = {one.column: one.position for one in wrong}
    edits = [Edit(("signals", "position"), [instead.get(name, name) for name in signals.position])]
    back = {position: column for column, position in instead.items()}
    if signals.velocity is not None and set(back) & set(signals.velocity):
        velocity = [back.get(name, name) for name in signals.velocity]
        edits.append(Edit(("signals", "velocity"), velocity))
    return tuple(edits)


def _off(case: Case, low: Array, high: Array) -> Array:
    """How far each joint gets from the middle of its range, over half the range."""
    joints = zip(case.loaded.robot.coordinates, low, high, strict=True)
    return np.array([beyond(c, float(a), float(b)) for c, a, b in joints])


def _of_motors(case: Case, evidence: Evidence, off: Array, units: Reading) -> bool:
    """Whether positions are motors', but not declared so: by their names, or as nothing fits."""
    signals = evidence.recording.signals
    if signals.position_map is not None:
        return False
    far = off > MOTOR
    if all(Column(name).has("motor", "motors") for name in signals.position):
        declared = [joint.position_unit for joint in units.as_declared]
        return bool(far.any()) or declared != [joint.position_unit for joint in units.joints]
    corrected = np.array([j.position_scale for j in units.joints])
    return bool(far.all() and (off * np.minimum(corrected, 1.0) > MOTOR).all())


def _motors(case: Case, evidence: Evidence, low: Array, high: Array, picture: Picture) -> Finding:
    limits = [c.limits for c in case.loaded.robot.coordinates]
    span = np.array([x.upper - x.lower for x in limits])
    ranged = np.isfinite(span) & (span > 0.0)
    ratios = np.ceil(np.divide(high - low, span, out=np.ones(len(span)), where=ranged))
    off = _off(case, low, high)
    outside = bool((off > OUTSIDE).any())
    far = f"up to {off.max():.0f} times farther than the joints can go"
    least = " ".join(f"{ratio:.0f}" for ratio in ratios)
    return Finding(
        Position.name,
        evidence.name,
        Severity.WRONG,
        "positions appear to be those of motors, not joints: they are "
        + (far if outside else "named so, and faster than joints"),
        _value_text(case, off),
        joints=tuple(case.joints[j] for j in np.flatnonzero(off > OUTSIDE)),
        fix=Fix(
            'declare coordinates = "motor" under [signals], and the gears as ratios = [...] under '
            "[robot.transmission]"
            + (f"; for positions to be within limits they must be at least {least}" * outside)
        ),
        picture=picture,
    )


def _other_unit(
    case: Case,
    evidence: Evidence,
    units: Reading,
    other: list[int],
    off: Array,
    picture: Picture,
) -> Finding:
    names = tuple(case.joints[j] for j in other)
    gains = {j: units.as_declared[j].cost - units.joints[j].cost for j in other}
    clear = max(other, key=gains.__getitem__)
    unit = " and ".join(sorted({units.joints[j].position_unit for j in other}))
    value = unit_value([j.position_unit for j in units.joints], case, POSITION_UNITS)
    gears = case.loaded.robot.transmission
    geared = gears is not None and bool(np.all(np.abs(np.diag(gears.matrix)) == 1.0))
    sure = units.sure and not geared
    edit = Edit(("signals", "position_unit"), value)
    says = f"declare these positions in {unit}"
    if geared:
        says = f"give the gear ratios, which are all 1, under [robot.transmission], or {says}"
    return Finding(
        Position.name,
        evidence.name,
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"positions of {case.listed(other)} {'are' if sure else 'may be'} in {unit}: as declared, "
        f"{case.joints[clear]} would {_reasons(case, evidence, units, clear, off)}",
        _value_text(case, off),
        joints=names,
        fix=Fix(says, (edit,))
        if sure
        else Fix(says if geared else f"examine the log, and {says} if they are"),
        picture=picture,
    )


def _reasons(case: Case, evidence: Evidence, units: Reading, joint: int, off: Array) -> str:
    """What speaks against the declared unit: range, speed and logged velocities."""
    fast, limit = motion(case, evidence), case.loaded.robot.coordinates[joint].limits.velocity
    speed = np.quantile(np.abs(fast.v[joint]), 0.995) if fast.v.shape[1] else 0.0
    found = []
    if off[joint] > OUTSIDE:
        found.append(f"reach {off[joint]:.2g} times its limits")
    if speed > 0.0:
        unit = f"{case.loaded.robot.coordinates[joint].unit}/s"
        known = f" (limit {limit:.2g} {unit})" if np.isfinite(limit) else ""
        found.append(f"move at {speed:.2g} {unit}{known}")
    if units.agreement is not None and units.agreement.reliable_joints[joint]:
        scale = abs(float(units.agreement.scale[joint]))
        if abs(np.log(scale)) > np.log(SAME):
            found.append(f"have logged velocities of {scale:.3g} times the derivative")
    return ", ".join(found) or "hardly move"


def _facts(case: Case, evidence: Evidence) -> str:
    signals, gears = evidence.recording.signals, case.loaded.robot.transmission
    units = " and ".join(sorted(set(declared_units(evidence, case))))
    if wrapped := evidence.recording.wrapped:
        units += f" ({', '.join(wrapped)} wrap after a turn: unwrapped)"
    if signals.position_map is None or gears is None:
        return f"positions in {units}"
    ratios = " ".join(f"{r:g}" for r in np.diag(gears.matrix))
    coupled = ", coupled" if gears.coupled else ""
    return f"motor-side signals, ratios {ratios}{coupled}; positions in {units}"


def _value_text(case: Case, off: Array) -> str:
    far = int(np.argmax(off))
    if off[far] <= OUTSIDE:
        return "every joint stays within its limits"
    return (
        f"{case.joints[far]} reaches {off[far]:.3g} times its limits, from the middle of its "
        f"range, at most {OUTSIDE:g} times allowed"
    )


def _picture(case: Case, low: Array, high: Array) -> Picture:
    limits = [c.limits for c in case.loaded.robot.coordinates]
    lower = np.array([x.lower if np.isfinite(x.lower) else np.nan for x in limits])
    upper = np.array([x.upper if np.isfinite(x.upper) else np.nan for x in limits])
    return of_joints(
        "position as declared [rad; m]",
        (
            ("lowest", low, "bars"),
            ("highest", high, "bars"),
            ("lower limit", lower, "points"),
            ("upper limit", upper, "points"),
        ),
    )
