r"""Outliers: spikes of up to three rows, found robustly and bridged.

A row is an outlier of its channel if it is far from the median of the nine rows around it, a
trend taken out (Hampel's identifier [Hampel1974]): further than `threshold` times the channel's
usual distance, and than `threshold` times the usual distance of those nine rows, $1.4826$ times the
median of absolute deviations. The trend runs through the medians of the first and of the last three
rows; steps and corners widen the deviations around them and are no outliers.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

SIDE = 4
"""Rows on each side that the median is taken over."""
LONGEST = 3
"""Rows in a row that can be one spike; more are a signal."""
USUAL = 1.4826
"""Standard deviation over median absolute deviation, for Gaussian noise."""
TAIL = 0.90, 1.645
"""A quantile of absolute deviations, and what it is of Gaussian noise: coarse signals rest at a
median deviation of zero, and efforts have heavy tails that are no spikes."""
SMALLEST = 1e-5
"""Least usual distance, as a share of the channel's range."""
FINE = 0.05
"""Quantile of the changes of a channel that is its sensor's step; smaller ones are rounding."""
LEARNT_FROM = 20_000
"""Rows that usual distances are learnt from."""
OFTEN, JOLT = 0.99, 2.0
"""Second difference of a position over the one it exceeds 1 % of the time, from which on an effort
that stands out is no outlier: the motion jolted."""


def usual_distance(x: Array) -> Array:
    """How far rows are usually from the median around them, shape `(C,)`.

    Args:
        x: Channels, shape `(C, N)`.
    """
    x = x[:, :LEARNT_FROM]
    if x.shape[1] <= 2 * SIDE:
        return np.full(len(x), np.inf)
    usual = np.empty(len(x))
    for channel, row in enumerate(x):
        windows = np.lib.stride_tricks.sliding_window_view(row, 2 * SIDE + 1)
        far = _distances(windows)[0]
        spread = np.diff(np.quantile(row, (0.005, 0.995)))[0]
        usual[channel] = max(
            USUAL * np.median(far), np.quantile(far, TAIL[0]) / TAIL[1], SMALLEST * spread
        )
    return np.maximum(usual, sensor_step(x))


def sensor_step(x: Array) -> Array:
    """The step of each channel's sensor as rows show it; infinite if it never changes, `(C,)`.

    Args:
        x: Channels, shape `(C, N)`.
    """
    change = np.abs(np.diff(x, axis=1))
    steps = [float(np.quantile(c[c > 0.0], FINE)) if c.any() else np.inf for c in change]
    return np.array(steps)


def outlying(x: Array, usual: Array, threshold: float) -> NDArray[np.bool_]:
    """Whether each row of each channel is an outlier, shape `(C, N)`.

    The first and last `SIDE + LONGEST` rows are judged without all their neighbours.

    Args:
        x: Channels, shape `(C, N)`.
        usual: See `usual_distance`, shape `(C,)`.
        threshold: Distance in usual ones from which on a row is an outlier.
    """
    marks = np.zeros(x.shape, dtype=np.bool_)
    if x.shape[1] <= 2 * SIDE:
        return marks
    far = threshold * usual
    channel, row = np.nonzero(_bent(x, 0.5 * far))
    inside = (row >= SIDE) & (row < x.shape[1] - SIDE)
    channel, row = channel[inside], row[inside]
    windows = x[channel[:, None], row[:, None] + np.arange(-SIDE, SIDE + 1)]
    distance, around = _distances(windows)
    spike = distance > np.maximum(far[channel], threshold * around)
    marks[channel[spike], row[spike]] = True
    return without_long(marks, LONGEST)


def _distances(windows: Array) -> tuple[Array, Array]:
    """How far the middle of each window is from its median, and the others usually, `(M,)` each.

    Args:
        windows: Shape `(M, 2 SIDE + 1)`.
    """
    rise = _medians(windows[:, -3:]) - _medians(windows[:, :3])
    level = windows - rise[:, None] * (np.arange(-SIDE, SIDE + 1) / (2.0 * (SIDE - 1)))
    away = np.abs(level - _medians(level)[:, None])
    return away[:, SIDE], USUAL * _medians(away)


def _medians(rows: Array) -> Array:
    """Median of each row of an odd number of finite values, `(M,)`: sorting is what is fast."""
    return np.asarray(np.sort(rows, axis=1)[:, rows.shape[1] // 2])


def _bent(x: Array, bend: Array) -> NDArray[np.bool_]:
    """Rows that a spike twice as high as `bend` can be at, by their second differences."""
    second = x[:, 2:] - 2.0 * x[:, 1:-1]
    second += x[:, :-2]
    np.abs(second, out=second)
    sharp = second > bend[:, None]
    near = np.zeros(x.shape, dtype=np.bool_)
    if sharp.any():
        for shift in range(3):
            near[:, shift : shift + sharp.shape[1]] |= sharp
    return near


def without_long(marks: NDArray[np.bool_], longest: int) -> NDArray[np.bool_]:
    """The marks without those that stand more than `longest` in a row, shape `(C, N)`."""
    if not marks.any():
        return marks
    kept = marks.copy()
    for channel in np.flatnonzero(marks.any(axis=1)):
        for start, stop in stretches(marks[channel]):
            if stop - start > longest:
                kept[channel, start:stop] = False
    return kept


def usual_bend(q: Array) -> Array:
    """Second difference that each position exceeds 1 % of the time, shape `(n,)`.

    Args:
        q: Positions, shape `(n, N)`.
    """
    second = np.abs(np.diff(q[:, :LEARNT_FROM], n=2, axis=1))
    return np.quantile(second, OFTEN, axis=1) if second.shape[1] else np.full(len(q), np.inf)


def jolted(q: Array, bend: Array) -> NDArray[np.bool_]:
    """Rows at or next to which some joint jolts, shape `(N,)`.

    Args:
        q: Positions without outliers, shape `(n, N)`.
        bend: See `usual_bend`, shape `(n,)`.
    """
    sharp = (np.abs(np.diff(q, n=2, axis=1)) > JOLT * bend[:, None]).any(axis=0)
    near = np.zeros(q.shape[1], dtype=np.bool_)
    for start, stop in stretches(np.atleast_1d(sharp)):
        near[max(0, start + 1 - LONGEST) : stop + 1 + LONGEST] = True
    return near


def stretches(marks: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First row and the row after the last one of all stretches that are marked."""
    edges = np.flatnonzero(np.diff(marks, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def bridged(t: Array, x: Array, marks: NDArray[np.bool_], smooth: Sequence[int]) -> Array:
    """The channels with marked rows interpolated between their neighbours.

    Args:
        t: Time, shape `(N,)` [s].
        x: Channels, shape `(C, N)`.
        marks: Which rows are not to be believed, shape `(C, N)`.
        smooth: Channels that take the cubic through two neighbours on each side; others take the
            straight line between two.
    """
    if not marks.any():
        return x
    filled = x.copy()
    some = np.flatnonzero(marks.any(axis=1))
    before, after = _neighbours(marks[some])
    of, row = np.nonzero(marks[some])
    channel, low, high = some[of], before[of, row], after[of, row]
    low, high = np.where(low < 0, high, low), np.where(high == len(t), low, high)
    known = (low >= 0) & (high < len(t))
    of, channel, row, low, high = (v[known] for v in (of, channel, row, low, high))
    span = np.where(high > low, t[high] - t[low], 1.0)
    share = (t[row] - t[low]) / span
    filled[channel, row] = (1.0 - share) * x[channel, low] + share * x[channel, high]
    lower, higher = before[of, low - 1], after[of, np.minimum(high + 1, len(t) - 1)]
    cubic = np.isin(channel, list(smooth)) & (high > low) & (low > 0) & (high < len(t) - 1)
    cubic &= (lower >= 0) & (higher < len(t))
    points = np.stack([v[cubic] for v in (lower, low, high, higher)], axis=1)
    channel, row = channel[cubic], row[cubic]
    filled[channel, row] = _through(t[points], x[channel[:, None], points], t[row])
    return filled


def _neighbours(marks: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The nearest rows up to and from each row on that are not marked; -1 and N where none is."""
    rows = np.arange(marks.shape[1])
    before = np.maximum.accumulate(np.where(marks, -1, rows), axis=1)
    after = np.minimum.accumulate(np.where(marks, len(rows), rows)[:, ::-1], axis=1)[:, ::-1]
    return before, after


def _through(t: Array, values: Array, at: Array) -> Array:
    """Lagrange's polynomials through some points each, at one other time each.

    Args:
        t: Times, shape `(M, 4)` [s].
        values: Shape `(M, 4)`.
        at: Shape `(M,)` [s].
    """
    result = np.zeros_like(at)
    for k in range(t.shape[1]):
        others = [j for j in range(t.shape[1]) if j != k]
        base = np.prod((at[:, None] - t[:, others]) / (t[:, [k]] - t[:, others]), axis=1)
        result += values[:, k] * base
    return result
