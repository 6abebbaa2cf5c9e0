"""From rows at uneven times to a uniform clock, by local cubic interpolation.

Between two rows runs the cubic that has their values and, as slopes there, those of the parabola
through each row and its neighbours. It is exact for parabolas, has a continuous slope, and needs
one row beyond each end of an interval, so it works by parts.
"""

from collections.abc import Iterable, Iterator
from math import ceil, floor

import numpy as np

from steelyard.arrays import Array


def sample_count(start: float, stop: float, rate: float) -> int:
    """Samples of the uniform clock from time `start` to time `stop` [s]."""
    return floor((stop - start) * rate + 1e-6) + 1


def uniform(rows: Iterable[tuple[Array, Array]], rate: float) -> Iterator[Array]:
    """One segment's channels at times `t[0] + k / rate`.

    Args:
        rows: Time, shape `(N,)` [s], increasing, and channels, shape `(N, C)`; any parts.
        rate: [Hz].

    Yields:
        Channels, shape `(C, any)`; `sample_count` samples in all.
    """
    t, x = np.zeros(0), np.zeros((0, 0))
    start, done, first = 0.0, 0, True
    for new_t, new_x in rows:
        if len(t) == 0 and first:
            start = float(new_t[0]) if len(new_t) else start
            t, x = new_t, np.ascontiguousarray(new_x.T)
        else:
            t, x = np.concatenate((t, new_t)), np.concatenate((x, new_x.T), axis=1)
        low, high = (0 if first else 1), len(t) - 2
        if high - low < 2:
            continue
        upto = max(done, ceil((float(t[high]) - start) * rate))
        yield _interpolated(t, x, start + np.arange(done, upto) / rate)
        done, first = upto, False
        t, x = t[high - 1 :], x[:, high - 1 :]
    if len(t):
        upto = sample_count(start, float(t[-1]), rate)
        yield _interpolated(t, x, np.minimum(start + np.arange(done, upto) / rate, t[-1]))


def _interpolated(t: Array, x: Array, at: Array) -> Array:
    """Channels `x`, shape `(C, N)`, known at `t`, at other times inside: shape `(C, len(at))`."""
    if len(t) == 1:
        return np.repeat(x, len(at), axis=1)
    step = np.diff(t)
    secant = np.diff(x, axis=1) / step
    slope = _slopes(step, secant)
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(step) - 1)
    h = step[i]
    u = (at - t[i]) / h
    a = slope[:, i] - secant[:, i]
    b = secant[:, i] - slope[:, i + 1]
    blend: Array = x[:, i] + u * h * (secant[:, i] + (1.0 - u) * ((1.0 - u) * a + u * b))
    return blend


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
