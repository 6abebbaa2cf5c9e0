"""Are logged velocities the derivatives of the positions?"""

from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.check.case import Case, Evidence, log_check
from steelyard.check.decision.verdict import positions_at_fault
from steelyard.check.finding import Edit, Finding, Fix, Picture, Severity, trace
from steelyard.check.signals.overview import signal_overview
from steelyard.check.signals.position import misplaced_velocities
from steelyard.check.signals.time_stamps import missing_rows
from steelyard.check.signals.units import (
    SAME_SCALE,
    UnitReading,
    driven_joints,
    logged_velocities,
    unit_reading,
    unit_value,
)
from steelyard.check.signals.velocity_agreement import VelocityAgreement, one_sided_differences
from steelyard.robot.file.signals import VELOCITY_UNITS

LATE_STEPS, LATE_ERRORS = 1.5, 3.0
"""A lag is one if it is longer than so many steps of the clock and so many standard errors."""
VELOCITY_PICTURE_TIME = 10.0
"""Length of the picture [s]."""
REMOVE_VELOCITIES = tuple(
    Edit(("signals", key), None) for key in ("velocity", "velocity_unit", "velocity_sign")
)
LEAVE_VELOCITIES_OUT = "leave the velocities out: positions are differentiated then"


@dataclass(frozen=True, eq=False)
class _VelocityFaults:
    """What is wrong with velocities; arrays are masks over the joints.

    Attributes:
        swapped: Another column fits.
        unit: They are in another unit.
        turned: They have the other sign.
        scaled: They are off by a factor that is no unit's.
        strange: They are not the derivative of any position.
        late: They lag.
        differenced: They are differences of a row's position and its neighbour's.
        of_positions: Whether the unit of positions, which is doubtful, is what is wrong.
    """

    swapped: NDArray[np.bool_]
    unit: NDArray[np.bool_]
    turned: NDArray[np.bool_]
    scaled: NDArray[np.bool_]
    strange: NDArray[np.bool_]
    late: NDArray[np.bool_]
    differenced: NDArray[np.bool_]
    of_positions: bool

    @property
    def grave(self) -> NDArray[np.bool_]:
        """Joints with a fault that is not only a lag."""
        bad: NDArray[np.bool_] = self.swapped | self.unit | self.turned | self.scaled | self.strange
        return bad

    @property
    def misplaced(self) -> bool:
        """Whether nothing is wrong but order and sign, which positions may have instead."""
        other: NDArray[np.bool_] = self.unit | self.scaled | self.strange
        return bool((self.swapped | self.turned).any() and not other.any())


@log_check("velocity", "Are velocities the derivatives of positions?")
def velocity_check(case: Case, evidence: Evidence) -> Finding | None:
    """Scale, sign, order and lag of logged velocities, against the derivative of positions.

    `None` where nothing moves, or velocities are neither declared nor in other columns.
    """
    logged, units = logged_velocities(case, evidence), unit_reading(case, evidence)
    agreed = units.agreement
    if logged is None or agreed is None or not agreed.moving.any():
        return None
    if misplaced_velocities(case, evidence) or not signal_overview(case, evidence).moves:
        return None
    columns = logged[0]
    declared = evidence.recording.signals.velocity is not None
    faults = _faults(case, evidence, units, agreed)
    clauses = _clauses(case, columns, units, agreed, faults, declared)
    severity, fix, answered = Severity.OK, None, True
    if missing_rows(case, evidence) is not None:
        clauses, answered = ["rows are missing, which breaks d(q)/dt: see clock"], False
    elif declared and faults.misplaced and positions_at_fault(case, evidence):
        clauses.append("the positions are wrong")
    elif declared and faults.grave.any() and faults.of_positions:
        severity = Severity.DOUBTFUL
        fix = Fix("check the unit of the positions; the velocities agree with it as declared")
    elif declared and faults.grave.any():
        severity, fix = Severity.WRONG, _fix(case, evidence, columns, units, faults)
    elif declared and (faults.late | faults.differenced).any():
        severity, fix = Severity.DOUBTFUL, Fix(LEAVE_VELOCITIES_OUT, REMOVE_VELOCITIES)
    bad = faults.grave | faults.late | faults.differenced
    left_out = "" if declared else f"velocities ({columns[0]} ...) are logged but left out; "
    return Finding.of(
        severity,
        left_out + "; ".join([*clauses, _facts(agreed)]),
        _value_text(case, evidence, units, agreed),
        joints=tuple(case.joints[j] for j in np.flatnonzero(bad)),
        fix=fix,
        picture=_picture(case, agreed, _worst(agreed, bad)),
        answered=answered,
    )


def _faults(
    case: Case, evidence: Evidence, units: UnitReading, agreed: VelocityAgreement
) -> _VelocityFaults:
    overview, signals = signal_overview(case, evidence), evidence.recording.signals
    driven, n = driven_joints(case, evidence), len(agreed.order)
    # what is only dragged along moves too little for a scale or a lag
    reliable = agreed.reliable_joints & driven
    relative = np.array([abs(units.relative(j)) for j in range(n)])
    step = overview.step * units.second
    with np.errstate(invalid="ignore"):
        off = np.abs(np.log(np.where(relative > 0.0, relative, np.nan))) > log(SAME_SCALE)
        taken_out = 0.0 if signals.velocity is None else signals.velocity_delay
        late = np.abs(agreed.lag - taken_out) > np.maximum(
            LATE_STEPS * step, LATE_ERRORS * agreed.lag_std
        )
        turned = reliable & (agreed.scale < 0.0)
    pairs = list(zip(units.as_declared, units.joints, strict=True))
    swapped, strange = agreed.order != np.arange(n), driven & ~reliable
    unit = reliable & np.array([a.velocity_unit != b.velocity_unit for a, b in pairs])
    positions = np.array([a.position_unit != b.position_unit for a, b in pairs])
    other = swapped | turned | (reliable & off) | strange
    differenced, logged = np.zeros(n, dtype=np.bool_), logged_velocities(case, evidence)
    if logged is not None:
        q = overview.q * [joint.position_scale for joint in units.joints]
        dq = logged[1] * [joint.velocity_scale for joint in units.joints]
        differenced = driven & one_sided_differences(units.second * overview.t, q, dq)
    of_positions = not units.sure and not other.any() and bool(positions[unit].all())
    return _VelocityFaults(
        swapped, unit, turned, reliable & off, strange, reliable & late, differenced, of_positions
    )


def _clauses(
    case: Case,
    columns: tuple[str, ...],
    units: UnitReading,
    agreed: VelocityAgreement,
    faults: _VelocityFaults,
    declared: bool,
) -> list[str]:
    """What is wrong, one clause each."""
    clauses = []
    unused = "" if declared else ", but are not used"
    if faults.swapped.any():
        pairs = [f"{columns[agreed.order[j]]} is of {case.joints[j]}" for j in _at(faults.swapped)]
        clauses.append(f"velocity columns are swapped: {', '.join(pairs)}")
    if faults.unit.any():
        unit = " and ".join(sorted({units.joints[j].velocity_unit for j in _at(faults.unit)}))
        are = "may be" if faults.of_positions else "are"
        clauses.append(f"velocities of {case.listed(_at(faults.unit))} {are} in {unit}")
    if faults.turned.any():
        clauses.append(
            f"position and velocity of {case.listed(_at(faults.turned))} have opposite signs, "
            "either may be at fault"
        )
    factors = ", ".join(f"{abs(units.relative(j)):.3g}" for j in _at(faults.scaled))
    for mask, says in (
        (faults.scaled, f"{factors} times d(q)/dt"),
        (faults.strange, "not the derivatives of the positions"),
        (faults.late, f"late{unused}"),
        (
            faults.differenced,
            "differences of successive positions: half a row late, with twice the noise" + unused,
        ),
    ):
        if mask.any():
            clauses.append(f"velocities of {case.listed(_at(mask))} are {says}")
    return clauses


def _fix(
    case: Case,
    evidence: Evidence,
    columns: tuple[str, ...],
    units: UnitReading,
    faults: _VelocityFaults,
) -> Fix:
    """Order, unit and sign put right; or no velocities, if they cannot be."""
    agreed, signals = units.agreement, evidence.recording.signals
    if faults.scaled.any() or faults.strange.any() or agreed is None:
        return Fix(LEAVE_VELOCITIES_OUT, REMOVE_VELOCITIES)
    edits, says = [], []
    if faults.swapped.any():
        order: Any = [columns[k] for k in agreed.order]
        edits.append(Edit(("signals", "velocity"), order))
        says.append("order the columns as the joints are")
    if faults.unit.any():
        value = unit_value([j.velocity_unit for j in units.joints], case, VELOCITY_UNITS)
        edits.append(Edit(("signals", "velocity_unit"), value))
        says.append("declare the unit of the velocities")
    if faults.turned.any() and signals.velocity_scale is not None:
        own = np.sign(signals.velocity_scale)[agreed.order]
        signs = np.where(faults.turned, -own, own)
        edits.append(Edit(("signals", "velocity_sign"), [int(s) for s in signs]))
        says.append(
            "change the signs of the velocities (or of the positions, if a check against "
            "a model finds them wrong)"
        )
    return Fix("; ".join(says), tuple(edits))


def _at(mask: NDArray[np.bool_]) -> list[int]:
    return np.flatnonzero(mask).tolist()


def _facts(agreed: VelocityAgreement) -> str:
    """The lags in words."""
    reliable = agreed.reliable_joints
    if not reliable.any():
        return "no lag can be estimated"
    lag = 1e3 * agreed.lag[reliable]
    error = 1e3 * float(np.max(agreed.lag_std[reliable]))
    spread = f"{lag.min():.3g} to {lag.max():.3g}" if len(lag) > 1 else f"{lag[0]:.3g}"
    return f"velocities lag {spread} ms (± {error:.1g}) behind d(q)/dt"


def _value_text(
    case: Case, evidence: Evidence, units: UnitReading, agreed: VelocityAgreement
) -> str:
    reliable = _at(agreed.reliable_joints)
    if not reliable:
        best = float(np.nanmax(np.abs(agreed.correlation)))
        return f"correlation of {best:.2g} with d(q)/dt, at least 0.9 required"
    ratio = np.array([units.relative(j) for j in range(len(agreed.order))])
    far = max(reliable, key=lambda j: abs(ratio[j] - 1.0))
    late = max(reliable, key=lambda j: abs(float(agreed.lag[j])))
    step = 1e3 * signal_overview(case, evidence).step * units.second
    declared = float(agreed.scale[far])
    return (
        f"{case.joints[far]}: {declared:.3g} times d(q)/dt ({1.0 / SAME_SCALE:.2g} to "
        f"{SAME_SCALE:g} allowed); {case.joints[late]}: {1e3 * agreed.lag[late]:.2f} ± "
        f"{1e3 * agreed.lag_std[late]:.2f} ms late (at most {LATE_STEPS * step:.3g} ms allowed)"
    )


def _worst(agreed: VelocityAgreement, bad: NDArray[np.bool_]) -> int:
    if bad.any():
        return _at(bad)[0]
    lag = np.where(agreed.reliable_joints, np.abs(agreed.lag), -1.0)
    return int(np.argmax(lag))


def _picture(case: Case, agreed: VelocityAgreement, joint: int) -> Picture:
    """Derivative and velocity of a joint where it is busiest, as declared."""
    v, t = agreed.derivative[joint], agreed.t
    length = len(t)
    if length > 1:
        length = min(length, max(2, int(VELOCITY_PICTURE_TIME / max(t[1] - t[0], 1e-9))))
    energy = np.concatenate(([0.0], np.cumsum(np.square(v))))
    start = int(np.argmax(energy[length:] - energy[: len(energy) - length]))
    at = slice(start, start + length)
    name = case.joints[joint]
    return Picture(
        "time [s]",
        "velocity as declared",
        (
            trace(f"d(q)/dt of {name}", t[at], v[at]),
            trace(f"logged velocity of {name}", t[at], agreed.logged[joint][at]),
        ),
    )
