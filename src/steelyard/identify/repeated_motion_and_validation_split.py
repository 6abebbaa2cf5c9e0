r"""Whether a run repeats the motion, or the rows, of another one; which logs are fitted.

Some rows of the other run are looked for in the run: at the shift in time at which most of them
are met by all joints at once. Repeated motion has other efforts, for it has noise of its own; rows
with the same positions and efforts are the same log, trimmed, thinned, shifted or rounded. Where
joints were given other zeros meanwhile, or the base was turned, velocities meet and positions up to
a constant per joint; efforts then decide whether it is the same motion of the same arm. No rows are
both fitted and validate.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, inf

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, SteelyardError
from steelyard.base.progress import silent
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.score import RunScore
from steelyard.logs.log_and_errors import Cut
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.runs import run as motion
from steelyard.runs.recording import Recording
from steelyard.runs.rows.clock_and_row_scan import learn_clock
from steelyard.runs.runs_of_named_logs import log_files, recording_of, runs_of, signals_of


def marked_repeats(
    identified: IdentifiedModel, runs: Sequence[motion.Run], scores: Sequence[RunScore]
) -> tuple[RunScore, ...]:
    """The scores of runs that were not fitted, with the fitted run whose motion each repeats."""
    each = zip(scores, (repeat_of(identified.motions, run) for run in runs), strict=True)
    return tuple(
        score if repeat is None else replace(score, repeats=repeat.run) for score, repeat in each
    )


RATE, MOST_INSTANTS = 200.0, 60_000  # of shifts that are tried [Hz]; of the run
NEAR, CLOSE, LEAST_NEAR = 0.03, 0.01, 1e-3
"""Distance, over a joint's range, up to which rows may meet, and do once the shift is exact; at
least so much [rad; m]."""
REPEATED_RUN_SHARE = 0.2  # share of a run's motion from which on it is repeated
FEWEST, CHANCE = 8, 5.0  # rows that must meet; standard deviations above chance
EXACT = 1e-5  # distance of one row's channels over their range: what six digits keep
SAME = 0.03  # share of the rows that meet from which on they are rows of the same log
REPEATED_EFFORT_DISTANCE = 0.3
"""Distance of the efforts of a motion with other zeros, over their standard deviation, at most: the
same motion in another posture has other gravity."""
AROUND = 3  # rows on each side among which the same one is looked for


@dataclass(frozen=True)
class Repeat:
    """A run that has been seen before."""

    run: str  # name of the run that it repeats
    share: float  # share of its motion that does
    shift: float  # how much later it is [s]
    distance: float  # largest rms distance of a joint's positions, over its range
    same: bool  # whether rows are those of that run
    zeros: bool = False  # whether positions meet only up to a constant per joint

    @property
    def words(self) -> str:
        """In a few words: of which run, how much, and how close."""
        what = "contains rows of" if self.same else "repeats the motion of"
        return (
            f"{what} {self.run} ({100.0 * self.share:.0f} % of its motion, "
            f"{self.shift:.4g} s later, to {100.0 * self.distance:.1g} % of the joints' range"
            f"{', with other zeros of joints' if self.zeros else ''})"
        )


def repeat_of(known: Sequence[motion.MotionSamples], run: motion.Run) -> Repeat | None:
    """The known run, in the same units, that a run repeats most; `None` if it repeats none."""
    rows = motion.motion_rows(run)
    if not rows.moving.any() or len(rows.t) < 2 * AROUND:
        return None
    found = [r for one in known if (r := _repeat(one, rows)) is not None]
    return max(found, key=lambda r: (r.same, r.share), default=None)


def repeat_within(run: motion.Run, middle: float, stop: float) -> Repeat | None:
    """How far a run's end, from `middle` to `stop` [s], repeats what was before; `None` if not."""
    rows = motion.motion_rows(run)
    early, end = rows.where(rows.t < middle), rows.where((rows.t >= middle) & (rows.t <= stop))
    if not len(early.t) or not end.moving.any() or len(end.t) < 2 * AROUND:
        return None
    return _repeat(motion.samples_of_rows(run.name, early), end)


def _repeat(known: motion.MotionSamples, rows: motion.MotionRows) -> Repeat | None:
    if len(known.t) < FEWEST or known.q.shape[1] != rows.q.shape[1]:
        return None
    span = np.maximum(np.ptp(known.q, axis=0), LEAST_NEAR)
    shift = _shift(known, rows, np.maximum(NEAR * span, LEAST_NEAR))
    found = None if shift is None else _met(known, rows, _refined(known, rows, shift, span))
    return found or _with_other_zeros(known, rows)


def _met(known: motion.MotionSamples, rows: motion.MotionRows, shift: float) -> Repeat | None:
    """The repetition at one shift, if enough rows meet."""
    span = np.ptp(known.q, axis=0)
    at, off, met = _near(known, rows, shift)
    moving = float(np.count_nonzero(rows.moving)) * float(np.median(np.diff(rows.t)))
    share = min(1.0, len(met) * known.step / max(moving, 1e-9))
    if len(met) < FEWEST or share < REPEATED_RUN_SHARE:
        return None
    rms = np.sqrt(np.mean(np.square(off[met]), axis=0)) / np.maximum(span, LEAST_NEAR)
    before = np.column_stack((known.q[met], known.effort[met]))
    tolerance = EXACT * np.ptp(np.column_stack((known.q, known.effort)), axis=0) + 1e-12
    nearest = np.searchsorted(rows.t, at[met])
    again = np.zeros(len(met), dtype=np.bool_)
    for step in range(-AROUND, AROUND + 1):
        row = np.clip(nearest + step, 0, len(rows.t) - 1)
        now = np.column_stack((rows.q[row], rows.effort[row]))
        again |= (np.abs(now - before) <= tolerance).all(axis=1)
    same = int(again.sum()) >= max(2.0, SAME * len(met))
    return Repeat(known.run, share, shift, float(rms.max()), same)


def _near(
    known: motion.MotionSamples, rows: motion.MotionRows, shift: float
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Instants of the known rows in the run, distances of positions there, and rows that meet."""
    at = known.t + shift
    off = _at(at, rows.t, rows.q) - known.q
    close = np.maximum(CLOSE * np.ptp(known.q, axis=0), LEAST_NEAR)
    inside = (at >= rows.t[0]) & (at <= rows.t[-1])
    return at, off, np.flatnonzero(inside & (np.abs(off) <= close).all(axis=1))


def _with_other_zeros(known: motion.MotionSamples, rows: motion.MotionRows) -> Repeat | None:
    """The same, of velocities: the zeros of positions may differ."""
    steps = np.diff(known.t)
    wide = float(np.median(steps))
    pairs = np.flatnonzero(steps < 1.5 * wide)
    if len(pairs) < FEWEST or wide <= 0.0:
        return None
    slopes = np.diff(known.q, axis=0)[pairs] / steps[pairs, None]
    mean = replace(known, t=known.t[pairs] + 0.5 * steps[pairs], q=slopes)
    late, early = (_at(rows.t + d, rows.t, rows.q) for d in (0.5 * wide, -0.5 * wide))
    moved = replace(rows, q=(late - early) / wide)
    least = LEAST_NEAR / wide
    span = np.maximum(np.ptp(slopes, axis=0), least)
    shift = _shift(mean, moved, np.maximum(NEAR * span, least))
    if shift is None:
        return None
    shift = _refined(mean, moved, shift, span)
    at = known.t + shift
    inside = (at >= rows.t[0]) & (at <= rows.t[-1])
    if np.count_nonzero(inside) < FEWEST:
        return None
    apart = np.median(_at(at, rows.t, rows.q)[inside] - known.q[inside], axis=0)
    again = replace(known, q=known.q + apart)
    found, size = _met(again, rows, shift), np.std(known.effort, axis=0)
    moved = size > 0.0
    if found is None or not moved.any():
        return None
    at, _, met = _near(again, rows, shift)
    off = _at(at[met], rows.t, rows.effort) - known.effort[met]
    parts = np.mean(np.square(off), axis=0)[moved] / np.square(size[moved])
    alike = float(np.sqrt(parts.mean())) <= REPEATED_EFFORT_DISTANCE
    return replace(found, zeros=True) if alike else None


def _shift(known: motion.MotionSamples, rows: motion.MotionRows, near: Array) -> float | None:
    """The shift at which most rows meet; `None` if that may be chance [s]."""
    grid = np.arange(rows.t[0], rows.t[-1], 1.0 / RATE)[:MOST_INSTANTS]
    columns = np.ascontiguousarray(_at(grid, rows.t, rows.q).T)
    offsets = np.round((known.t - known.t[0]) * RATE).astype(int)
    counts = np.zeros(len(grid) + int(offsets[-1]))
    expected = 0.0
    for offset, instant in zip(offsets, known.q, strict=True):
        meets = np.flatnonzero(np.abs(columns[0] - instant[0]) <= near[0])
        for j in range(1, len(columns)):
            meets = meets[np.abs(columns[j][meets] - instant[j]) <= near[j]]
        counts[int(offsets[-1] - offset) + meets] += 1.0
        expected += len(meets) / len(grid)
    best = int(np.argmax(counts))
    if counts[best] < max(FEWEST, expected + CHANCE * np.sqrt(expected + 1.0)):
        return None
    return float(grid[0] + (best - offsets[-1]) / RATE - known.t[0])


def _refined(
    known: motion.MotionSamples, rows: motion.MotionRows, shift: float, span: Array
) -> float:
    """The shift of least distance near one, by Gauss-Newton steps over the rows that meet [s]."""
    half = 0.5 / RATE
    for _ in range(5):
        at = known.t + shift
        inside = (at >= rows.t[0] + half) & (at <= rows.t[-1] - half)
        early, late = (_at(at + d, rows.t, rows.q) for d in (-half, half))
        off = (0.5 * (early + late) - known.q) / span
        slope = (late - early) * RATE / span
        inside &= (np.abs(off) <= NEAR + half * np.abs(slope)).all(axis=1)
        steep = float(np.sum(np.square(slope[inside])))
        if steep <= 0.0:
            return shift
        shift -= float(np.sum(off[inside] * slope[inside])) / steep
    return shift


def _at(t: Array, times: Array, values: Array) -> Array:
    """Values at other times, shape `(len(t), n)`."""
    return np.column_stack([np.interp(t, times, column) for column in values.T])


FITTED_SHARE = 0.7  # share of a single log that is fitted; the rest validates
SHORTEST_CUT_LOG = 5.0  # duration from which on a log is long enough for that [s]
NEAR_END = 2.0  # time before a log's end up to which the end of its motion is not reported [s]
MOST_STEPS = 3.0  # duration over rows times median step: a last time beyond is not believed


@dataclass(frozen=True)
class ProposedCut:
    """Logs and windows of them as arguments of a command."""

    logs: tuple[str, ...]  # logs to identify from; the last one validates, if there are several
    ends: str = ""  # why the last window ends before the log does; empty if it does not


def propose_cut(loaded: LoadedRobot, logs: Sequence[str]) -> ProposedCut:
    """Logs to identify from, the last to validate: of a single one two windows in its own seconds.

    A single log is left whole if it is cut by rows, or its motion is shorter than
    `SHORTEST_CUT_LOG`. The second window ends with the motion, and where the motion is repeated,
    with its first round: a motion that was fitted validates nothing.
    """
    if len(logs) != 1:
        return ProposedCut(tuple(logs))
    log, *more = log_files(logs)
    if more:  # episodes of a dataset, together as two windows of rows
        rows = [one.cut.rows for one in (log, *more)]
        first, end = rows[0][0], rows[-1][1] or rows[-1][0]
        middle = first + FITTED_SHARE * (end - first)
        border = min((row for row, _ in rows[1:]), key=lambda row: abs(row - middle))
        return ProposedCut((f"{log.path}#{first}:{border}", f"{log.path}#{border}:{end}"))
    cut = log.cut
    if cut.rows != Cut().rows:
        return ProposedCut((log.text,))
    signals = signals_of(loaded, log)[0]
    start = max(0.0, cut.seconds[0])
    stop = min(cut.seconds[1], _duration(recording_of(log, signals)))
    if not SHORTEST_CUT_LOG <= stop - start < inf:
        return ProposedCut((log.text,))
    begin, ends = start, ""
    try:
        ((run,), _) = runs_of(loaded, signals, [log], (), silent)
    except SteelyardError:
        pass
    else:
        begin = max(begin, run.span[0])
        whole, moves = stop, min(stop, run.span[1])
        stop, shift = moves, inf
        while shift > 0.0:  # the motion ends where it begins anew
            repeat = repeat_within(run, begin + FITTED_SHARE * (stop - begin), stop)
            shift = 0.0 if repeat is None or repeat.shift >= stop - begin else repeat.shift
            stop = begin + shift if shift > 0.0 else stop
        if stop < whole - NEAR_END:
            why = "the motion repeats" if stop < moves else "no joint moves"
            ends = f"rows after {0.1 * ceil(10.0 * stop):.10g} s are left out: {why}"
    if stop - begin < SHORTEST_CUT_LOG:
        return ProposedCut((log.text,))
    middle = begin + FITTED_SHARE * (stop - begin)
    a, b, c = floor(10.0 * start), floor(10.0 * middle), ceil(10.0 * stop)
    windows = ((a, b), (b, c))
    return ProposedCut(tuple(f"{log.path}@{0.1 * m:.10g}:{0.1 * n:.10g}" for m, n in windows), ends)


def _duration(recording: Recording) -> float:
    """Time from the first good row to the last row with a time [s]; infinite if that is absurd."""
    signals, clock, rows, last = recording.signals, learn_clock(recording), 0, 0.0
    for part in recording.log.parts((signals.time,)):
        times = part[np.isfinite(part[:, 0]), 0]
        rows += len(part)
        last = float(times[-1]) if len(times) else last
    duration = last * signals.time_scale - clock.origin
    return duration if duration < MOST_STEPS * rows * clock.step else inf


def refuse_same_rows(fitted: Sequence[motion.Run], unseen: Sequence[motion.Run]) -> None:
    """The same rows neither count twice in a fit nor test it, whatever their log is called."""
    known, role = motion.motion_samples(fitted), "they would count twice in the fit"
    pairs = [(run, known[:number], role) for number, run in enumerate(fitted)]
    pairs += [(run, known, "they would be both fitted and validated") for run in unseen]
    for run, others, role in pairs:
        repeat = repeat_of(others, run)
        if repeat is not None and repeat.same:
            wrong = f"'{run.name}' holds the same samples as '{repeat.run}': {role}"
            fix = "give every part once; cut a log with LOG@START:STOP"
            raise LogError(wrong, where=f"{run.name} {repeat.words}", fix=fix)
