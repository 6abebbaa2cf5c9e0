r"""Is the clock regular, in the declared unit, and are no rows missing?

Where rows are missing, every joint moves as many times farther than from row to row around it as
rows are missing, plus one. With $s_k$ the velocities from one row to the next and $e_k$ the median
of those around, both over each joint's rms velocity, the factor is $m_k = s_k \cdot e_k / e_k^2$.

Stamps that are $s$ times too late make velocities $1/s$ and accelerations $1/s^2$ of what they are.
Inertias and friction can make up for that, gravity cannot: first moments stand in its torque and,
through the links' lengths, in that of accelerations. So a fit identifies $s$ as it identifies the
size of gravity. The typical residual variance, in logarithms, is sought over $\ln s$.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check, remembered
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
from steelyard.check.hypotheses.hypotheses_and_their_scores import likeliest
from steelyard.check.signals.motion_units import (
    LONGEST_STEP,
    SHORTEST_STEP,
    UnitReading,
    driven_joints,
    unit_reading,
)
from steelyard.check.signals.usable_rows import JITTER_LIMIT, LATE_STEP
from steelyard.check.signals.velocity_scale_and_lag import (
    FEWEST_RATE_JOINTS,
    MOST_OFF,
    RATE_TOLERANCE,
    UNEVEN_RATE,
)
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.robot.file.signals import ROW
from steelyard.runs.rows.clock_and_row_scan import GAP_SECONDS, GAP_STEPS
from steelyard.runs.run import Block, Run
from steelyard.runs.sample_cache import BLOCK_SAMPLES

STEPS_AROUND_LEAP = 4  # steps on each side that say how fast joints move
LEAP_FACTOR = 2.5  # factor from which on rows are missing
COMMON_LEAP_RESIDUE = 0.3  # length of what the common factor leaves of the velocities, over theirs
SLOW_LEAP_SHARE = 0.2
"""Typical velocity, over the rms one, below which missing rows cannot be detected."""


@dataclass(frozen=True, eq=False)
class Leaps:
    """Rows' time that is missing where all joints leap ahead at once, one number each.

    Time in rows by which all joints lag behind elsewhere, and the number of rows at which a leap
    would have been seen. What leaps make up for is not missing: samples are of uneven times.
    """

    missing: Array
    late: float
    moving: int

    @property
    def made_up(self) -> bool:
        """Whether joints lag behind by as much as they leap ahead, half of it at least."""
        return self.late >= 0.5 * float(self.missing.sum())


DOUBTFUL_GAPS, GAPS_PER_ROW = 5, 2.5e-4
"""Short gaps of a doubtful clock, or leaps of all joints of an even one: so many; or three gaps
that are so frequent."""
DOUBTFUL_MISSING, MUCH_MISSING = 0.005, 0.05
"""Share of rows missing at leaps of all joints from which on a clock that is even is doubtful, and
wrong. Sound logs of seven real robots have at most 4 leaps and 0.1 %."""
REPEATED_STAMP_SHARE, BACKWARD_SHARE = 0.01, 0.05
"""Shares of stamps that repeat (doubtful) or run backward (wrong)."""


@case_check("clock", "Is the clock regular?")
def clock_check(case: Case) -> Iterable[Finding]:
    """Rate, jitter, gaps, repeats, steps backward, and the unit of time.

    One finding per log; one more if a fit shows that the clock runs fast or slow. A declared rate
    that neither velocities nor a fit confirm is open.
    """
    found = [replace(clock_of_log(case, log), log=log.name) for log in case.logs]
    if any(finding.severity for finding in found):
        return found
    found = [time_scale_by_velocities(case, e) or f for e, f in zip(case.logs, found, strict=True)]
    scale, fits = time_scale(case)
    if scale is not None:
        return [scale, *found]
    if fits or case.loaded.signals is None or case.loaded.signals.time != ROW:
        return found
    says = "{}, and neither velocities nor a fit tell its rate: it is undecided"
    return [
        f
        if f.severity or _by_velocities(case, e) is not None
        else replace(f, says=says.format(f.says), answered=False)
        for e, f in zip(case.logs, found, strict=True)
    ]


def clock_of_log(case: Case, log: CheckedLog) -> Finding:
    """What is worst about the clock of one log."""
    overview, units = log.overview, unit_reading(case, log)
    column = log.recording.signals.time
    if overview.step == 0.0:
        says = f"column '{column}' never increases: it is not a clock"
        fix = Fix("set time = ... under [signals] to the log's clock")
        return Finding.wrong(says, "median step 0 s", fix=fix)
    if out_of_order(log):
        count, backward = len(overview.stamps) - 1, int(np.sum(np.diff(overview.stamps) < 0.0))
        return Finding.wrong(
            f"rows are not in the order of time: it decreases at {backward} of {count} steps",
            f"{percent_of(backward / count)} of the steps backward, at most "
            f"{100.0 * BACKWARD_SHARE:g} % allowed",
            fix=Fix(f"sort the rows by '{column}'"),
        )
    step, steps = overview.step * units.second, np.diff(overview.stamps) * units.second
    if units.time_unit == ROW:
        return _other_rate(log, units)
    if units.second != 1.0:
        unit, declared = units.time_unit, overview.step
        return Finding.wrong(
            f"time stamps are in {unit}: the time step would be {declared:.4g} s as declared, and "
            f"is {_time(step)}",
            f"step of {declared:.4g} s as declared, logs have {SHORTEST_STEP:g} to "
            f"{LONGEST_STEP:g} s",
            fix=Fix(f"declare time in {unit}", (Edit(("signals", "time_unit"), unit),)),
            picture=Picture("step [s]", "rows", (histogram("steps", steps),)),
        )
    found = _judged(step, steps, overview.stamps, overview.jitter)
    leaps = leaping_rows(log)
    if found.severity is Severity.OK and leaps is not None:
        return _leaps_found(leaps, step)
    if column == ROW:
        found = replace(found, says=f"{found.says}, as declared: the log has no column of time")
    return found


@remembered
def out_of_order(log: CheckedLog) -> bool:
    """Whether rows are not in the order of time, so that nothing is known of rates or motion."""
    steps = np.diff(log.overview.stamps)
    return bool(np.any(steps > 0.0) and np.count_nonzero(steps < 0.0) > BACKWARD_SHARE * len(steps))


@remembered
def leaping_rows(log: CheckedLog) -> Leaps | None:
    """Leaps of all joints though stamps go on evenly; `None` if there are hardly any.

    Rows that repeat all positions are left out before.
    """
    overview = log.overview
    t, q = overview.t, overview.q
    if not overview.moves:
        return None
    fresh = np.flatnonzero(np.concatenate(([True], (np.diff(q, axis=0) != 0.0).any(axis=1))))
    if len(fresh) < 8 * STEPS_AROUND_LEAP:
        return None
    duration = np.diff(t[fresh])
    velocity = np.diff(q[fresh], axis=0) / duration[:, None]
    size = np.sqrt(np.mean(np.square(velocity), axis=0))
    velocity = velocity[:, size > 0.0] / size[size > 0.0]
    windows = np.lib.stride_tricks.sliding_window_view(velocity, 2 * STEPS_AROUND_LEAP + 1, axis=0)
    around = np.median(np.delete(windows, STEPS_AROUND_LEAP, axis=2), axis=2)
    inner = velocity[STEPS_AROUND_LEAP:-STEPS_AROUND_LEAP]
    square = np.sum(np.square(around), axis=1)
    factor = np.sum(inner * around, axis=1) / np.maximum(square, 1e-300)
    left = np.linalg.norm(inner - factor[:, None] * around, axis=1)
    moving = square > SLOW_LEAP_SHARE**2 * velocity.shape[1]
    alike = left <= COMMON_LEAP_RESIDUE * np.linalg.norm(inner, axis=1)
    missing = factor[moving & (factor >= LEAP_FACTOR) & alike] - 1.0
    count = int(np.count_nonzero(moving))
    if len(missing) < DOUBTFUL_GAPS or missing.sum() < DOUBTFUL_MISSING * count:
        return None
    slow = moving & (factor <= 1.0 / LEAP_FACTOR)
    rows = duration[STEPS_AROUND_LEAP:-STEPS_AROUND_LEAP] / np.median(np.diff(t))
    return Leaps(missing, float(np.sum((1.0 - factor[slow]) * rows[slow])), count)


def _leaps_found(leaps: Leaps, step: float) -> Finding:
    missing = leaps.missing
    share = float(missing.sum()) / max(leaps.moving, 1)
    typical = float(np.median(missing))
    leap = (
        f"at {len(missing)} places all joints jump ahead simultaneously, by {typical:.2g} rows "
        "typically"
    )
    if leaps.made_up:
        return Finding.doubtful(
            f"samples are of uneven times though time stamps are uniform: {leap}; at others they "
            "lag behind by as much. No row is missing: a loop that logs the latest message does "
            "so. This is noise of positions and efforts in motion",
            f"jumps ahead of {_time(step * float(missing.sum()))} in all and lags of "
            f"{_time(step * leaps.late)}; less than half as much where rows are missing",
            fix=Fix("log each message when it comes, with its own time stamp"),
        )
    return Finding.of(
        Severity.WRONG if share >= MUCH_MISSING else Severity.DOUBTFUL,
        f"rows are missing though time stamps are uniform: {leap}; "
        f"{_time(step * missing.sum())} in all. Time stamps were made uniform after rows were lost",
        f"{percent_of(share)} of the rows in motion are missing (at most "
        f"{100.0 * DOUBTFUL_MISSING:g} % allowed)",
        fix=Fix("log the controller's own time stamps, and do not change them"),
    )


def _other_rate(log: CheckedLog, units: UnitReading) -> Finding:
    scale, declared = 1.0 / units.second, 1.0 / log.recording.signals.time_scale
    rate = float(f"{scale * declared:.6g}")
    sure = abs(scale - 1.0) > MOST_OFF
    return Finding.of(
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"at the declared {declared:.4g} Hz velocities are {scale:.3g} times d(q)/dt: the rate is "
        f"{rate:.4g} Hz" + ("" if sure else ", or the unit of velocities is off"),
        f"declared rate {100.0 * abs(units.second - 1.0):.3g} % off, at most "
        f"{100.0 * RATE_TOLERANCE:g} % allowed",
        fix=Fix(f"declare the rate of {rate:.4g} Hz", (Edit(("signals", "rate"), rate),)),
    )


def _judged(step: float, steps: Array, stamps: Array, jitter: float) -> Finding:
    """The worst that is wrong with a clock whose unit is right, by its median step and all [s].

    With a histogram of the steps; of few long ones, when they come.
    """
    count, long = max(len(steps), 1), steps[steps > GAP_STEPS * step]
    backward, repeats = int(np.count_nonzero(steps < 0.0)), int(np.count_nonzero(steps == 0.0))
    unbridged, facts = int(np.count_nonzero(long > GAP_SECONDS)), _facts(step, steps, jitter)
    often = len(long) >= 3 and len(long) >= GAPS_PER_ROW * len(steps)
    missing = unbridged > 0 or len(long) >= DOUBTFUL_GAPS or often
    value = f"jitter {percent_of(jitter)} of the step, at most {100.0 * JITTER_LIMIT:g} % allowed"
    picture = Picture("step [s]", "rows", (histogram("steps", steps),))
    if missing:
        at = steps > LATE_STEP * step
        gaps = trace("steps that miss rows", (stamps[1:] - stamps[0])[at], steps[at], "points")
        picture = Picture("time [s]", "step [s]", (gaps,))
    if backward:
        says, value = f"time decreases at {backward} rows", f"{backward} of {count} steps backward"
        value += ", none allowed"
        fix = "log the controller's own clock, not the arrival of messages, or sort the rows"
    elif missing:
        says = (
            f"rows are missing: {len(long)} gaps, the longest of {_time(float(long.max()))}, "
            f"{_time(float((long - step).sum()))} in all"
        )
        value = f"{len(long)} steps longer than {GAP_STEPS:g} median ones, {unbridged} of them not "
        value += "bridged"
        fix = "find out why rows are lost; the parts between gaps are used separately"
    elif jitter >= JITTER_LIMIT:
        says, fix = (
            "time stamps jitter",
            "log the controller's own clock, not the arrival of messages",
        )
    elif repeats > REPEATED_STAMP_SHARE * count:
        says = f"{repeats} rows have the stamp of the row before"
        value = (
            f"{percent_of(repeats / count)} of the stamps repeat, at most "
            f"{100.0 * REPEATED_STAMP_SHARE:g} % allowed"
        )
        fix = "log stamps with more digits; rows that repeat a stamp are dropped"
    else:
        return Finding.ok(facts, value, picture=picture)
    return Finding.doubtful(f"{says}; {facts}", value, fix=Fix(fix), picture=picture)


def _facts(step: float, steps: Array, jitter: float) -> str:
    forward = steps[steps > 0.0]
    mean = float(np.mean(forward[forward < LATE_STEP * step]))
    low, high = np.quantile(forward, [0.01, 0.99])
    words = f"{1.0 / mean:.4g} Hz, steps "
    if high - low <= 1e-3 * step:
        return words + f"of {_time(step)}, uniform"
    longest = f", the longest {_time(float(forward.max()))}" if forward.max() > 1.5 * high else ""
    usual = f"{_time(float(low))} to {_time(float(high))} (98 % of them)"
    return f"{words}{usual}{longest}, jitter {_time(jitter * step)}"


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"


TRIED_SCALE = 0.05  # relative scale that is tried first to both sides
VARIANCE_FALL = 0.045  # fall of the logarithm of the variance there from which on others are tried
TRIED_SCALES = np.log([0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.25, 1.43, 1.67, 2.0])
DOUBTFUL_SCALE_SHARE, WRONG_SCALE_SHARE, LEAST_SCALE_ERROR = 0.5, 0.9, 0.005
"""Share of the typical squared residual that a scale must explain to be doubtful, and wrong, and
its least distance from 1. Nine real robots have at most 0.04; a link that is 50 % longer than its
model 0.8, for its length stands in the torque of accelerations alone."""
SHARP_SCALE_STD = 0.01
"""Largest standard deviation of a scale [relative]: where no scale fits, the residual falls on."""
ROW_WEIGHT_ROUNDS = 10  # iterations of the rows' weights


@dataclass(frozen=True, eq=False)
class _Scaled(Run):
    """A run with time read in other seconds: the motion is so many times as fast."""

    factor: float = 1.0

    def blocks(self, size: int = BLOCK_SAMPLES) -> Iterator[Block]:
        for block in super().blocks(size):
            yield replace(block, dq=self.factor * block.dq, ddq=self.factor**2 * block.ddq)


def _by_scale(regressor: Regressor, run: Run) -> Callable[[float], tuple[float, float]]:
    """Logarithm of the typical residual variance, and samples, by the logarithm of the scale."""
    values = {f.name: getattr(run, f.name) for f in fields(Run)}

    @cache
    def variance(x: float) -> tuple[float, float]:
        information = gather(regressor, _Scaled(**values, factor=float(np.exp(x))))
        fit = WeightedLeastSquares(rounds=ROW_WEIGHT_ROUNDS).fit(information)
        samples = float(information.n_samples.sum())
        return float(information.n_samples @ np.log(fit.variances) / samples), samples

    return variance


def time_scale(case: Case) -> tuple[Finding | None, bool]:
    """The scale of the clock that the longest log without velocities suggests, if it is not 1.

    And whether a fit confirms that it is: on both sides of 1 the residual variance rises.
    """
    signals = case.loaded.signals
    if signals is None or signals.velocity is not None:
        return None, False
    try:
        found = case.longest_run(lambda log: driven_joints(case, log).sum() >= FEWEST_RATE_JOINTS)
        if found is None:
            return None, False
        checked, run = found
        variance = _by_scale(case.regressor, run)
        now, samples = variance(0.0)
        rise = min(variance(x)[0] for x in (TRIED_SCALE, -TRIED_SCALE)) - now
        if rise > -VARIANCE_FALL:
            return None, rise > VARIANCE_FALL
        x, std = likeliest(
            lambda grid: np.array([-0.5 * samples * variance(x)[0] for x in grid.tolist()]),
            TRIED_SCALES,
        )
        gone = 1.0 - float(np.exp(variance(x)[0] - now))
    except (SteelyardError, TypeError):
        return None, False
    if (
        gone < DOUBTFUL_SCALE_SHARE
        or std > SHARP_SCALE_STD
        or abs(x) < max(LEAST_SCALE_ERROR, 4.0 * std)
    ):
        return None, False
    scale, half = float(np.exp(x)), 2.0 * std * float(np.exp(x))
    sure, way = gone >= WRONG_SCALE_SHARE, "slow" if scale < 1.0 else "fast"
    other = "" if sure else ", or a length in the model file is wrong"
    finding = Finding.of(
        Severity.WRONG if sure else Severity.DOUBTFUL,
        f"the clock runs {way}{other}: by a fit of {checked.name} time stamps are {scale:.4g} ± "
        f"{half:.1g} times the true time, as only then accelerations and gravity give the same "
        "inertial parameters",
        f"this explains {100.0 * gone:.0f} % of the squared residual; doubtful from "
        f"{100.0 * DOUBTFUL_SCALE_SHARE:.0f} % on, wrong from {100.0 * WRONG_SCALE_SHARE:.0f} % on",
        fix=Fix(
            f"check the log's rate; divide the stamps by {scale:.4g} if it is so. If the clock is "
            "right, check gravity and lengths in the model file"
        ),
    )
    return finding, False


def _by_velocities(case: Case, log: CheckedLog) -> Array | None:
    """Velocities over derivatives of the reliable joints, if these are so even that a clock is."""
    units = unit_reading(case, log)
    if units.agreement is None:
        return None
    ratio = units.relative[np.flatnonzero(units.agreement.reliable_joints)]
    if len(ratio) < FEWEST_RATE_JOINTS or np.ptp(ratio) > UNEVEN_RATE * np.mean(ratio):
        return None
    return ratio


def time_scale_by_velocities(case: Case, log: CheckedLog) -> Finding | None:
    """The scale of the clock that logged velocities ask for, if all joints agree on one but 1."""
    ratio = _by_velocities(case, log)
    if ratio is None:
        return None
    scale, spread = float(np.mean(ratio)), float(np.ptp(ratio))
    off = abs(scale - 1.0)
    if off <= RATE_TOLERANCE:
        return None
    says = f"velocities of all {len(ratio)} joints are {scale:.4g} times d(q)/dt: "
    even = f"(a clock: at most {100.0 * UNEVEN_RATE:g} %)"
    if off <= MOST_OFF:
        way = "slow" if scale < 1.0 else "fast"
        return Finding.doubtful(
            f"{says}the clock runs {way}, or their unit is off",
            f"{100.0 * off:.2g} % from 1 (at most {100.0 * RATE_TOLERANCE:g} % allowed), "
            f"joints differ by {100.0 * spread:.1g} % {even}",
            fix=Fix("check the log's rate, and leave velocities out if the clock is right"),
            log=log.name,
        )
    step = unit_reading(case, log).second * log.overview.step
    far, near = ("far apart", scale) if scale > 1.0 else ("near", 1.0 / scale)
    rates = (float(f"{scale / step:.{digits}g}") for digits in (1, 2, 3))
    rate = next((x for x in rates if abs(x * step / scale - 1.0) < spread / scale), scale / step)
    return Finding.wrong(
        f"{says}time stamps are {near:.3g} times too {far}: the step is {_time(step / scale)}, not "
        f"{_time(step)}, if velocities are in the declared unit",
        f"joints differ by {100.0 * spread / scale:.1g} % {even}",
        fix=Fix(
            f"correct the time column, or use [signals] rate = {rate:.4g} instead of it; "
            "if the clock is right, leave velocities out"
        ),
        log=log.name,
    )
