"""From rows at uneven times to a uniform clock: interpolation and resampling.

`CUBIC` runs, between two rows, the cubic that has their values and, as slopes there, those of the
parabola through each row and its neighbours: exact for parabolas, with a continuous slope. `PCHIP`
never overshoots [Fritsch1984], `SPLINE` has a continuous curvature, `LINEAR` has corners.

Channels that were logged late are read later in the log: what was logged at `t + lag` belongs to
time `t`. A clock slower than the log's gets no more than it can carry: rows are first brought to a
multiple of its rate that is not below theirs, then low-passed, then thinned out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Bank, kaiser_lowpass


@dataclass(frozen=True)
class Interpolation:
    """A way to values between two rows, with the rows that it needs beyond each of these.

    The function takes channels `(C, N)`, known at two or more times, to other times among these.
    """

    margin: int
    function: Callable[[Array, Array, Array], Array]

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """Channels `(C, N)`, known at times `t`, at other times among these, `(C, len(at))`."""
        return np.repeat(x, len(at), axis=1) if len(t) == 1 else self.function(t, x, at)


def _linear(t: Array, x: Array, at: Array) -> Array:
    i, u = _place(t, at)
    return np.asarray(x[:, i] + u * (x[:, i + 1] - x[:, i]))


def _worst(t: Array, x: Array, at: Array) -> Array:
    i, u = _place(t, at)
    after = np.where(u > 0.0, x[:, i + 1], x[:, i])
    return np.maximum(np.where(u < 1.0, x[:, i], after), after)


def _cubic(t: Array, x: Array, at: Array) -> Array:
    step = np.diff(t)
    secant = np.diff(x, axis=1) / step
    slope = np.gradient(x, t, axis=1, edge_order=2 if len(step) > 1 else 1)
    i, u = _place(t, at)
    a = slope[:, i] - secant[:, i]
    b = secant[:, i] - slope[:, i + 1]
    along = secant[:, i] + (1.0 - u) * ((1.0 - u) * a + u * b)
    return np.asarray(x[:, i] + u * step[i] * along)


def _of_scipy(name: str) -> Callable[[Array, Array, Array], Array]:
    def function(t: Array, x: Array, at: Array) -> Array:
        from scipy import interpolate

        return np.asarray(getattr(interpolate, name)(t, x, axis=1)(at))

    return function


CUBIC = Interpolation(1, _cubic)
INTERPOLATIONS = {
    "cubic": CUBIC,
    "linear": Interpolation(0, _linear),
    "pchip": Interpolation(1, _of_scipy("PchipInterpolator")),
    # a row's say falls by half or more from row to row
    "spline": Interpolation(60, _of_scipy("CubicSpline")),
}
"""By the names they have in files."""
WORST_NEIGHBOUR = Interpolation(0, _worst)
"""The larger value of the rows before and after, for flags."""


def _place(t: Array, at: Array) -> tuple[np.ndarray, Array]:
    """Row before each time, and how far between that and the next one the time is, in [0, 1]."""
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    return i, (at - t[i]) / (t[i + 1] - t[i])


THINNING_SUPPRESSION = 80.0
"""How far a low-pass before thinning out is down from half the clock's rate on [dB]."""
THINNING_PASSBAND = 0.4  # highest frequency that passes it, per rate of the clock


@dataclass(frozen=True)
class Lane:
    """Channels that are read by one interpolation, logged so many seconds late."""

    channels: slice
    kind: Interpolation
    lag: float = 0.0


def sample_count(start: float, stop: float, rate: float) -> int:
    """Samples of the uniform clock from time `start` to time `stop` [s]."""
    return floor((stop - start) * rate + 1e-6) + 1


def uniform(t: Array, x: Array, rate: float) -> Array:
    """A segment's channels `(C, N)` at times `t[0] + k / rate`, shape `(C, sample_count)`."""
    count = sample_count(float(t[0]), float(t[-1]), rate)
    return interpolated(t, x, t[0] + np.arange(count) / rate)


def interpolated(
    t: Array, x: Array, at: Array, lanes: Sequence[Lane] = (Lane(slice(None), CUBIC),)
) -> Array:
    """Channels `(C, N)`, known at increasing times `t`, at other times, lane by lane.

    Beyond the ends, where lags make a segment end early, the last values stay.
    """
    values = [lane.kind(t, x[lane.channels], np.clip(at + lane.lag, t[0], t[-1])) for lane in lanes]
    return values[0] if len(values) == 1 else np.concatenate(values)


@dataclass(frozen=True, eq=False)
class Thinning:
    """A low-pass after which every `factor`-th sample says it all; an operation with a halo.

    The last `flags` channels are flags: of those near a sample the largest stays.
    """

    factor: int
    bank: Bank
    flags: int = 0

    @classmethod
    def design(cls, factor: int, flags: int = 0) -> "Thinning":
        """Kaiser-windowed low-pass for a clock `factor` times slower."""
        middle = 0.5 * (THINNING_PASSBAND + 0.5)
        width = 2.0 * (0.5 - THINNING_PASSBAND) / factor
        taps = kaiser_lowpass(THINNING_SUPPRESSION, width, 2.0 * middle / factor)
        return cls(factor, Bank(taps), flags)

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return self.bank.halo

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)` to channels `(C, N)`."""
        from scipy.ndimage import maximum_filter1d

        signals = len(extended) - self.flags
        low = self.bank(extended[:signals])
        if not self.flags:
            return low
        near = maximum_filter1d(np.abs(extended[signals:]), 2 * self.factor + 1, axis=1)
        return np.concatenate((low, near[:, self.halo : -self.halo]))


FEWEST_PARTIAL_ROWS = 100
"""Rows from which on a table is known to hold its columns in rows of their own."""
LONGEST_INTERPOLATED = 5.0  # usual steps of a column from which on a step is a pause


def put_together(t: Array, x: Array) -> Array:
    """Columns `(N, C)` that are in rows of their own, as of several topics, in those of the first.

    Others are interpolated linearly at its times `(N,)`, not across pauses, and rows without it are
    emptied; unchanged if most rows of the first column are complete.
    """
    there = ~np.isnan(x) & np.isfinite(t)[:, None]
    rows = np.flatnonzero(there[:, 0])
    whole = int(np.count_nonzero(there[rows].all(axis=1)))
    if len(rows) < FEWEST_PARTIAL_ROWS or 2 * whole > len(rows):
        return x
    few = (np.count_nonzero(there, axis=0) < FEWEST_PARTIAL_ROWS).any()
    if few or (np.diff(t[there.any(axis=1)]) < 0.0).any():
        return x
    found = np.full_like(x, np.nan)
    for channel, known in enumerate(there.T):
        times, steps = t[known], np.diff(t[known])
        after = np.searchsorted(times, t[rows])
        exact = known[rows]
        between = (after > 0) & (after < len(times))
        near = np.zeros(len(rows), dtype=np.bool_)
        near[between] = steps[after[between] - 1] <= LONGEST_INTERPOLATED * np.median(steps)
        values = np.interp(t[rows], times, x[known, channel])
        found[rows, channel] = np.where(exact, x[rows, channel], np.where(near, values, np.nan))
    return found
