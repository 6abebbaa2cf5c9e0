"""Part of a log for tests of hypotheses.

Velocities and accelerations come from the positions alone, so that a logged velocity that lags or
is none cannot mislead; positions and efforts go through the same filter.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.check.hypotheses.floating_base_readings import BaseSamples, orthonormal
from steelyard.check.hypotheses.nuisance_fit_and_score import ROUNDING
from steelyard.robot.file.signals import BaseSignals
from steelyard.runs.first_pass_over_recording import EXCERPT_ROWS, FalseStretches
from steelyard.runs.floating_base import rotations
from steelyard.runs.processing_choices import Processing, cutoffs
from steelyard.runs.recording import Recording
from steelyard.runs.rows.clock_and_row_scan import (
    SHORTEST_CHAIN,
    RowPiece,
    RowScan,
    learn_clock,
    nice_rate,
)
from steelyard.runs.rows.resampling import uniform
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Bank,
    apply,
    butterworth,
    low_pass,
    settling,
)
from steelyard.runs.spectrum_and_period import motion_band

EXCERPT_SAMPLES = 3000  # samples that are kept
EXCERPT_STRETCHES = 8  # stretches that they are spread over, where a log has more
OVERSAMPLING = 8.0  # kept samples per period of the cut-off
START_UP = 1.0  # periods of the cut-off at the ends of a stretch that the filter's start-up takes


@dataclass(frozen=True, eq=False)
class Excerpt:
    """Samples of a log in its own units and columns, joint-major; signs and units not applied."""

    t: Array  # time from the log's start, shape `(B,)` [s]
    stretch: NDArray[np.intp]  # number of each sample's stretch, in which time is even, `(B,)`
    z: Array  # position columns low-passed, shape `(n, B)`
    dz: Array  # their first derivative
    ddz: Array  # their second derivative
    e: Array  # effort columns behind the same low-pass, shape `(n, B)`
    rate: float  # samples per second [Hz]
    cutoff: float  # of the low-pass [Hz]
    log_rate: float  # rows per second of the log [Hz]
    origin: float  # time of the log's start [s]
    base: BaseSamples | None = None  # what else is logged of a floating base
    source: "Excerpt | None" = None  # that it is every `stride`-th sample of
    stride: int = 1

    @cached_property
    def span(self) -> Array:
        """Range of each position column, without the outermost percents, shape `(n,)`."""
        low, high = np.quantile(self.z, (0.01, 0.99), axis=1)
        return np.asarray(high - low)

    @cached_property
    def dead(self) -> tuple[int, ...]:
        """Effort columns that never change beside others that do."""
        still = np.ptp(self.e, axis=1) <= ROUNDING * np.abs(self.e).max(axis=1)
        return () if still.all() else tuple(np.flatnonzero(still).tolist())

    @property
    def worth(self) -> float:
        """Independent samples per kept one."""
        return min(1.0, 2.0 * self.cutoff / self.rate)

    def step(self, samples: int) -> int:
        """Every which sample is one of about so many."""
        return max(1, -(-len(self.t) // samples))

    def thinned(self, samples: int) -> "Excerpt":
        """About so many samples, evenly spread."""
        step = self.step(samples)
        if step == 1:
            return self
        arrays = {k: getattr(self, k)[..., ::step] for k in ("t", "stretch", "z", "dz", "ddz", "e")}
        base = None if self.base is None else self.base.thinned(step)
        return replace(
            self,
            **arrays,
            rate=self.rate / step,
            base=base,
            source=self.source or self,
            stride=self.stride * step,
        )

    def of_base(self, rows: int, delay: float) -> tuple[Array, Array, Array]:
        """The first rows of `z`, `dz` and `ddz` as they would have been logged so much earlier."""
        whole, at = self.source or self, slice(None, None, self.stride)
        z, dz, ddz = (
            whole.earlier(x[:rows], [delay])[0][:, at] for x in (whole.z, whole.dz, whole.ddz)
        )
        return z, dz, ddz

    def later(self, delays: Sequence[float]) -> Array:
        """Efforts as they would have been logged so much earlier, shape `(delays, n, B)`."""
        return self.earlier(self.e, delays)

    def earlier(self, x: Array, delays: Sequence[float]) -> Array:
        """Signals `(any, B)` as they would have been logged so much earlier, `(delays, any, B)`."""
        if not any(delays):
            return np.broadcast_to(x, (len(delays), *x.shape))
        from scipy.interpolate import CubicSpline

        found = np.empty((len(delays), *x.shape))
        for number in np.unique(self.stretch):
            at = np.flatnonzero(self.stretch == number)
            t = self.t[at]
            spline = CubicSpline(t, x[:, at], axis=1)
            wanted = np.clip(t + np.asarray(delays)[:, None], t[0], t[-1])
            found[:, :, at] = np.moveaxis(spline(wanted), 0, 1)
        return found


def excerpt_of(
    recording: Recording, processing: Processing, cutoff: float | None = None
) -> Excerpt | None:
    """The excerpt of a recording; `None` if it holds no motion that can be read.

    Behind the low-pass of a reference [Hz], or one from the data if that is `None`.
    """
    signals = replace(recording.signals, velocity=None, velocity_scale=None)
    try:
        bare = replace(recording, signals=signals).in_memory()
        segments, rate, origin = _segments(bare, processing)
        if not segments:
            return None
        longest = max(segments, key=lambda s: s[1].shape[1])[1]
        if cutoff is None:
            band = motion_band(longest[bare.channels.q], rate).frequency
            if band == 0.0:
                return None
            cutoff = cutoffs(processing, band, rate, recording.where).matched
    except LogError:
        return None
    cutoff = min(cutoff, 0.2 * rate)
    found = _collected(bare, segments, rate, cutoff, origin)
    if found is None or signals.base is None:
        return found
    return replace(found, base=_base_samples(bare, signals.base, found))


def _base_samples(recording: Recording, base: BaseSignals, excerpt: Excerpt) -> BaseSamples:
    """Wrenches of contacts and axes of the base at the samples of an excerpt."""
    orientation, rate = base.orientation, excerpt.log_rate
    found = np.zeros((len(base.contacts), 6, len(excerpt.t)))
    if not orientation and not base.pushes:
        return BaseSamples(found, None)
    rows = _rows_around(recording, (*orientation, *base.pushes), excerpt)
    t, x = rows[:, 0], rows[:, 1 + len(orientation) :]
    if orientation:
        logged = rotations(rows[:, 1 : 1 + len(orientation)], base.orientation_kind)
        axes = logged @ np.reshape(base.axes, (3, 3)).T
        x = np.column_stack((axes.reshape(len(axes), 9), x))
    good = np.isfinite(t) & np.isfinite(x).all(axis=1)
    t, x = t[good], x[good]
    t, first = np.unique(t, return_index=True)
    grid = np.arange(t[0], t[-1], 1.0 / rate)
    even = np.array([np.interp(grid, t, column[first]) for column in x.T])
    smooth = np.concatenate([part[0] for part in apply(low_pass(excerpt.cutoff, rate), [even])], -1)
    at = np.array([np.interp(excerpt.t, grid, channel) for channel in smooth])
    start = 9 * bool(orientation)
    for number, contact in enumerate(base.contacts):
        stop = start + len(contact.columns)
        found[number, : len(contact.columns)] = at[start:stop]
        start = stop
    turned = orthonormal(at[:9].T.reshape(-1, 3, 3)) if orientation else None
    return BaseSamples(found, turned)


def _rows_around(recording: Recording, columns: Sequence[str], excerpt: Excerpt) -> Array:
    """Time from the log's start, and columns, in the time of an excerpt, `(N, 1 + columns)`."""
    scale, found = recording.signals.time_scale, list[Array]()
    around = START_UP / excerpt.cutoff
    for part in recording.log.parts((recording.signals.time, *columns)):
        rows = part.copy()
        rows[:, 0] = scale * rows[:, 0] - excerpt.origin
        near = (rows[:, 0] > excerpt.t[0] - around) & (rows[:, 0] < excerpt.t[-1] + around)
        found.append(rows[near])
    return np.concatenate(found)


def _segments(
    recording: Recording, processing: Processing
) -> tuple[list[tuple[float, Array]], float, float]:
    """Start and channels on a uniform clock of every segment; the clock's rate and origin.

    Rows in which a position is frozen, or an effort dead, are left out.
    """
    clock = learn_clock(recording)
    pieces: list[RowPiece] = []
    false = FalseStretches(recording.channels, processing)
    for piece in RowScan(clock, recording).pieces():
        pieces.append(piece)
        false.add(piece.t, piece.x)
        if sum(len(p.t) for p in pieces) >= EXCERPT_ROWS:
            break
    whole = tuple(replace(stretch, joints=()) for stretch in false.found())
    if whole and not recording.left_out:
        return _segments(replace(recording, left_out=whole), processing)
    grouped = [list(group) for _, group in groupby(pieces, key=lambda piece: piece.segment)]
    joined = [(np.concatenate([p.t for p in g]), np.concatenate([p.x for p in g])) for g in grouped]
    steps = np.concatenate([np.zeros(0), *(np.diff(t) for t, _ in joined)])
    if len(steps) < SHORTEST_CHAIN:
        return [], 0.0, clock.origin
    rate = nice_rate(float(steps.mean()))
    return [(float(t[0]), uniform(t, x.T, rate)) for t, x in joined], rate, clock.origin


def _collected(
    recording: Recording,
    segments: list[tuple[float, Array]],
    rate: float,
    cutoff: float,
    origin: float,
) -> Excerpt | None:
    """All segments filtered, decimated and, if there are many samples, spread out."""
    parts = list(_filtered(recording, segments, rate, cutoff))
    if not parts:
        return None
    step = max(1, int(rate / (OVERSAMPLING * cutoff)))
    total = sum(len(p[0][::step]) for p in parts)
    chosen: list[tuple[Array, Array]] = []
    for t, x in parts:
        t, x = t[::step], x[:, ::step]
        keep = len(t) if total <= EXCERPT_SAMPLES else max(8, int(EXCERPT_SAMPLES * len(t) / total))
        count = 1 if keep == len(t) else max(1, min(EXCERPT_STRETCHES, keep // 64))
        for start in np.linspace(0, len(t) - keep // count, count).astype(int):
            at = slice(start, start + keep // count)
            chosen.append((t[at], x[:, at]))
    t = np.concatenate([part for part, _ in chosen])
    x = np.concatenate([part for _, part in chosen], axis=1)
    stretch = np.repeat(np.arange(len(chosen)), [len(part) for part, _ in chosen])
    z, dz, ddz, e = x.reshape(4, recording.channels.joints, -1)
    return Excerpt(t, stretch, z, dz, ddz, e, rate / step, cutoff, rate, origin)


def _filtered(
    recording: Recording, segments: list[tuple[float, Array]], rate: float, cutoff: float
) -> Iterator[tuple[Array, Array]]:
    """Times and `z, dz, ddz, e` as logged, shape `(4 n, N)`, of segments that are long enough."""
    c, s = recording.channels, recording.signals
    motion = Bank.derivatives(butterworth(cutoff, rate), settling(cutoff, rate), rate, 2)
    smooth = low_pass(cutoff, rate)
    edge = int(np.ceil(START_UP * rate / cutoff))
    for start, even in segments:
        if even.shape[1] < 4 * edge + 2 * SHORTEST_CHAIN:
            continue
        q, e = even[c.q], even[c.effort]
        if s.position_offset is not None:
            q = q - s.position_offset[:, None]
        if s.position_map is not None:
            q = np.asarray(np.linalg.solve(s.position_map, q))
        if s.effort_map is not None:
            e = np.asarray(np.linalg.solve(s.effort_map, e))
        q, e = q / s.position_scale[:, None], e / s.effort_scale[:, None]
        derived = np.concatenate(list(apply(motion, [q])), axis=-1)
        low = np.concatenate([part[0] for part in apply(smooth, [e])], axis=-1)
        t = start + np.arange(even.shape[1]) / rate
        inner = slice(edge, even.shape[1] - edge)
        yield t[inner], np.concatenate((*derived, low))[:, inner]
