"""Is the clock regular, and in the unit that the robot file declares?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Edit, Finding, Fix, Picture, Severity, percent_of
from steelyard.diagnosis.pictures import histogram, trace
from steelyard.diagnosis.signal_overview import JITTER, LATE, look, once
from steelyard.diagnosis.signals.missing_rows import Leaps, leaps
from steelyard.diagnosis.signals.rate import MOST_OFF, OFF
from steelyard.diagnosis.signals.time_scale import by_velocities, time_scale
from steelyard.diagnosis.signals.unit_costs import LONGEST_STEP, SHORTEST_STEP
from steelyard.diagnosis.signals.units import Reading, reading
from steelyard.measurement.rows.clock import GAP_SECONDS, GAP_STEPS
from steelyard.robot_file.signals import ROW

GAPS, GAPS_PER_ROW = 5, 2.5e-4
"""Short gaps of a doubtful clock: so many, or three that are so frequent."""
LEAPS, MISSING, MUCH_MISSING = 5, 0.005, 0.05
"""Leaps of all joints, and share of rows missing at them, from which on a clock that is even is
doubtful, and wrong. Sound logs of seven real robots have at most 4 leaps and 0.1 %."""
REPEATS, BACKWARD = 0.01, 0.05
"""Shares of stamps that repeat (doubtful) or run backward (wrong)."""


@dataclass(frozen=True)
class _Steps:
    """What the stamps say, in true seconds.

    Attributes:
        step: Median step forward [s].
        steps: All steps [s].
        jitter: Standard deviation of steps without gaps, over the median one.
    """

    step: float
    steps: Array
    jitter: float

    @property
    def long(self) -> Array:
        """Steps that miss some rows [s]."""
        return self.steps[self.steps > GAP_STEPS * self.step]

    @property
    def gaps(self) -> Array:
        """Steps too long to be bridged [s]."""
        return self.steps[self.steps > max(GAP_STEPS * self.step, GAP_SECONDS)]

    @property
    def missing(self) -> bool:
        """Whether more is missing than an interpolation bridges."""
        count = len(self.long)
        often = count >= 3 and count >= GAPS_PER_ROW * len(self.steps)
        return len(self.gaps) > 0 or count >= GAPS or often


@dataclass(frozen=True)
class Clock:
    """Rate, jitter, gaps, repeats, steps backward, and the unit of time."""

    name: ClassVar[str] = "clock"
    question: ClassVar[str] = "Is the clock regular?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log; one more if a fit shows that the clock runs fast or slow."""
        found = tuple(self._look(case, evidence) for evidence in case.logs)
        if any(finding.severity for finding in found):
            return found
        off = [by_velocities(case, evidence, self.name) for evidence in case.logs]
        found = tuple(o or f for o, f in zip(off, found, strict=True))
        scale = time_scale(case, self.name)
        return found if scale is None else (scale, *found)

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        """One log's finding."""
        overview, units = look(case, evidence), reading(case, evidence)
        if overview.step == 0.0:
            return _differs(evidence)
        if out_of_order(case, evidence):
            return _out_of_order(evidence, overview.stamps)
        steps = _Steps(
            overview.step * units.second, np.diff(overview.stamps) * units.second, overview.jitter
        )
        if units.time_unit == ROW:
            return _other_rate(evidence, units)
        if units.second != 1.0:
            return _other_unit(evidence, units.time_unit, steps, overview.step)
        severity, says, figure, fix = _judged(steps)
        if evidence.recording.signals.time == ROW:
            says += ", as declared: the log has no column of time"
        gone = missing_rows(case, evidence)
        if severity is Severity.OK and gone is not None:
            return _leaps(evidence, gone, steps.step)
        return Finding(
            self.name,
            evidence.name,
            severity,
            says,
            figure,
            fix=None if fix is None else Fix(fix),
            picture=_picture(steps, overview.stamps),
        )


@once
def out_of_order(case: Case, evidence: Evidence) -> bool:
    """Whether rows are not in the order of time, so that nothing is known of rates or motion."""
    steps = np.diff(look(case, evidence).stamps)
    return bool(np.any(steps > 0.0) and np.count_nonzero(steps < 0.0) > BACKWARD * len(steps))


def _out_of_order(evidence: Evidence, stamps: Array) -> Finding:
    steps = np.diff(stamps)
    backward = int(np.count_nonzero(steps < 0.0))
    return Finding(
        Clock.name,
        evidence.name,
        Severity.WRONG,
        f"rows are not in the order of time: it decreases at {backward} of {len(steps)} steps",
        f"{percent_of(backward / len(steps))} of the steps backward, at most "
        f"{100.0 * BACKWARD:g} % allowed",
        fix=Fix(f"sort the rows by '{evidence.recording.signals.time}'"),
    )


@once
def missing_rows(case: Case, evidence: Evidence) -> Leaps | None:
    """Where rows are missing though stamps go on evenly; `None` if there are hardly any."""
    overview = look(case, evidence)
    if not overview.moves:
        return None
    found = leaps(overview.t, overview.q)
    often = len(found.rows) >= LEAPS and found.missing.sum() >= MISSING * found.moving
    return found if often else None


def _leaps(evidence: Evidence, found: Leaps, step: float) -> Finding:
    share = float(found.missing.sum()) / max(found.moving, 1)
    typical = float(np.median(found.missing))
    return Finding(
        Clock.name,
        evidence.name,
        Severity.WRONG if share >= MUCH_MISSING else Severity.DOUBTFUL,
        f"rows are missing though time stamps are uniform: at {len(found.rows)} places all "
        f"joints jump ahead simultaneously, by {typical:.2g} rows typically; "
        f"{_time(step * found.missing.sum())} "
        "in all. Time stamps were made uniform after rows were lost",
        f"{percent_of(share)} of the rows in motion are missing (at most "
        f"{100.0 * MISSING:g} % allowed)",
        fix=Fix("log the controller's own time stamps, and do not change them"),
    )


def _differs(evidence: Evidence) -> Finding:
    column = evidence.recording.signals.time
    return Finding(
        Clock.name,
        evidence.name,
        Severity.WRONG,
        f"column '{column}' never increases: it is not a clock",
        "median step 0 s",
        fix=Fix("set time = ... under [signals] to the log's clock"),
    )


def _other_unit(evidence: Evidence, unit: str, steps: _Steps, declared: float) -> Finding:
    return Finding(
        Clock.name,
        evidence.name,
        Severity.WRONG,
        f"time stamps are in {unit}: the time step would be {declared:.4g} s as declared, and is "
        f"{_time(steps.step)}",
        f"step of {declared:.4g} s as declared, logs have {SHORTEST_STEP:g} to {LONGEST_STEP:g} s",
        fix=Fix(f"declare time in {unit}", (Edit(("signals", "time_unit"), unit),)),
        picture=Picture("step [s]", "rows", (histogram("steps", steps.steps),)),
    )


def _other_rate(evidence: Evidence, units: Reading) -> Finding:
    """The finding on a declared rate that velocities contradict."""
    scale, declared = 1.0 / units.second, 1.0 / evidence.recording.signals.time_scale
    rate = float(f"{scale * declared:.6g}")
    sure = abs(scale - 1.0) > MOST_OFF
    return Finding(
        Clock.name,
        evidence.name,
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"at the declared {declared:.4g} Hz velocities are {scale:.3g} times d(q)/dt: the rate is "
        f"{rate:.4g} Hz" + ("" if sure else ", or the unit of velocities is off"),
        f"declared rate {100.0 * abs(units.second - 1.0):.3g} % off, at most "
        f"{100.0 * OFF:g} % allowed",
        fix=Fix(f"declare the rate of {rate:.4g} Hz", (Edit(("signals", "rate"), rate),)),
    )


def _judged(steps: _Steps) -> tuple[Severity, str, str, str | None]:
    """Severity, sentence, figure and correct of the worst that is wrong with a clock."""
    count = max(len(steps.steps), 1)
    backward = int(np.count_nonzero(steps.steps < 0.0))
    repeats = int(np.count_nonzero(steps.steps == 0.0))
    jitter = f"jitter {percent_of(steps.jitter)} of the step"
    facts = _facts(steps)
    if backward:
        return (
            Severity.DOUBTFUL,
            f"time decreases at {backward} rows; {facts}",
            f"{backward} of {count} steps backward, none allowed",
            "log the controller's own clock, not the arrival of messages, or sort the rows",
        )
    if steps.missing:
        missing = float((steps.long - steps.step).sum())
        return (
            Severity.DOUBTFUL,
            f"rows are missing: {len(steps.long)} gaps, the longest of "
            f"{_time(float(steps.long.max()))}, {_time(missing)} in all; {facts}",
            f"{len(steps.long)} steps longer than {GAP_STEPS:g} median ones, "
            f"{len(steps.gaps)} of them not bridged",
            "find out why rows are lost; the parts between gaps are used separately",
        )
    if steps.jitter >= JITTER:
        return (
            Severity.DOUBTFUL,
            f"time stamps jitter; {facts}",
            f"{jitter}, at most {100.0 * JITTER:g} % allowed",
            "log the controller's own clock, not the arrival of messages",
        )
    if repeats > REPEATS * count:
        return (
            Severity.DOUBTFUL,
            f"{repeats} rows have the stamp of the row before; {facts}",
            f"{percent_of(repeats / count)} of the stamps repeat, at most "
            f"{100.0 * REPEATS:g} % allowed",
            "log stamps with more digits; rows that repeat a stamp are dropped",
        )
    return Severity.OK, facts, f"{jitter}, at most {100.0 * JITTER:g} % allowed", None


def _facts(steps: _Steps) -> str:
    """Rate, steps and jitter in words."""
    forward = steps.steps[steps.steps > 0.0]
    mean = float(np.mean(forward[forward < LATE * steps.step]))
    low, high = np.quantile(forward, [0.01, 0.99])
    words = f"{1.0 / mean:.4g} Hz, steps "
    if high - low <= 1e-3 * steps.step:
        return words + f"of {_time(steps.step)}, uniform"
    longest = f", the longest {_time(float(forward.max()))}" if forward.max() > 1.5 * high else ""
    spread = _time(steps.jitter * steps.step)
    usual = f"{_time(float(low))} to {_time(float(high))} (98 % of them)"
    return f"{words}{usual}{longest}, jitter {spread}"


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"


def _picture(steps: _Steps, stamps: Array) -> Picture:
    """A histogram of the steps; of few long ones, when they come."""
    if steps.missing and len(steps.steps):
        at = stamps[1:] - stamps[0]
        long = steps.steps > LATE * steps.step
        gaps = trace("steps that miss rows", at[long], steps.steps[long], "points")
        return Picture("time [s]", "step [s]", (gaps,))
    return Picture("step [s]", "rows", (histogram("steps", steps.steps),))


def irregular(case: Case, evidence: Evidence) -> bool:
    """Whether the clock of a log is to blame for what goes wrong with it."""
    return Clock()._look(case, evidence).severity != Severity.OK
