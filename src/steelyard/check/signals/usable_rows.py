"""What a log shows without trusted units: good rows, stretches, and smoothed derivatives.

The filters of `runs` know how fast a joint can be, in SI units. A check must not trust
the units yet, so rows are judged here by the log's own steps and ranges only.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.runs.first_pass_over_recording import (
    FASTEST_FACTOR,
    FASTEST_SHARE,
    MOVED,
    frozen_positions,
    smallest_steps,
)
from steelyard.runs.recording import Channels
from steelyard.runs.rows.clock_and_row_scan import GAP_STEPS
from steelyard.runs.rows.faulty_row_detectors import LARGEST_VALUE
from steelyard.runs.rows.resampling import uniform

JITTER_LIMIT = 0.19
"""Standard deviation of the steps over the median step from which on stamps jitter. Logs of good
controllers have up to 0.16."""
LATE_STEP = 4.0  # a step longer than so many median ones says nothing of the jitter
EVENED_STAMPS = 51  # stamps over which jitter is averaged
MEDIAN_ROWS = 41  # rows of the running median that removes garbage: up to 20 broken ones in a row
GAP_TIME = 1000.0  # steps that a stamp may be off its neighbours before it is garbage
FASTEST_RATE = 500.0
"""Highest rate at which motion is looked at [Hz], once the clock's unit is known."""
MOVED_STEPS = 30.0  # range of a joint that moves, in steps of its sensor
LEAST_ROWS, SHORTEST_STRETCH = 10, 50
"""Good rows from which on single signals are looked at, and rows of the shortest stretch."""
JUMP_ROWS, JUMP_FACTOR = 10, 10.0
"""A position jumps if it changes by so many times more than between so many rows before and behind,
and than in the fastest of rows."""


@dataclass(frozen=True, eq=False)
class PositionSlopes:
    """Derivatives of the positions in all stretches together."""

    t: Array  # time, shape `(N,)` [s as declared]
    v: Array  # derivatives, shape `(n, N)` [declared unit per true second]
    rate: float  # [Hz]
    moving: NDArray[np.bool_]  # joints that move enough to say anything about, shape `(n,)`


@dataclass(frozen=True, eq=False)
class SignalOverview:
    """Good rows of a log's excerpt."""

    channels: Channels  # order of the channels
    stamps: Array  # all readable stamps in the order of the rows, shape `(M,)` [s as declared]
    t: Array  # time of the good rows, increasing, shape `(N,)` [s as declared]
    x: Array  # their channels, shape `(N, C)` [SI as declared]
    kept: NDArray[np.bool_]  # which rows of the excerpt they are, shape `(R,)`
    broken: NDArray[np.bool_]  # which rows are missing values or hold garbage, shape `(R,)`
    step: float  # median step forward [s as declared]; 0 if time never goes forward

    @property
    def q(self) -> Array:
        """Positions, shape `(N, n)`."""
        return self.x[:, self.channels.q]

    @property
    def dq(self) -> Array | None:
        """Velocities, shape `(N, n)`, if logged."""
        return self.x[:, self.channels.dq] if self.channels.velocities else None

    @property
    def effort(self) -> Array:
        """Efforts, shape `(N, n)`."""
        return self.x[:, self.channels.effort]

    @cached_property
    def resolution(self) -> Array:
        """Smallest step of each channel that is not zero, shape `(C,)`; 0 if it never changes."""
        return smallest_steps(self.x)

    @property
    def moves(self) -> bool:
        """Whether any joint moves by more than its sensor's steps."""
        if len(self.q) < 2:
            return False
        far = np.ptp(self.q, axis=0) > MOVED_STEPS * self.resolution[self.channels.q]
        return bool((far & (np.ptp(self.q, axis=0) > MOVED))[self.channels.base :].any())

    @cached_property
    def jumps(self) -> NDArray[np.bool_]:
        """Where the positions of which joints jump to the next row without a gap, `(N - 1, n)`."""
        change = np.abs(np.diff(self.q, axis=0))
        if len(change) <= 2 * JUMP_ROWS:
            return np.zeros(change.shape, dtype=np.bool_)
        padded = np.pad(change, ((JUMP_ROWS, JUMP_ROWS), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, JUMP_ROWS, axis=0).max(axis=-1)
        around = np.maximum(windows[: len(change)], windows[JUMP_ROWS + 1 :])
        fastest = np.quantile(change, FASTEST_SHARE, axis=0)
        least = np.maximum(JUMP_FACTOR * around, FASTEST_FACTOR * fastest)
        far = change > np.maximum(least, MOVED_STEPS * self.resolution[self.channels.q])
        far[:, : self.channels.base] = False  # impacts are no jumps
        even = np.diff(self.t) <= GAP_STEPS * self.step
        return np.asarray(far & even[:, None] & (change > MOVED))

    @cached_property
    def frozen(self) -> tuple[tuple[int, int, int], ...]:
        """Joint, first and last row where a position does not change, but others do."""
        joints = self.channels.encoders
        found = frozen_positions(self.q[:, joints], self.resolution[joints])
        return tuple((joints.start + j, first, last) for j, first, last in found)

    @cached_property
    def stretches(self) -> tuple[slice, ...]:
        """Rows without a gap or a jump between them, long enough to be looked at."""
        gaps = np.diff(self.t) > 2.0 * GAP_STEPS * self.step
        ends = np.flatnonzero(gaps | self.jumps.any(axis=1)) + 1
        edges = [0, *ends.tolist(), len(self.t)]
        pairs = zip(edges[:-1], edges[1:], strict=True)
        return tuple(slice(a, b) for a, b in pairs if b - a >= SHORTEST_STRETCH)

    @property
    def jitter(self) -> float:
        """Standard deviation of the steps without gaps, over the median step."""
        steps = np.diff(self.stamps)
        usual = steps[np.abs(steps) < LATE_STEP * self.step]
        return float(usual.std()) / self.step if len(usual) else 0.0

    @cached_property
    def clock(self) -> Array:
        """Times of the good rows: the stamps, or smoother ones where the motion knows better.

        Stamps may jitter although samples are even. Then velocities are far rougher by the stamps
        than by evened ones.
        """
        if self.jitter < JITTER_LIMIT:
            return self.t
        evened, half = self.t.copy(), EVENED_STAMPS // 2
        for stretch in self.stretches:
            t, row = self.t[stretch], np.flatnonzero(self.kept)[stretch]
            if len(t) >= 2 * EVENED_STAMPS:
                trend = (t[-1] - t[0]) / (row[-1] - row[0]) * row
                off = np.pad(t - trend, half, mode="edge")
                t = trend + np.convolve(off, np.full(EVENED_STAMPS, 1.0 / EVENED_STAMPS), "valid")
                evened[stretch] = t if (np.diff(t) > 0.0).all() else evened[stretch]
        return evened if _rough(evened, self.q) < _rough(self.t, self.q) else self.t

    def even(self, values: Array, second: float = 1.0) -> tuple[tuple[Array, ...], float]:
        """Stretches `(any, samples)` of signals `(N, any)` on an even clock, and their rate [Hz].

        A declared second has so many seconds.
        """
        if not self.stretches:
            return (), 1.0
        mean = sum(float(self.t[s][-1] - self.t[s][0]) for s in self.stretches)
        mean /= sum(s.stop - s.start - 1 for s in self.stretches)
        rate = min(1.0 / (mean * second), FASTEST_RATE)
        even = [uniform(second * self.clock[s], values[s].T, rate) for s in self.stretches]
        return tuple(x for x in even if x.shape[1] >= SHORTEST_STRETCH), rate

    def slopes(self, second: float = 1.0) -> PositionSlopes:
        """Derivatives of the positions, and which joints move."""
        even, rate = self.even(np.column_stack((self.t, self.q)), second)
        half = len(_bell(rate)) // 2
        pieces = [(x[0, half : x.shape[1] - half], gaussian_slope(x[1:], rate)) for x in even]
        pieces = [(t, v) for t, v in pieces if v.shape[1]]
        n = self.channels.joints
        t = np.concatenate([np.zeros(0), *(t for t, _ in pieces)])
        v = np.concatenate([np.zeros((n, 0)), *(v for _, v in pieces)], axis=1)
        return PositionSlopes(t, v, rate, self.moving(v))

    def moving(self, v: Array) -> NDArray[np.bool_]:
        """Joints that move enough to say anything about, by derivatives `(n, any)`; `(n,)`."""
        if v.shape[1] == 0:
            return np.zeros(len(v), dtype=np.bool_)
        speed = np.sqrt(np.square(v).mean(axis=1))
        steps = MOVED_STEPS * self.resolution[self.channels.q]
        spread = np.ptp(self.q, axis=0)
        far = (spread > 0.0) & (spread >= np.maximum(steps, RANGE_NOISE * noise_of(self.q)))
        return np.asarray(far & (speed >= STILL_SHARE * speed[self.channels.base :].max()))


def good_rows(t: Array, x: Array, channels: Channels) -> SignalOverview:
    """The rows `(R,)`, `(R, C)` of a log that are readable, in order of time, and no garbage."""
    empty = np.isnan(x).all(axis=1)  # of other topics, or of none at all
    empty &= not empty.all()
    readable = np.isfinite(t) & ~empty
    stamped = readable.copy()
    forward = np.diff(t[readable])
    forward = forward[forward > 0.0]
    step = float(np.median(forward)) if len(forward) else 0.0
    with np.errstate(invalid="ignore"):
        stamped[readable] = _near(t[readable], GAP_TIME * step)
        kept = stamped & (np.abs(x) <= LARGEST_VALUE).all(axis=1)
    for channel in range(channels.base, channels.pushed.start if channels.contacts else x.shape[1]):
        values = x[kept, channel]
        span = float(np.ptp(np.quantile(values, [0.02, 0.98]))) if len(values) else 0.0
        reach = max(0.5 * span, 1.0) if channel < channels.joints else 20.0 * span + 60.0
        kept[kept] = _near(values, reach)
    broken = ~kept & ~empty
    latest = np.maximum.accumulate(t[kept])
    kept[kept] = np.concatenate((np.ones(len(latest[:1]), np.bool_), t[kept][1:] > latest[:-1]))
    return SignalOverview(channels, t[stamped], t[kept], x[kept], kept, broken, step)


def _near(values: Array, reach: float) -> NDArray[np.bool_]:
    """Whether each value is within reach of the median of its neighbours."""
    if len(values) < MEDIAN_ROWS or not (np.abs(np.diff(values)) > reach).any():
        return np.ones(len(values), dtype=np.bool_)
    windows = np.lib.stride_tricks.sliding_window_view(values, MEDIAN_ROWS)
    median = np.pad(np.median(windows, axis=1), MEDIAN_ROWS // 2, mode="edge")
    return np.asarray(np.abs(values - median) <= reach)


def _rough(t: Array, q: Array) -> float:
    """How much velocities change from row to row, over the velocities."""
    speed = np.diff(q, axis=0) / np.diff(t)[:, None]
    size = float(np.abs(speed).mean())
    return float(np.abs(np.diff(speed, axis=0)).mean()) / size if size > 0.0 else 0.0


SLOPE_WIDTH = 0.02  # standard deviation of the low-pass [s]: half the power is gone at 6.6 Hz
SLOW_SHARE = 0.05  # share of the fastest speed below which a joint rests
SHORTEST_WIDTH = 1.5  # the same in samples, at least
SLOPE_ENDS = 4.0  # widths of the Gaussian on each side that are taken into account
STILL_SHARE = 3e-4
"""Share of the fastest joint's rms speed below which a joint rests, in whatever unit it is."""
RANGE_NOISE = 10.0  # range of a joint that moves, in standard deviations of its noise


def noise_of(x: Array) -> Array:
    """Standard deviation of white noise in signals `(N, C)`, by second differences, `(C,)`."""
    if len(x) < 3:
        return np.zeros(x.shape[1])
    return np.asarray(np.sqrt(np.square(np.diff(x, n=2, axis=0)).mean(axis=0) / 6.0))


def width_of(rate: float) -> float:
    """Standard deviation of the low-pass at a rate [s]."""
    return max(SLOPE_WIDTH, SHORTEST_WIDTH / rate)


def gaussian_smoothed(x: Array, rate: float) -> Array:
    """Signals `(C, N)` behind the Gaussian, without its ends: shape `(C, fewer)`."""
    return _convolved(x, _bell(rate))


def gaussian_slope(x: Array, rate: float) -> Array:
    """Their derivatives behind the same Gaussian, at the same times [1/s]."""
    bell = _bell(rate)
    at = np.arange(len(bell)) - len(bell) // 2
    kernel = -at * bell
    return _convolved(x, kernel * (rate / -(at @ kernel)))


def _bell(rate: float) -> Array:
    width = width_of(rate) * rate
    half = int(np.ceil(SLOPE_ENDS * width))
    bell: Array = np.exp(-0.5 * (np.arange(-half, half + 1) / width) ** 2)
    bell /= bell.sum()
    return bell


def _convolved(x: Array, kernel: Array) -> Array:
    if x.shape[1] < len(kernel):
        return np.zeros((len(x), 0))
    return np.stack([np.convolve(row, kernel, "valid") for row in x])
