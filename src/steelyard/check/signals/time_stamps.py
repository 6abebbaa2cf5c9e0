r"""Is the clock regular, in the declared unit, and are no rows missing?

Where rows are missing, every joint moves as many times farther than from row to row around it as
rows are missing, plus one. With $s_k$ the velocities from one row to the next and $e_k$ the median
of those around, both over each joint's rms velocity, the factor is $m_k = s_k \cdot e_k / e_k^2$.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.case import Case, Evidence
from steelyard.check.finding import (
    Edit,
    Finding,
    Fix,
    Picture,
    Severity,
    histogram,
    percent_of,
    trace,
)
from steelyard.check.signals.overview import (
    JITTER_LIMIT,
    LATE_STEP,
    cached_per_log,
    signal_overview,
)
from steelyard.check.signals.time_scale import time_scale, time_scale_by_velocities
from steelyard.check.signals.units import LONGEST_STEP, SHORTEST_STEP, UnitReading, unit_reading
from steelyard.check.signals.velocity_agreement import MOST_OFF, RATE_TOLERANCE
from steelyard.robot.file.signals import ROW
from steelyard.runs.rows.clock import GAP_SECONDS, GAP_STEPS

STEPS_AROUND_LEAP = 4
"""Steps on each side that say how fast joints move."""
LEAP_FACTOR = 2.5
"""Factor from which on rows are missing."""
COMMON_LEAP_RESIDUE = 0.3
"""Length of what the common factor leaves of the velocities, over theirs."""
SLOW_LEAP_SHARE = 0.2
"""Typical velocity, over the rms one, below which missing rows cannot be detected."""


@dataclass(frozen=True, eq=False)
class PositionLeaps:
    """Where positions leap ahead.

    Attributes:
        rows: The rows before, numbers among those given, shape `(k,)`.
        missing: How many rows' time is missing at each, shape `(k,)`.
        moving: Rows at which a leap would have been seen.
    """

    rows: NDArray[np.intp]
    missing: Array
    moving: int


def position_leaps(t: Array, q: Array) -> PositionLeaps:
    """Leaps of all joints at once; rows that repeat all positions are left out before.

    Args:
        t: Times of the rows, increasing, shape `(N,)` [s].
        q: Positions, shape `(N, n)`.
    """
    none = PositionLeaps(np.zeros(0, dtype=np.intp), np.zeros(0), 0)
    fresh = np.flatnonzero(np.concatenate(([True], (np.diff(q, axis=0) != 0.0).any(axis=1))))
    if len(fresh) < 8 * STEPS_AROUND_LEAP:
        return none
    velocity = np.diff(q[fresh], axis=0) / np.diff(t[fresh])[:, None]
    size = np.sqrt(np.mean(np.square(velocity), axis=0))
    velocity = velocity[:, size > 0.0] / size[size > 0.0]
    around = _around(velocity)
    inner = velocity[STEPS_AROUND_LEAP:-STEPS_AROUND_LEAP]
    square = np.sum(np.square(around), axis=1)
    factor = np.sum(inner * around, axis=1) / np.maximum(square, 1e-300)
    left = np.linalg.norm(inner - factor[:, None] * around, axis=1)
    moving = square > SLOW_LEAP_SHARE**2 * velocity.shape[1]
    found = (
        moving
        & (factor >= LEAP_FACTOR)
        & (left <= COMMON_LEAP_RESIDUE * np.linalg.norm(inner, axis=1))
    )
    at = np.flatnonzero(found)
    return PositionLeaps(
        fresh[at + STEPS_AROUND_LEAP], factor[at] - 1.0, int(np.count_nonzero(moving))
    )


def _around(velocity: Array) -> Array:
    """Median of the velocities before and after each, itself aside, without the ends."""
    windows = np.lib.stride_tricks.sliding_window_view(velocity, 2 * STEPS_AROUND_LEAP + 1, axis=0)
    others = np.delete(windows, STEPS_AROUND_LEAP, axis=2)
    return np.asarray(np.median(others, axis=2))


DOUBTFUL_GAPS, GAPS_PER_ROW = 5, 2.5e-4
"""Short gaps of a doubtful clock: so many, or three that are so frequent."""
DOUBTFUL_LEAPS, DOUBTFUL_MISSING, MUCH_MISSING = 5, 0.005, 0.05
"""Leaps of all joints, and share of rows missing at them, from which on a clock that is even is
doubtful, and wrong. Sound logs of seven real robots have at most 4 leaps and 0.1 %."""
REPEATED_STAMP_SHARE, BACKWARD_SHARE = 0.01, 0.05
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
        return len(self.gaps) > 0 or count >= DOUBTFUL_GAPS or often


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
        off = [time_scale_by_velocities(case, evidence, self.name) for evidence in case.logs]
        found = tuple(o or f for o, f in zip(off, found, strict=True))
        scale = time_scale(case, self.name)
        return found if scale is None else (scale, *found)

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        """One log's finding."""
        overview, units = signal_overview(case, evidence), unit_reading(case, evidence)
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


@cached_per_log
def out_of_order(case: Case, evidence: Evidence) -> bool:
    """Whether rows are not in the order of time, so that nothing is known of rates or motion."""
    steps = np.diff(signal_overview(case, evidence).stamps)
    return bool(np.any(steps > 0.0) and np.count_nonzero(steps < 0.0) > BACKWARD_SHARE * len(steps))


def _out_of_order(evidence: Evidence, stamps: Array) -> Finding:
    steps = np.diff(stamps)
    backward = int(np.count_nonzero(steps < 0.0))
    return Finding(
        Clock.name,
        evidence.name,
        Severity.WRONG,
        f"rows are not in the order of time: it decreases at {backward} of {len(steps)} steps",
        f"{percent_of(backward / len(steps))} of the steps backward, at most "
        f"{100.0 * BACKWARD_SHARE:g} % allowed",
        fix=Fix(f"sort the rows by '{evidence.recording.signals.time}'"),
    )


@cached_per_log
def missing_rows(case: Case, evidence: Evidence) -> PositionLeaps | None:
    """Where rows are missing though stamps go on evenly; `None` if there are hardly any."""
    overview = signal_overview(case, evidence)
    if not overview.moves:
        return None
    found = position_leaps(overview.t, overview.q)
    often = (
        len(found.rows) >= DOUBTFUL_LEAPS and found.missing.sum() >= DOUBTFUL_MISSING * found.moving
    )
    return found if often else None


def _leaps(evidence: Evidence, found: PositionLeaps, step: float) -> Finding:
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
        f"{100.0 * DOUBTFUL_MISSING:g} % allowed)",
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


def _other_rate(evidence: Evidence, units: UnitReading) -> Finding:
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
        f"{100.0 * RATE_TOLERANCE:g} % allowed",
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
    if steps.jitter >= JITTER_LIMIT:
        return (
            Severity.DOUBTFUL,
            f"time stamps jitter; {facts}",
            f"{jitter}, at most {100.0 * JITTER_LIMIT:g} % allowed",
            "log the controller's own clock, not the arrival of messages",
        )
    if repeats > REPEATED_STAMP_SHARE * count:
        return (
            Severity.DOUBTFUL,
            f"{repeats} rows have the stamp of the row before; {facts}",
            f"{percent_of(repeats / count)} of the stamps repeat, at most "
            f"{100.0 * REPEATED_STAMP_SHARE:g} % allowed",
            "log stamps with more digits; rows that repeat a stamp are dropped",
        )
    return Severity.OK, facts, f"{jitter}, at most {100.0 * JITTER_LIMIT:g} % allowed", None


def _facts(steps: _Steps) -> str:
    """Rate, steps and jitter in words."""
    forward = steps.steps[steps.steps > 0.0]
    mean = float(np.mean(forward[forward < LATE_STEP * steps.step]))
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
        long = steps.steps > LATE_STEP * steps.step
        gaps = trace("steps that miss rows", at[long], steps.steps[long], "points")
        return Picture("time [s]", "step [s]", (gaps,))
    return Picture("step [s]", "rows", (histogram("steps", steps.steps),))


def clock_is_irregular(case: Case, evidence: Evidence) -> bool:
    """Whether the clock of a log is to blame for what goes wrong with it."""
    return Clock()._look(case, evidence).severity != Severity.OK
