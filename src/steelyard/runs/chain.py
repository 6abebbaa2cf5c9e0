"""The chain from a log's rows to motion and effort on a uniform clock, part by part in memory."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.partition import Margin, Window, partition, windows
from steelyard.runs.processing import Processing
from steelyard.runs.recording import Recording
from steelyard.runs.rows.clock import Clock, RowScan
from steelyard.runs.rows.resampling import (
    INTERPOLATIONS,
    THINNING_PASSBAND,
    WORST_NEIGHBOUR,
    Lane,
    Thinning,
    interpolated,
    sample_count,
)
from steelyard.runs.rows.row_checks import COUNTS_OF_MARKS, CUT_OFF, RowChecks, Segment
from steelyard.runs.smoothing.auto import Auto
from steelyard.runs.smoothing.filters import continued_at_ends
from steelyard.runs.smoothing.method import Causal

SATURATION_SPREAD = 0.5
"""How far around an effort at its limit samples do not count, in periods of the regression cut-off:
half the length over which the parallel filter mixes them."""

CONTEXT_PERIODS = 4.0
"""How far methods that are given whole segments look beyond a window, in periods of the cut-off."""


@dataclass(frozen=True, eq=False)
class MotionPart:
    """Samples of a segment on the uniform clock, from the one with number `first` on.

    Attributes:
        signals: `q, dq, ddq, effort`, shape `(4 n, N)`.
        weights: How much each effort counts, shape `(n, N)`; `None` if all count alike.
        marks: The counts of `Marked` over its rows.
    """

    segment: Segment
    first: int
    signals: Array
    weights: Array | None
    marks: Array


@dataclass(frozen=True, eq=False)
class Chain:
    """What is done with a recording's rows, with every choice made.

    Attributes:
        rate: Of the uniform clock [Hz].
        thinning: Samples of the clock that rows are brought to over samples that are left.
        flagged: Whether any effort is marked, so that flags are worth carrying.
        before: What the rows are already, in words.
    """

    processing: Processing
    clock: Clock
    rate: float
    thinning: int
    row_checks: RowChecks
    flagged: bool = True
    before: str = ""

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
        stages += [
            "outliers kept"
            if s.threshold is None
            else f"Hampel threshold {s.threshold:g} scaled MAD"
        ]
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
        """How positions become motion."""
        motion, at = self.processing.motion, f"{self.motion_cutoff:g} Hz"
        if isinstance(motion, Auto):
            return f"by {self.processing.motion_words}, motion cut-off {at}"
        late = ""
        if isinstance(motion, Causal):
            delay = 1e3 * motion.lateness(self.motion_cutoff)
            late = f"; causal: slow accelerations {delay:.2g} ms late"
        return f"by {self.processing.motion_words} ({at}{late})"

    def context(self, recording: Recording) -> float:
        """How far beyond a window the chain looks [s]."""
        work = ToMotion(self, recording)
        seconds = work.halo / self.rate + work.thinning_seconds
        if work.whole:
            seconds += CONTEXT_PERIODS / self.motion_cutoff
        lags = recording.signals.velocity_delay, recording.signals.effort_delay
        return seconds + max(abs(lag) for lag in lags) + self.row_checks.halo * self.clock.step

    def parts(
        self,
        recording: Recording,
        segments: Sequence[Segment],
        counted: tuple[float, float] = (-np.inf, np.inf),
    ) -> Iterator[MotionPart]:
        """Signals and weights of segments, in order; marked rows count between two times [s]."""
        work = ToMotion(self, recording)
        parts = partition(segments, self.rate, work.margin)
        for window in windows(RowScan(self.clock, recording).pieces(), parts):
            yield work(window, counted)


class ToMotion:
    """The rows of a part to its `q, dq, ddq, effort` and weights, in memory."""

    def __init__(self, chain: Chain, recording: Recording) -> None:
        p, rate, c = chain.processing, chain.rate, recording.channels
        self._chain, self._channels = chain, c
        self._motion = p.motion.designed(chain.motion_cutoff, rate)
        self._effort = None
        if p.effort is not None:
            self._effort = p.effort.smooth(p.effort_cutoff or chain.motion_cutoff, rate)
        spread = ceil(SATURATION_SPREAD * rate / chain.matched_cutoff) if chain.flagged else 0
        halos = self._motion.halo, 0 if self._effort is None else self._effort.halo, spread
        self.whole = None in halos
        self.halo = max(halo or 0 for halo in halos)
        self._spare = [self.halo - (halo or 0) for halo in halos]
        self._thinning = None
        if chain.thinning > 1:
            self._thinning = Thinning.design(chain.thinning, c.joints if chain.flagged else 0)
        self._lanes = self._lanes_of(recording)

    def _lanes_of(self, recording: Recording) -> list[Lane]:
        """How channels are read, and below them the flags, if they are carried."""
        c, s = self._channels, recording.signals
        kind = INTERPOLATIONS[self._chain.processing.resampling]
        joined: list[Lane] = []
        for channels, lag in ((c.q, 0.0), (c.dq, s.velocity_delay), (c.effort, s.effort_delay)):
            if joined and joined[-1].lag == lag:
                joined[-1] = Lane(slice(joined[-1].channels.start, channels.stop), kind, lag)
            elif channels.start < channels.stop:
                joined.append(Lane(channels, kind, lag))
        if self._chain.flagged:
            joined.append(Lane(slice(c.count, c.count + c.joints), WORST_NEIGHBOUR, s.effort_delay))
        return joined

    @property
    def thinning_seconds(self) -> float:
        """How far the low-pass before thinning out looks [s]."""
        if self._thinning is None:
            return 0.0
        return self._thinning.halo / (self._chain.rate * self._chain.thinning)

    @property
    def margin(self) -> Margin:
        """What a sample depends on."""
        lags, checks = [lane.lag for lane in self._lanes], self._chain.row_checks
        return Margin(
            samples=None if self.whole else self.halo,
            before=self.thinning_seconds - min(lags),
            after=self.thinning_seconds + max(lags),
            rows=(0 if checks.idle else checks.halo) + max(x.kind.margin for x in self._lanes) + 1,
            rows_per_sample=self._chain.thinning,
        )

    def __call__(self, window: Window, counted: tuple[float, float]) -> MotionPart:
        """The samples of a part; marked rows are counted between two times [s]."""
        part, c, chain = window.part, self._channels, self._chain
        t, x, marks = window.t, window.x.T, np.zeros(COUNTS_OF_MARKS)
        if not chain.row_checks.idle:
            t, x, counts = chain.row_checks.applied(t, x, window.lacking)
            own = (t >= max(part.begin, counted[0])) & (t < part.end) & (t <= counted[1])
            marks = counts[:, own].sum(axis=1)
        elif chain.flagged:
            x = np.pad(x, ((0, c.joints), (0, 0)))
        first, stop = part.first - self.halo, part.stop + self.halo
        low, high = max(first, 0), min(stop, part.segment.samples)
        even = self._even(t, x, part.segment, low, high)
        extended = continued_at_ends(even, low - first, stop - high)
        signals, weights = self._signals(extended), None
        if chain.flagged:
            spread, spare = self.halo - self._spare[2], self._spare[2]
            flags = np.abs(extended[c.count :, spare : extended.shape[1] - spare])
            weights = _weights(flags, spread)
        return MotionPart(part.segment, part.first, signals, weights, marks)

    def _even(self, t: Array, x: Array, segment: Segment, low: int, high: int) -> Array:
        """Channels, shape `(C, high - low)`, at samples of a segment's uniform clock."""
        rate, factor, thinning = self._chain.rate, self._chain.thinning, self._thinning
        if thinning is None:
            return interpolated(t, x, segment.start + np.arange(low, high) / rate, self._lanes)
        first, stop = factor * low - thinning.halo, factor * (high - 1) + 1 + thinning.halo
        count = sample_count(segment.start, segment.stop, rate * factor)
        inside = np.arange(max(first, 0), min(stop, count))
        even = interpolated(t, x, segment.start + inside / (rate * factor), self._lanes)
        extended = continued_at_ends(even, inside[0] - first, stop - 1 - inside[-1])
        return thinning(extended)[:, ::factor]

    def _signals(self, extended: Array) -> Array:
        """Channels with context, `(C, N + 2 halo)`, to signals, `(4 n, N)`."""
        c, (motion, effort, _) = self._channels, self._spare
        inner = extended[:, motion : extended.shape[1] - motion]
        signals = self._motion(inner[c.q], inner[c.dq] if c.velocities else None)
        measured = extended[c.effort, effort : extended.shape[1] - effort]
        if self._effort is not None:
            measured = self._effort(measured)
        return np.concatenate((*signals, measured))


def _weights(flags: Array, spread: int) -> Array:
    """Weights of efforts, from their flags with context, shape `(n, N + 2 spread)`.

    The `spread` samples around an effort at its limit do not count either.
    """
    count = np.cumsum(np.pad(flags >= CUT_OFF, ((0, 0), (1, 0))), axis=1)
    near: Array = count[:, 2 * spread + 1 :] - count[:, : -2 * spread - 1]
    own = flags[:, spread : flags.shape[1] - spread]
    return np.where((near > 0) | (own > 0.0), 0.0, 1.0)
