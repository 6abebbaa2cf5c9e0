"""A log in parts that are processed in memory, each by itself, by the functions for whole logs.

A part is samples of a segment, and the rows that these depend on: with its margins, which filters
look at, it gives what the whole log gives at its samples. Parts do not depend on each other.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.rows.clock_and_row_scan import RowPiece
from steelyard.runs.rows.marked_rows_and_quality import COUNTS_OF_MARKS, RowChecks, Segment
from steelyard.runs.rows.resampling import CUBIC, Lane, Thinning, interpolated, sample_count
from steelyard.runs.smoothing.zero_phase_filters import continued_at_ends

SAMPLES_OF_PART = 8192  # samples of a part; more where margins are long


@dataclass(frozen=True)
class Margin:
    """What a sample depends on: samples around it, rows further back and on [s], rows around these.

    At least `rows_per_sample` rows are brought to one sample.
    """

    samples: int
    before: float
    after: float
    rows: int
    rows_per_sample: int = 1


@dataclass(frozen=True)
class Part:
    """Samples `first` to `stop` of a segment."""

    segment: Segment
    first: int
    stop: int
    begin: float  # time from which on rows are its own and not of the part before [s]
    end: float  # time from which on they are those of the next part [s]
    since: float  # time from which on rows are needed, its margin included [s]
    until: float  # time up to which they are needed [s]
    rows: int  # rows needed around these


def partition(segments: Sequence[Segment], rate: float, margin: Margin) -> list[Part]:
    """The parts of a log, in order of time."""
    parts, around = [], margin.samples
    size = max(SAMPLES_OF_PART // margin.rows_per_sample, 4 * around, 1)
    for segment in segments:
        for first in range(0, segment.samples, size):
            stop = min(first + size, segment.samples)
            begin, end = segment.start + first / rate, segment.start + stop / rate
            since = begin - around / rate - margin.before
            until = end + (around - 1) / rate + margin.after
            if first == 0:
                begin = since = -np.inf
            if stop == segment.samples:
                end = until = np.inf
            parts.append(Part(segment, first, stop, begin, end, since, until, margin.rows))
    return parts


@dataclass(frozen=True, eq=False)
class Window:
    """The rows of a part: time `(N,)` [s] and channels `(N, C)`.

    Rows of the margin that the segment does not have, before and behind, are `lacking`.
    """

    part: Part
    t: Array
    x: Array
    lacking: tuple[int, int]


def windows(pieces: Iterable[RowPiece], parts: Sequence[Part]) -> Iterator[Window]:
    """The rows of each part, of rows that are read from front to back."""
    waiting = {n: list(group) for n, group in groupby(parts, key=lambda p: p.segment.number)}
    for number, of_segment in groupby(pieces, key=lambda piece: piece.segment):
        if number in waiting:
            yield from _of_segment(of_segment, waiting.pop(number))
        if not waiting:
            return


def _of_segment(pieces: Iterator[RowPiece], parts: Sequence[Part]) -> Iterator[Window]:
    held = [next(pieces)]
    for part in parts:
        while sum(len(p.t) - np.searchsorted(p.t, part.until) for p in held) <= part.rows:
            if (piece := next(pieces, None)) is None:
                break
            held.append(piece)
        t, x = held[0].t, held[0].x
        if len(held) > 1:
            t, x = np.concatenate([p.t for p in held]), np.concatenate([p.x for p in held])
        start = int(np.searchsorted(t, part.since, side="right")) - 1 - part.rows
        stop = int(np.searchsorted(t, part.until)) + 1 + part.rows
        lacking = max(0, -start), max(0, stop - len(t))
        start = max(0, start)
        yield Window(part, t[start:stop], x[start:stop], lacking)
        held = [RowPiece(part.segment.number, t[start:], x[start:])]


@dataclass(frozen=True, eq=False)
class ToClock:
    """The rows of a part, checked, to samples of a uniform clock with a rate [Hz].

    Channels are read along `lanes`, behind the low-pass of `thinning` where the clock is slower
    than the log's; below the channels of the log are the flags of its efforts.
    """

    checks: RowChecks
    rate: float
    lanes: Sequence[Lane]
    thinning: Thinning | None = None

    @property
    def factor(self) -> int:
        """Samples that rows are brought to over those that are left."""
        return 1 if self.thinning is None else self.thinning.factor

    @property
    def reach(self) -> float:
        """How far the low-pass before thinning out looks [s]."""
        halo = 0 if self.thinning is None else self.thinning.halo
        return halo / (self.rate * self.factor)

    def margin(self, samples: int) -> Margin:
        """What `samples` on each side of a sample, and itself, depend on."""
        lags = [lane.lag for lane in self.lanes]
        rows = max(lane.kind.margin for lane in self.lanes) + 1
        rows += 0 if self.checks.idle else self.checks.halo
        before, after = self.reach - min(lags), self.reach + max(lags)
        return Margin(samples, before, after, rows, self.factor)

    def __call__(
        self, window: Window, low: int, high: int, counted: tuple[float, float] = (-np.inf, np.inf)
    ) -> tuple[Array, Array]:
        """Channels at samples `low` to `high` of a segment, shape `(C, high - low)`.

        With them come the counts of `Marked` over the part's rows between two times [s].
        """
        part, t, x, marks = window.part, window.t, window.x.T, np.zeros(COUNTS_OF_MARKS)
        if not self.checks.idle:
            t, x, counts = self.checks.applied(t, x, window.lacking)
            own = (t >= max(part.begin, counted[0])) & (t < part.end) & (t <= counted[1])
            marks = counts[:, own].sum(axis=1)
        start, factor, rate = part.segment.start, self.factor, self.rate * self.factor
        if self.thinning is None:
            return interpolated(t, x, start + np.arange(low, high) / rate, self.lanes), marks
        halo = self.thinning.halo
        first, stop = factor * low - halo, factor * (high - 1) + 1 + halo
        count = sample_count(start, part.segment.stop, rate)
        inside = np.arange(max(first, 0), min(stop, count))
        even = interpolated(t, x, start + inside / rate, self.lanes)
        extended = continued_at_ends(even, inside[0] - first, stop - 1 - inside[-1])
        return self.thinning(extended)[:, ::factor], marks


def evenly_sampled(
    pieces: Sequence[RowPiece], channels: slice, rate: float, checks: RowChecks
) -> Array:
    """Checked channels of consecutive rows of one segment on a uniform clock, shape `(C, N)`."""
    first, last = pieces[0], pieces[-1]
    start, stop = float(first.t[0]), float(last.t[-1])
    segment = Segment(first.segment, start, stop, sample_count(start, stop, rate))
    clock = ToClock(checks, rate, (Lane(channels, CUBIC),))
    parts = partition([segment], rate, clock.margin(0))
    each = [clock(w, w.part.first, w.part.stop)[0] for w in windows(pieces, parts)]
    return np.concatenate(each, axis=1)
