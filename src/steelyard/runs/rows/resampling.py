"""From rows at uneven times to a uniform clock: interpolation and resampling by parts.

`CUBIC` runs, between two rows, the cubic that has their values and, as slopes there, those of the
parabola through each row and its neighbours: exact for parabolas, with a continuous slope. `PCHIP`
never overshoots [Fritsch1984], `SPLINE` has a continuous curvature, `LINEAR` has corners.

Channels that were logged late are read later in the log: what was logged at `t + lag` belongs to
time `t`. A clock slower than the log's gets no more than it can carry: rows are first brought to a
multiple of its rate that is not below theirs, then low-passed, then thinned out.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import Protocol

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.smoothing.filters import Bank, apply, kaiser_lowpass


class Interpolation(Protocol):
    """A way to values between rows."""

    @property
    def margin(self) -> int:
        """Rows needed beyond each end of the interval between two rows."""
        ...

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """Channels `(C, N)`, known at times `t`, at other times among these, `(C, len(at))`."""
        ...


@dataclass(frozen=True)
class Linear:
    """Straight lines."""

    margin: int = 0

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        i, u = _place(t, at)
        line: Array = x[:, i] + u * (x[:, i + 1] - x[:, i])
        return line


@dataclass(frozen=True)
class WorstReach:
    """The larger value of the rows before and after, for flags."""

    margin: int = 0

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        i, u = _place(t, at)
        after = np.where(u > 0.0, x[:, i + 1], x[:, i])
        return np.maximum(np.where(u < 1.0, x[:, i], after), after)


@dataclass(frozen=True)
class LocalCubic:
    """Cubics with the slopes of local parabolas."""

    margin: int = 1

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        step = np.diff(t)
        secant = np.diff(x, axis=1) / step
        slope = _slopes(step, secant)
        i, u = _place(t, at)
        h = step[i]
        a = slope[:, i] - secant[:, i]
        b = secant[:, i] - slope[:, i + 1]
        blend: Array = x[:, i] + u * h * (secant[:, i] + (1.0 - u) * ((1.0 - u) * a + u * b))
        return blend


@dataclass(frozen=True)
class Pchip:
    """Cubics with slopes that never overshoot."""

    margin: int = 1

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        from scipy.interpolate import PchipInterpolator

        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        values: Array = PchipInterpolator(t, x, axis=1)(at)
        return values


@dataclass(frozen=True)
class ThroughAll:
    """The cubic spline through all rows; a row's say falls by half or more from row to row."""

    margin: int = 60

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        from scipy.interpolate import CubicSpline

        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        values: Array = CubicSpline(t, x, axis=1)(at)
        return values


CUBIC = LocalCubic()
INTERPOLATIONS: dict[str, Interpolation] = {
    "cubic": CUBIC,
    "linear": Linear(),
    "pchip": Pchip(),
    "spline": ThroughAll(),
}
"""By the names they have in files."""


def _place(t: Array, at: Array) -> tuple[np.ndarray, Array]:
    """Row before each time, and how far between that and the next one the time is, in [0, 1]."""
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    return i, (at - t[i]) / (t[i + 1] - t[i])


def _slopes(step: Array, secant: Array) -> Array:
    """Slope at every row of the parabola through it and its neighbours, shape `(C, N)`."""
    slope = np.empty((len(secant), len(step) + 1))
    if len(step) == 1:
        slope[:] = secant
        return slope
    before, after = step[:-1], step[1:]
    slope[:, 1:-1] = (after * secant[:, :-1] + before * secant[:, 1:]) / (before + after)
    slope[:, 0] = 2.0 * secant[:, 0] - slope[:, 1]
    slope[:, -1] = 2.0 * secant[:, -1] - slope[:, -2]
    return slope


THINNING_SUPPRESSION = 80.0
"""How far a low-pass before thinning out is down from half the clock's rate on [dB]."""
THINNING_PASSBAND = 0.4
"""Highest frequency that passes it, per rate of the clock."""


@dataclass(frozen=True)
class Lane:
    """Channels that are read alike.

    Attributes:
        channels: Which ones.
        kind: The interpolation.
        lag: How late they were logged [s].
    """

    channels: slice
    kind: Interpolation
    lag: float = 0.0


EVERY_CHANNEL = (Lane(slice(None), CUBIC),)


def sample_count(start: float, stop: float, rate: float) -> int:
    """Samples of the uniform clock from time `start` to time `stop` [s]."""
    return floor((stop - start) * rate + 1e-6) + 1


def uniform(
    rows: Iterable[tuple[Array, Array]], rate: float, lanes: Sequence[Lane] = EVERY_CHANNEL
) -> Iterator[Array]:
    """One segment's channels at times `t[0] + k / rate`.

    Beyond the segment's ends, where lags make it end early, its last values stay.

    Args:
        rows: Time, shape `(N,)` [s], increasing, and channels, shape `(N, C)`; any parts.
        rate: [Hz].
        lanes: All channels, in their order.

    Yields:
        Channels, shape `(C, any)`; `sample_count` samples in all.
    """
    lags = [lane.lag for lane in lanes]
    margin = max(lane.kind.margin for lane in lanes)
    t, x = np.zeros(0), np.zeros((0, 0))
    start, done, begun = 0.0, 0, False
    for new_t, new_x in rows:
        if not begun:
            if len(new_t) == 0:
                continue
            start, begun = float(new_t[0]), True
            t, x = new_t, np.ascontiguousarray(new_x.T)
        else:
            t, x = np.concatenate((t, new_t)), np.concatenate((x, new_x.T), axis=1)
        high = len(t) - 1 - margin
        if high < margin + 2:
            continue
        upto = max(done, ceil((float(t[high]) - max(lags) - start) * rate))
        if upto > done:
            yield _interpolated_at(t, x, start + np.arange(done, upto) / rate, lanes)
            done = upto
        low = int(np.searchsorted(t, start + done / rate + min(lags), side="right")) - 1
        first = max(0, low - margin - 1)
        t, x = t[first:], x[:, first:]
    if len(t):
        upto = sample_count(start, float(t[-1]), rate)
        yield _interpolated_at(t, x, start + np.arange(done, upto) / rate, lanes)


def _interpolated_at(t: Array, x: Array, at: Array, lanes: Sequence[Lane]) -> Array:
    values = [lane.kind(t, x[lane.channels], np.clip(at + lane.lag, t[0], t[-1])) for lane in lanes]
    return values[0] if len(values) == 1 else np.concatenate(values)


@dataclass(frozen=True, eq=False)
class Thinning:
    """A low-pass after which every `factor`-th sample says it all; an operation with a halo.

    Attributes:
        factor: Samples before over samples after.
        bank: The low-pass.
        flags: Number of last channels that are flags: of those near a sample the largest stays.
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
        return cls(factor, Bank(taps[None]), flags)

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return self.bank.halo

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)` to channels `(C, N)`."""
        signals = len(extended) - self.flags
        low: Array = self.bank(extended[:signals])[0]
        if not self.flags:
            return low
        flags = np.abs(extended[signals:])
        near = [
            flags[:, self.halo + shift : extended.shape[1] - self.halo + shift]
            for shift in range(-self.factor, self.factor + 1)
        ]
        return np.concatenate((low, np.max(near, axis=0)))

    def thinned(self, parts: Iterable[Array]) -> Iterator[Array]:
        """Every `factor`-th sample of a segment after the low-pass."""
        at = 0
        for part in apply(self, parts):
            yield part[:, -at % self.factor :: self.factor]
            at += part.shape[1]
