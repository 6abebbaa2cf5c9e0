"""Time sorted out: repeats, steps backward, gaps; what a row's neighbours say about it.

Consecutive rows are linked when time goes forward by no more than a gap and no joint moves faster
than a joint can. Linked rows form chains. A chain that continues what was kept before it is kept;
another one starts a new segment if it is long enough to be a log and not memory garbage.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import Cut, RowRange
from steelyard.runs.recording import Recording, rows_left_out
from steelyard.runs.rows.faulty_row_detectors import (
    FASTEST_LOGGED_SPEED,
    FASTEST_STEADY_SPEED,
    RowVerdict,
    broken_rows,
)

SHORTEST_CHAIN = 10  # rows that must follow each other plausibly before a new segment is believed
ROWS_FOR_STEP = 20_000  # rows from which the clock's step is learnt
FORWARD_SHARE = 0.9  # share of the steps of a clock that are forward
GAP_STEPS, GAP_SECONDS = 5.0, 0.05
"""A longer step than both (5 steps, 0.05 s) is a gap. Shorter ones, such as lost packets of a 1 kHz
log, are bridged by the interpolation, whose error there is that of a 20 Hz log."""
Rowed = NDArray[np.int64]
NICE_STEPS = (1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0, 12.5)


@dataclass(frozen=True)
class Clock:
    """What the head of a log says about its clock: median step, longest step that is no gap [s].

    The origin is the time of the first good row [s].
    """

    step: float
    gap: float
    origin: float = 0.0


@dataclass(frozen=True, eq=False)
class RowPiece:
    """Good rows of a segment that follow each other: time `(N,)` [s], channels `(N, C)`."""

    segment: int
    t: Array
    x: Array


def learn_clock(recording: Recording) -> Clock:
    """Step and origin of a log's clock, from its head."""
    times = _head_times(recording)
    if len(times) == 1:
        raise LogError(
            "the log has one row",
            where=recording.where,
            fix="record for longer, or widen the window",
        )
    steps = np.diff(times)
    forward = steps[steps > 0.0]
    if len(forward) == 0 or 2 * len(forward) < np.count_nonzero(steps):
        raise not_increasing(recording)
    step = float(np.median(forward))
    clock = Clock(step, max(GAP_STEPS * step, GAP_SECONDS))
    scan = RowScan(clock, replace(recording, cut=Cut()))
    for piece in scan.pieces((0, ROWS_FOR_STEP)):
        return Clock(clock.step, clock.gap, float(piece.t[0]))
    raise nothing_left(recording, scan.counts)


def _head_times(recording: Recording) -> Array:
    parts = [*recording.raw((0, ROWS_FOR_STEP))]
    times = np.concatenate([t for t, _ in parts])
    filled = np.concatenate([~np.isnan(x).all(axis=1) for _, x in parts])
    return np.asarray(times[np.isfinite(times) & (filled if filled.any() else True)])


def nice_rate(mean_step: float) -> float:
    """Sampling rate of the uniform clock [Hz] for a mean step of the log [s].

    The rate of the log rounded up to a round number (100 Hz for steps that alternate between 10
    and 12 ms), so that nothing in its band is lost and runs of one controller share a rate; the
    rate itself if the next round number is more than 10 % above it.
    """
    rate = 1.0 / mean_step
    decade = 10.0 ** np.floor(np.log10(rate))
    nice = min(n * decade for n in NICE_STEPS if n * decade >= 0.99 * rate)
    return float(nice if nice <= 1.1 * rate else rate)


class RowScan:
    """One pass over the rows of a recording's window."""

    def __init__(self, clock: Clock, recording: Recording) -> None:
        self.counts = np.zeros(len(RowVerdict), dtype=np.int64)
        self._clock, self._recording = clock, recording
        self._start, self._stop = recording.cut.seconds
        self._first_row: int | None = 0 if self._start == -np.inf else None
        self._before = -np.inf
        self._last: tuple[float, Array] | None = None
        self._segment = -1

    def pieces(self, rows: RowRange | None = None) -> Iterator[RowPiece]:
        """Good rows in the window, in order, part by part."""
        channels = self._recording.channels
        rows = self._recording.cut.rows if rows is None else rows
        undecided = np.zeros(0), np.zeros((0, channels.count)), np.zeros(0, dtype=np.int64)
        at = rows[0]
        for t, x in self._recording.raw(rows):
            row = np.arange(at, at + len(t))
            at += len(t)
            verdict = broken_rows(t, x, channels)
            verdict[verdict == RowVerdict.KEPT] = self._repeated(t[verdict == RowVerdict.KEPT])
            t = t - self._clock.origin
            if self._recording.left_out:
                out = rows_left_out(t, self._recording.left_out)
                verdict[(verdict == RowVerdict.KEPT) & out] = RowVerdict.LEFT_OUT
            good = verdict == RowVerdict.KEPT
            loose = row[~good], verdict[~good]
            if len(loose[0]):
                t, x, row = t[good], x[good], row[good]
            if len(undecided[0]):
                both = zip(undecided, (t, x, row), strict=True)
                t, x, row = (np.concatenate(pair) for pair in both)
            decided = yield from self._decided(t, x, row, loose, final=False)
            undecided = t[decided:], x[decided:], row[decided:]
            if self._last is not None and self._last[0] >= self._stop:
                return
        none = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.uint8)
        yield from self._decided(*undecided, none, final=True)

    def _repeated(self, t: Array) -> NDArray[np.uint8]:
        """`REPEATED` for rows with the time of the row before, `KEPT` for others."""
        if len(t) == 0:
            return np.zeros(0, dtype=np.uint8)
        same = np.diff(t, prepend=self._before) == 0.0
        self._before = float(t[-1])
        return np.where(same, RowVerdict.REPEATED, RowVerdict.KEPT).astype(np.uint8)

    def _decided(
        self, t: Array, x: Array, row: Rowed, loose: tuple[Rowed, NDArray[np.uint8]], *, final: bool
    ) -> Generator[RowPiece, None, int]:
        """Judge rows by their neighbours, count them and yield the pieces; how many were decided.

        `loose`: number and verdict of rows broken by themselves; `final`: no rows come after these.
        """
        verdict, segment, decided = self._judge(t, x, final)
        kept = np.flatnonzero(verdict[:decided] == RowVerdict.KEPT)
        inside = kept[(t[kept] >= self._start) & (t[kept] < self._stop)]
        if self._first_row is None and len(inside):
            self._first_row = int(row[inside[0]])
        if self._first_row is not None:
            past = row[kept[t[kept] >= self._stop]]
            every = np.concatenate((row[:decided], loose[0]))
            counted = (every >= self._first_row) & (every < (past[0] if len(past) else np.inf))
            judged = np.concatenate((verdict[:decided], loose[1]))[counted]
            self.counts += np.bincount(judged, minlength=len(RowVerdict))
        for run in np.split(inside, np.flatnonzero(np.diff(segment[inside])) + 1):
            if len(run):
                start, stop = int(run[0]), int(run[-1]) + 1
                at = slice(start, stop) if stop - start == len(run) else run
                yield RowPiece(int(segment[start]), t[at], x[at])
        return decided

    def _judge(self, t: Array, x: Array, final: bool) -> tuple[NDArray[np.uint8], Rowed, int]:
        """Verdict and segment of every row, and how many rows can be judged yet."""
        verdict = np.zeros(len(t), dtype=np.uint8)
        segment = np.full(len(t), -1)
        for start, stop in self._chains(t, x):
            if not self._continues(t[start], x[start]):
                last = -np.inf if self._last is None else self._last[0]
                ahead = start + int(np.searchsorted(t[start:stop], last, side="right"))
                verdict[start:ahead] = RowVerdict.BACKWARD
                start = ahead
                if start == stop:
                    continue
                if not self._continues(t[start], x[start]):
                    if stop - start < SHORTEST_CHAIN and not (final and self._last is None):
                        if stop == len(t) and not final:
                            return verdict, segment, start
                        verdict[start:stop] = RowVerdict.JUMP
                        continue
                    self._segment += 1
            segment[start:stop] = self._segment
            self._last = float(t[stop - 1]), x[stop - 1].copy()
        return verdict, segment, len(t)

    def _chains(self, t: Array, x: Array) -> Iterator[tuple[int, int]]:
        """First row and the row after the last one of every chain of linked rows."""
        if len(t) == 0:
            return
        q = x[:, self._recording.channels.encoders]
        with np.errstate(over="ignore"):
            step = np.diff(t)
            reach = self._reach(step)
        linked = (step > 0.0) & (step <= self._clock.gap)
        linked &= (np.abs(np.diff(q, axis=0)) <= reach[:, None]).all(axis=1)
        ends = [*(np.flatnonzero(~linked) + 1).tolist(), len(t)]
        yield from zip([0, *ends[:-1]], ends, strict=True)

    def _continues(self, t: float, x: Array) -> bool:
        """Whether a row can come right after the last one that was kept."""
        if self._last is None:
            return False
        step, q = t - self._last[0], self._recording.channels.encoders
        near = np.abs(x[q] - self._last[1][q]) <= self._reach(np.array(step))
        return 0.0 < step <= self._clock.gap and bool(near.all())

    def _reach(self, step: Array) -> Array:
        """How far a joint can get in a step [rad; m]."""
        once = self._clock.step
        return FASTEST_LOGGED_SPEED * once + FASTEST_STEADY_SPEED * np.maximum(step - once, 0.0)


def nothing_left(recording: Recording, counts: NDArray[np.int64]) -> LogError:
    """The error for a recording of which no row can be used."""
    dropped = counts.copy()
    dropped[RowVerdict.KEPT] = 0
    if dropped.sum() == 0:
        return no_row(recording)
    worst = RowVerdict(int(np.argmax(dropped)))
    if worst >= RowVerdict.REPEATED:
        return not_followed(recording, dropped)
    return LogError(
        f"every row of the log is invalid: {dropped[worst]} of {dropped.sum()} rows hold "
        f"{worst.reason}",
        where=recording.where,
        fix="check that the columns under [signals] of the robot file hold numbers, and their "
        "units",
    )


def no_row(recording: Recording) -> LogError:
    """The error for a window that holds no row of its log."""
    span, rows = time_span(recording)
    return LogError(
        f"the window {recording.cut.text} holds no row: the log lasts {span:.4g} s ({rows} rows)",
        where=recording.where,
        fix="choose a window within the log; its seconds count from the first row",
    )


def time_span(recording: Recording) -> tuple[float, int]:
    """Latest minus earliest time of a log, whatever its cut [s], and its number of rows."""
    first, last, rows = np.inf, -np.inf, 0
    for t, _ in recording.raw((0, None)):
        known, rows = t[np.isfinite(t)], rows + len(t)
        first = float(known.min(initial=first))
        last = float(known.max(initial=last))
    return max(last - first, 0.0), rows


def rows_between(recording: Recording, seconds: tuple[float, float], most: int) -> tuple[int, int]:
    """First row of a span of seconds from the log's start, and the row after its last one.

    A row counts if the next one is in the span as well: stamps of broken rows may be anything.
    Only the `most` rows from the first one on are of interest.
    """
    origin = learn_clock(recording).origin
    first, after, row, before = None, 0, 0, False
    for t, _ in recording.raw((0, None)):
        there = (t - origin >= seconds[0]) & (t - origin < seconds[1])
        inside = np.concatenate(([before], there))
        pairs = row + np.flatnonzero(inside[:-1] & inside[1:])
        if len(pairs):
            first = int(pairs[0]) - 1 if first is None else first
            after = int(pairs[-1]) + 1
        before, row = bool(inside[-1]), row + len(t)
        if first is not None and row >= first + most:
            break
    return (0, 0) if first is None else (first, after)


def not_followed(recording: Recording, counts: NDArray[np.int64]) -> LogError:
    """The error for a recording most rows of which do not follow from those before."""
    steps = np.diff(_head_times(recording))
    if np.count_nonzero(steps > 0.0) < FORWARD_SHARE * len(steps):
        return not_increasing(recording)
    return LogError(
        f"in {counts[RowVerdict.JUMP]} rows of {counts.sum()} time or positions jump farther "
        "than a robot can move",
        where=recording.where,
        fix="check time_unit, position_unit, and whether positions are of motors (coordinates = "
        '"motor"), under [signals] of the robot file',
    )


def not_increasing(recording: Recording) -> LogError:
    """The error for a time column that is none."""
    if len(_head_times(recording)) == 0:
        return LogError(
            f"column '{recording.signals.time}' holds text, no times",
            where=recording.where,
            fix="export times as numbers, as 2025-03-04T10:00:00.010 or as 10:00:00.010; or state "
            "rate = HZ instead of time",
        )
    return LogError(
        f"column '{recording.signals.time}' does not increase from row to row as time does",
        where=recording.where,
        fix="name the log's clock as time = ... under [signals] of the robot file",
    )
