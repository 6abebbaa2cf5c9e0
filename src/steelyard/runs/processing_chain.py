"""From a log's rows to motion and effort on a uniform clock, part by part in memory.

A part is samples of a segment, and the rows that these depend on: with its margins, which filters
look at, it gives what the whole log gives at its samples. Parts do not depend on each other.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import ceil

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.contact_projection import margin_samples, with_margins
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import Recording
from steelyard.runs.rows.bridged_rows_segments_and_quality import (
    COUNTS_OF_MARKS,
    CUT_OFF,
    RowChecks,
    Segment,
)
from steelyard.runs.rows.clock_and_row_scan import Clock, RowPiece, RowScan
from steelyard.runs.rows.resampling import (
    CUBIC,
    INTERPOLATIONS,
    THINNING_PASSBAND,
    WORST_NEIGHBOUR,
    Lane,
    Thinning,
    interpolated,
    sample_count,
)
from steelyard.runs.smoothing.kalman_smoother import CausalKalman
from steelyard.runs.smoothing.likeliest_cutoffs_and_fourier import Auto
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Bank,
    Designed,
    continued_at_ends,
)

SAMPLES_OF_PART = 8192  # samples of a part; more where margins are long


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

    def parts(self, segments: Sequence[Segment], around: int) -> list[Part]:
        """The parts of a log, in order of time, where so many samples around one count for it."""
        lags, found = [lane.lag for lane in self.lanes], []
        rows = max(lane.kind.margin for lane in self.lanes) + 1
        rows += 0 if self.checks.idle else self.checks.halo
        size = max(SAMPLES_OF_PART // self.factor, 4 * around, 1)
        for segment in segments:
            for first in range(0, segment.samples, size):
                stop = min(first + size, segment.samples)
                begin, end = (segment.start + k / self.rate for k in (first, stop))
                since = begin - around / self.rate - (self.reach - min(lags))
                until = end + (around - 1) / self.rate + (self.reach + max(lags))
                if first == 0:
                    begin = since = -np.inf
                if stop == segment.samples:
                    end = until = np.inf
                found.append(Part(segment, first, stop, begin, end, since, until, rows))
        return found

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
    found = windows(pieces, clock.parts([segment], 0))
    each = [clock(w, w.part.first, w.part.stop)[0] for w in found]
    return np.concatenate(each, axis=1)


SATURATION_SPREAD = 0.5
"""How far around an effort at its limit samples do not count, in periods of the regression cut-off:
half the length over which the parallel filter mixes them."""
CONTEXT_PERIODS = 4.0
"""How far methods that are given whole segments look beyond a window, in periods of the cut-off."""


@dataclass(frozen=True, eq=False)
class MotionPart:
    """Samples of a segment on the uniform clock, from the one with number `first` on.

    Signals are `q, dq, ddq, effort` and channels that say where contacts are, shape `(4 n + c, N)`;
    weights say how much each effort counts, shape `(n, N)`, `None` if all count alike; marks are
    the counts of `Marked` over the rows.
    """

    segment: Segment
    first: int
    signals: Array
    weights: Array | None
    marks: Array


@dataclass(frozen=True, eq=False)
class Chain:
    """What is done with a recording's rows, with every choice made."""

    processing: Processing
    clock: Clock
    rate: float  # of the uniform clock [Hz]
    thinning: int  # samples of the clock that rows are brought to over samples that are left
    row_checks: RowChecks
    flagged: bool  # whether any effort is marked
    before: str = ""  # what the rows are already, in words

    @property
    def motion_cutoff(self) -> float:
        """Low-pass of the motion [Hz]."""
        return float(self.processing.motion_cutoff or 0.0)

    @property
    def matched_cutoff(self) -> float:
        """Low-pass of regressor and effort alike, which the pass applies [Hz]."""
        return float(self.processing.matched_cutoff or 0.0)

    @property
    def words(self) -> str:
        """The stages, for reports."""
        p, s = self.processing, self.row_checks
        stages = [self.before] if self.before else []
        hampel = None if s.threshold is None else f"Hampel threshold {s.threshold:g} scaled MAD"
        stages.append(hampel or "outliers kept")
        if s.bridge_stale:
            stages.append("repeated rows interpolated")
        if not np.isnan(s.limits).all():
            stages.append("efforts at their limit left out")
        stages.append(f"{p.resampling} to {self.rate:g} Hz")
        if self.thinning > 1:
            stages[-1] += f" behind a low-pass of {THINNING_PASSBAND * self.rate:g} Hz"
        stages += [f"motion {self._motion_words}", p.effort_words]
        return ", ".join(stages)

    @property
    def _motion_words(self) -> str:
        motion, at = self.processing.motion, f"{self.motion_cutoff:g} Hz"
        if isinstance(motion, Auto):
            return f"by {self.processing.motion_words}, motion cut-off {at}"
        late = ""
        if isinstance(motion, CausalKalman):
            delay = 1e3 * motion.lateness(self.motion_cutoff)
            late = f"; causal: slow accelerations {delay:.2g} ms late"
        return f"by {self.processing.motion_words} ({at}{late})"

    def context(self, recording: Recording) -> float:
        """How far beyond a window the chain looks [s]."""
        work = ToMotion(self, recording)
        seconds = work.halo / self.rate + work.clock.reach
        if work.whole:
            seconds += CONTEXT_PERIODS / self.motion_cutoff
        lags = recording.signals.delays
        return seconds + max(abs(lag) for lag in lags) + self.row_checks.halo * self.clock.step

    def parts(
        self,
        recording: Recording,
        segments: Sequence[Segment],
        counted: tuple[float, float] = (-np.inf, np.inf),
    ) -> Iterator[MotionPart]:
        """Signals and weights of segments, in order; marked rows count between two times [s]."""
        work = ToMotion(self, recording)
        around = 0 if work.whole else work.halo
        parts = work.clock.parts(segments, around)
        held: list[Array] = []
        marks = np.zeros(COUNTS_OF_MARKS)
        for window in windows(RowScan(self.clock, recording).pieces(), parts):
            part, segment = window.part, window.part.segment
            low, high = max(part.first - around, 0), min(part.stop + around, segment.samples)
            even, found = work.clock(window, low, high, counted)
            held.append(even)
            marks += found
            if work.whole and part.stop < segment.samples:
                continue
            even = held.pop() if len(held) == 1 else np.concatenate(held, axis=1)
            held.clear()
            first, low = (0, 0) if work.whole else (part.first, low)
            before, after = work.halo - (first - low), work.halo - (high - part.stop)
            signals, weights = work(continued_at_ends(even, before, after))
            yield MotionPart(segment, first, signals, weights, marks)
            marks = np.zeros(COUNTS_OF_MARKS)


class ToMotion:
    """Rows to even channels, and these to `q, dq, ddq, effort` and weights, in memory."""

    def __init__(self, chain: Chain, recording: Recording) -> None:
        p, rate, c = chain.processing, chain.rate, recording.channels
        self._flagged, self._channels = chain.flagged, c
        self._base = recording.signals.base
        self._rate = rate
        self._motion = p.motion.designed(chain.motion_cutoff, rate)
        self._effort: Bank | Designed = Designed(lambda efforts: efforts, 0)
        if p.effort is not None:
            self._effort = p.effort.smooth(p.effort_cutoff or chain.motion_cutoff, rate)
        spread = ceil(SATURATION_SPREAD * rate / chain.matched_cutoff) if chain.flagged else 0
        halos = self._motion.halo, self._effort.halo, spread, margin_samples(self._base, rate)
        self.whole = None in halos
        self.halo = max(halo or 0 for halo in halos)
        self._spare = [self.halo - (halo or 0) for halo in halos]
        thinning = None
        if chain.thinning > 1:
            thinning = Thinning.design(chain.thinning, c.joints if chain.flagged else 0)
        self.clock = ToClock(chain.row_checks, rate, _lanes(chain, recording), thinning)

    def __call__(self, extended: Array) -> tuple[Array, Array | None]:
        """Channels with context, `(C, N + 2 halo)`, to signals, `(4 n, N)`, and weights, `(n, N)`.

        There are no weights if all efforts count alike.
        """
        c = self._channels
        inner, measured, flags, touched = (
            extended[:, spare : extended.shape[1] - spare] for spare in self._spare
        )
        signals = self._motion(inner[c.q], inner[c.dq] if c.velocities else None)
        effort = self._effort(measured[c.effort])
        if c.contacts:
            effort = effort + self._effort(measured[c.pushed])
        weights = None
        if self._flagged:
            weights = _weights(np.abs(flags[c.count :]), self.halo - self._spare[2])
        touching = []
        if self._base is not None and c.touches:
            touching = [with_margins(self._base, touched[c.touched], self._rate)]
        return np.concatenate((*signals, effort, *touching)), weights


def _lanes(chain: Chain, recording: Recording) -> list[Lane]:
    """How channels are read, and below them the flags, if they are carried."""
    c, s = recording.channels, recording.signals
    kind = INTERPOLATIONS[chain.processing.resampling]
    joined: list[Lane] = []
    base = slice(0, c.base), 0.0 if s.base is None else s.base.delay
    motion = base, (c.encoders, 0.0), (c.dq, s.velocity_delay)
    others = (c.effort, s.effort_delay), (c.pushed, 0.0), (c.touched, 0.0)
    for channels, lag in (*motion, *others):
        if joined and joined[-1].lag == lag and channels.start < channels.stop:
            joined[-1] = Lane(slice(joined[-1].channels.start, channels.stop), kind, lag)
        elif channels.start < channels.stop:
            joined.append(Lane(channels, kind, lag))
    if chain.flagged:
        joined.append(Lane(slice(c.count, c.count + c.joints), WORST_NEIGHBOUR, s.effort_delay))
    return joined


def _weights(flags: Array, spread: int) -> Array:
    """Weights of efforts, from their flags with context, shape `(n, N + 2 spread)`.

    The `spread` samples around an effort at its limit do not count either.
    """
    count = np.cumsum(np.pad(flags >= CUT_OFF, ((0, 0), (1, 0))), axis=1)
    near: Array = count[:, 2 * spread + 1 :] - count[:, : -2 * spread - 1]
    own = flags[:, spread : flags.shape[1] - spread]
    return np.where((near > 0) | (own > 0.0), 0.0, 1.0)
