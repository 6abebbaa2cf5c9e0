"""Are logged velocities the derivatives of the positions?"""

from dataclasses import dataclass
from functools import cached_property
from math import log

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, log_check
from steelyard.check.decision.verdict_of_log import positions_at_fault
from steelyard.check.finding import PICTURE_TIME, Edit, Finding, Fix, Picture, Severity, trace
from steelyard.check.signals.motion_units import (
    SAME_SCALE,
    UnitReading,
    driven_joints,
    logged_velocities,
    unit_reading,
    unit_value,
)
from steelyard.check.signals.position_unit_and_columns import misplaced_velocities
from steelyard.check.signals.time_stamps_and_scale import leaping_rows, time_scale_by_velocities
from steelyard.check.signals.velocity_scale_and_lag import VelocityAgreement, one_sided_differences
from steelyard.robot.file.signals import VELOCITY_UNITS

LATE_STEPS, LATE_ERRORS = 1.5, 3.0
"""A lag is one if it is longer than so many steps of the clock and so many standard errors."""
REMOVE_VELOCITIES = tuple(
    Edit(("signals", key), None) for key in ("velocity", "velocity_unit", "velocity_sign")
)
LEAVE_OUT = Fix("leave the velocities out: positions are differentiated then", REMOVE_VELOCITIES)


@log_check("velocity", "Are velocities the derivatives of positions?")
def velocity_check(case: Case, checked: CheckedLog) -> Finding | None:
    """Scale, sign, order and lag of logged velocities, against the derivative of positions.

    `None` where nothing moves, or velocities are neither declared nor in other columns.
    """
    logged, units = logged_velocities(case, checked), unit_reading(case, checked)
    agreed = units.agreement
    if logged is None or agreed is None or not agreed.moving.any():
        return None
    if misplaced_velocities(case, checked) or not checked.overview.moves:
        return None
    columns, velocities = logged[0], _Velocities(case, checked, *logged, units, agreed)
    declared = checked.recording.signals.velocity is not None
    bad = velocities.of(*velocities.faults)
    grave = bool(velocities.of("swapped", "unit", "turned", "scaled", "strange").any())
    clauses = velocities.clauses
    severity, fix, answered = Severity.OK, None, True
    leaps = leaping_rows(checked)
    if leaps is not None and not leaps.made_up:
        clauses, answered = ["rows are missing, which breaks d(q)/dt: see clock"], False
    elif (clock := time_scale_by_velocities(case, checked)) is not None and clock.severity is (
        Severity.WRONG
    ):
        clauses, answered = [clock.says], False
    elif declared and velocities.misplaced and positions_at_fault(case, checked):
        clauses.append("the positions are wrong")
    elif declared and grave and velocities.of_positions:
        severity = Severity.DOUBTFUL
        fix = Fix("check the unit of the positions; the velocities agree with it as declared")
    elif declared and grave:
        severity, fix = Severity.WRONG, velocities.fix
    elif declared and bad.any():
        severity, fix = Severity.DOUBTFUL, LEAVE_OUT
    left_out = "" if declared else f"velocities ({columns[0]} ...) are logged but left out; "
    return Finding.of(
        severity,
        left_out + "; ".join([*clauses, _lags(agreed)]),
        velocities.value_text,
        joints=tuple(case.joints[j] for j in np.flatnonzero(bad)),
        fix=fix,
        picture=_picture(case, agreed, bad),
        answered=answered,
    )


@dataclass(frozen=True, eq=False)
class _Velocities:
    """Logged velocities `(N, n)` of one log in their columns, and what is wrong with them."""

    case: Case
    evidence: CheckedLog
    columns: tuple[str, ...]
    logged: Array
    units: UnitReading
    agreed: VelocityAgreement

    @cached_property
    def faults(self) -> dict[str, NDArray[np.bool_]]:
        """Masks over the joints, shape `(n,)`.

        Another column fits; they are in another unit, of the other sign, off by a factor that is
        no unit's, or the derivative of no position; they lag, or are differences of a row's
        position and its neighbour's.
        """
        overview, agreed, units = self.evidence.overview, self.agreed, self.units
        signals, driven = self.evidence.recording.signals, driven_joints(self.case, self.evidence)
        # what is only dragged along moves too little for a scale or a lag
        reliable = agreed.reliable_joints & driven
        ratio, step = np.abs(units.relative), overview.step * units.second
        taken_out = 0.0 if signals.velocity is None else signals.velocity_delay
        with np.errstate(invalid="ignore"):
            off = np.abs(np.log(np.where(ratio > 0.0, ratio, np.nan))) > log(SAME_SCALE)
            longest = np.maximum(LATE_STEPS * step, LATE_ERRORS * agreed.lag_std)
            late = np.abs(agreed.lag - taken_out) > longest
            turned = agreed.scale < 0.0
        pairs = zip(units.as_declared, units.joints, strict=True)
        q = overview.q * [joint.position_scale for joint in units.joints]
        dq = self.logged * [joint.velocity_scale for joint in units.joints]
        return {
            "swapped": agreed.order != np.arange(len(driven)),
            "unit": reliable & [a.velocity_unit != b.velocity_unit for a, b in pairs],
            "turned": reliable & turned,
            "scaled": reliable & off,
            "strange": driven & ~reliable,
            "late": reliable & late,
            "differenced": driven & one_sided_differences(units.second * overview.t, q, dq),
        }

    def of(self, *faults: str) -> NDArray[np.bool_]:
        """Joints with any of some faults, shape `(n,)`."""
        return np.asarray(np.any([self.faults[fault] for fault in faults], axis=0))

    @property
    def misplaced(self) -> bool:
        """Whether nothing is wrong but order and sign, which positions may have instead."""
        other = self.of("unit", "scaled", "strange")
        return bool(self.of("swapped", "turned").any() and not other.any())

    @property
    def of_positions(self) -> bool:
        """Whether the unit of positions, which is doubtful, is what is wrong."""
        pairs = zip(self.units.as_declared, self.units.joints, strict=True)
        other = np.array([a.position_unit != b.position_unit for a, b in pairs])
        alone = not self.of("swapped", "turned", "scaled", "strange").any()
        return not self.units.sure and alone and bool(other[self.faults["unit"]].all())

    @property
    def clauses(self) -> list[str]:
        order, joints, units = self.agreed.order, self.case.joints, self.units.joints
        found = {k: np.flatnonzero(mask).tolist() for k, mask in self.faults.items()}
        declared = self.evidence.recording.signals.velocity is not None
        unused = "" if declared else ", but are not used"
        swapped = ", ".join(f"{self.columns[order[j]]} is of {joints[j]}" for j in found["swapped"])
        unit = " and ".join(sorted({units[j].velocity_unit for j in found["unit"]}))
        are = "may be" if self.of_positions else "are"
        factors = ", ".join(f"{abs(self.units.relative[j]):.3g}" for j in found["scaled"])
        says = {
            "swapped": f"velocity columns are swapped: {swapped}",
            "unit": f"velocities of %s {are} in {unit}",
            "turned": "position and velocity of %s have opposite signs, either may be at fault",
            "scaled": f"velocities of %s are {factors} times d(q)/dt",
            "strange": "velocities of %s are not the derivatives of the positions",
            "late": f"velocities of %s are late{unused}",
            "differenced": "velocities of %s are differences of successive positions: half a row "
            f"late, with twice the noise{unused}",
        }
        named = {fault: self.case.listed(which) for fault, which in found.items() if which}
        return [says[fault].replace("%s", names) for fault, names in named.items()]

    @property
    def fix(self) -> Fix:
        """Order, unit and sign put right; or no velocities, if they cannot be."""
        order, signals = self.agreed.order, self.evidence.recording.signals
        if self.of("scaled", "strange").any():
            return LEAVE_OUT
        edits, says = [], []
        if self.faults["swapped"].any():
            edits.append(Edit(("signals", "velocity"), [self.columns[k] for k in order]))
            says.append("order the columns as the joints are")
        if self.faults["unit"].any():
            units = [joint.velocity_unit for joint in self.units.joints]
            value = unit_value(units, self.case, VELOCITY_UNITS)
            edits.append(Edit(("signals", "velocity_unit"), value))
            says.append("declare the unit of the velocities")
        if self.faults["turned"].any() and signals.velocity_scale is not None:
            own = np.sign(signals.velocity_scale)[order]
            signs = np.where(self.faults["turned"], -own, own)
            edits.append(Edit(("signals", "velocity_sign"), [int(s) for s in signs]))
            says.append(
                "change the signs of the velocities (or of the positions, if a check against "
                "a model finds them wrong)"
            )
        return Fix("; ".join(says), tuple(edits))

    @property
    def value_text(self) -> str:
        """The joints whose scale and whose lag are farthest off."""
        agreed, joints = self.agreed, self.case.joints
        reliable = np.flatnonzero(agreed.reliable_joints)
        if not len(reliable):
            best = float(np.nanmax(np.abs(agreed.correlation)))
            return f"correlation of {best:.2g} with d(q)/dt, at least 0.9 required"
        far = reliable[np.argmax(np.abs(self.units.relative[reliable] - 1.0))]
        late = reliable[np.argmax(np.abs(agreed.lag[reliable]))]
        step = 1e3 * self.evidence.overview.step * self.units.second
        return (
            f"{joints[far]}: {agreed.scale[far]:.3g} times d(q)/dt ({1.0 / SAME_SCALE:.2g} to "
            f"{SAME_SCALE:g} allowed); {joints[late]}: {1e3 * agreed.lag[late]:.2f} ± "
            f"{1e3 * agreed.lag_std[late]:.2f} ms late (at most {LATE_STEPS * step:.3g} ms allowed)"
        )


def _lags(agreed: VelocityAgreement) -> str:
    reliable = agreed.reliable_joints
    if not reliable.any():
        return "no lag can be estimated"
    lag = 1e3 * agreed.lag[reliable]
    error = 1e3 * float(np.max(agreed.lag_std[reliable]))
    spread = f"{lag.min():.3g} to {lag.max():.3g}" if len(lag) > 1 else f"{lag[0]:.3g}"
    return f"velocities lag {spread} ms (± {error:.1g}) behind d(q)/dt"


def _picture(case: Case, agreed: VelocityAgreement, bad: NDArray[np.bool_]) -> Picture:
    """Derivative and velocity, as declared, of the first bad or the latest joint at its busiest."""
    lag = np.where(agreed.reliable_joints, np.abs(agreed.lag), -1.0)
    joint = int(np.argmax(bad if bad.any() else lag))
    v, t = agreed.derivative[joint], agreed.t
    length = len(t)
    if length > 1:
        length = min(length, max(2, int(PICTURE_TIME / max(t[1] - t[0], 1e-9))))
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
