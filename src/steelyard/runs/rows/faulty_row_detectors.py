r"""Faulty rows of a recording: broken values, outliers, saturated efforts, repeated positions.

A row is an outlier of its channel if it is far from the median of the nine rows around it, a
trend taken out (Hampel's identifier [Hampel1974]): further than `threshold` times the channel's
usual distance, and than `threshold` times the usual distance of those nine rows, $1.4826$ times the
median of absolute deviations. The trend runs through the medians of the first and of the last three
rows; steps and corners widen the deviations around them and are no outliers.
"""

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, stretches
from steelyard.runs.recording import Channels

LARGEST_VALUE = 1e8
"""Largest value that any channel can have in SI units: memory garbage is far above."""
FASTEST_LOGGED_SPEED = 60.0
"""Largest joint speed [rad/s; m/s]: a little more than the flange of a SCARA robot reaches."""
FASTEST_STEADY_SPEED = 20.0
"""Largest joint speed over more than one step of the clock, where jitter matters less."""


class RowVerdict(IntEnum):
    """What became of a row, and the `reason` why it was dropped, for reports."""

    KEPT = 0, "kept"
    UNREADABLE = 1, "a cell that is missing or not a number"
    ABSURD = 2, "an implausible value"
    EMPTY = 3, "no signal of the joints, as of other topics"
    REPEATED = 4, "a repeated time stamp"
    BACKWARD = 5, "a time stamp before the previous one"
    JUMP = 6, "a single jump of time or position"
    LEFT_OUT = 7, "a frozen position"

    reason: str

    def __new__(cls, number: int, reason: str = "") -> "RowVerdict":  # noqa: D102
        verdict = int.__new__(cls, number)
        verdict._value_, verdict.reason = number, reason
        return verdict


def broken_rows(t: Array, x: Array, channels: Channels) -> NDArray[np.uint8]:
    """What a row `(N, C)` is by itself: `KEPT`, `UNREADABLE`, `ABSURD` or `EMPTY`, shape `(N,)`."""
    verdict = np.zeros(len(t), dtype=np.uint8)
    with np.errstate(invalid="ignore"):
        absurd = ~np.isfinite(t) | (np.abs(x) > LARGEST_VALUE).any(axis=1)
        if channels.velocities:
            absurd |= (np.abs(x[:, channels.dq]) > FASTEST_LOGGED_SPEED).any(axis=1)
    verdict[absurd] = RowVerdict.ABSURD
    missing = np.isnan(x)
    verdict[np.isnan(t) | missing.any(axis=1)] = RowVerdict.UNREADABLE
    verdict[np.isfinite(t) & missing.all(axis=1)] = RowVerdict.EMPTY
    return verdict


MEDIAN_SIDE_ROWS = 4  # rows on each side that the median is taken over
LONGEST_SPIKE = 3  # rows in a row that can be one spike; more are a signal
STD_OVER_MAD = 1.4826  # standard deviation over median absolute deviation, for Gaussian noise
TAIL_QUANTILE = 0.90, 1.645
"""A quantile of absolute deviations, and what it is of Gaussian noise: coarse signals rest at a
median deviation of zero, and efforts have heavy tails that are no spikes."""
LEAST_USUAL_DISTANCE = 1e-5  # least usual distance, as a share of the channel's range
SENSOR_STEP_QUANTILE = 0.05
"""Quantile of the changes of a channel that is its sensor's step; smaller ones are rounding."""
ROWS_FOR_USUAL, WINDOWS_FOR_USUAL = 20_000, 5_000
"""Rows that usual distances are learnt from, and rows among them, evenly spread, that are looked at
with their neighbours."""
JOLT_QUANTILE, JOLT_RATIO = 0.99, 2.0
"""Second difference of a position over the one it exceeds 1 % of the time, from which on an effort
that stands out is no outlier: the motion jolted."""


def usual_distance(x: Array) -> Array:
    """How far rows of channels `(C, N)` are usually from the median around them, `(C,)`."""
    x = x[:, :ROWS_FOR_USUAL]
    if x.shape[1] <= 2 * MEDIAN_SIDE_ROWS:
        return np.full(len(x), np.inf)
    usual = np.empty(len(x))
    for channel, row in enumerate(x):
        windows = np.lib.stride_tricks.sliding_window_view(row, 2 * MEDIAN_SIDE_ROWS + 1)
        far = _distances(windows[:: -(-len(windows) // WINDOWS_FOR_USUAL)])[0]
        usual[channel] = max(
            STD_OVER_MAD * np.median(far),
            np.quantile(far, TAIL_QUANTILE[0]) / TAIL_QUANTILE[1],
            LEAST_USUAL_DISTANCE * np.diff(np.quantile(row, (0.005, 0.995)))[0],
        )
    return np.maximum(usual, sensor_step(x))


def sensor_step(x: Array) -> Array:
    """The step of the sensor of each channel of `(C, N)`; infinite if it never changes, `(C,)`."""
    moves = [change[change > 0.0] for change in np.abs(np.diff(x, axis=1))]
    return np.array([np.quantile(m, SENSOR_STEP_QUANTILE) if len(m) else np.inf for m in moves])


def outlying(x: Array, usual: Array, threshold: float) -> NDArray[np.bool_]:
    """Whether each row of each channel is an outlier, shape `(C, N)`.

    It is from `threshold` times the `usual` distance on. The first and last `SIDE + LONGEST` rows
    are judged without all their neighbours.
    """
    marks = np.zeros(x.shape, dtype=np.bool_)
    if x.shape[1] <= 2 * MEDIAN_SIDE_ROWS:
        return marks
    far = threshold * usual
    channel, row = np.nonzero(_bent(x, 0.5 * far))
    inside = (row >= MEDIAN_SIDE_ROWS) & (row < x.shape[1] - MEDIAN_SIDE_ROWS)
    channel, row = channel[inside], row[inside]
    windows = x[channel[:, None], row[:, None] + np.arange(-MEDIAN_SIDE_ROWS, MEDIAN_SIDE_ROWS + 1)]
    distance, around = _distances(windows)
    spike = distance > np.maximum(far[channel], threshold * around)
    marks[channel[spike], row[spike]] = True
    return without_long(marks, LONGEST_SPIKE)


def _distances(windows: Array) -> tuple[Array, Array]:
    """How far each window's middle is from its median, and others usually; of `(M, 2 SIDE + 1)`."""
    rise = _medians(windows[:, -3:]) - _medians(windows[:, :3])
    level = windows - rise[:, None] * (
        np.arange(-MEDIAN_SIDE_ROWS, MEDIAN_SIDE_ROWS + 1) / (2.0 * (MEDIAN_SIDE_ROWS - 1))
    )
    away = np.abs(level - _medians(level)[:, None])
    return away[:, MEDIAN_SIDE_ROWS], STD_OVER_MAD * _medians(away)


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
    for shift in range(3):
        near[:, shift : shift + sharp.shape[1]] |= sharp
    return near


def without_long(marks: NDArray[np.bool_], longest: int) -> NDArray[np.bool_]:
    """The marks without those that stand more than `longest` in a row, shape `(C, N)`."""
    if not marks.any():
        return marks
    from scipy.ndimage import binary_opening

    return np.asarray(marks & ~binary_opening(marks, np.ones((1, longest + 1))))


def usual_bend(q: Array) -> Array:
    """Second difference that each position of `(n, N)` exceeds 1 % of the time, shape `(n,)`."""
    second = np.abs(np.diff(q[:, :ROWS_FOR_USUAL], n=2, axis=1))
    if second.shape[1] == 0:
        return np.full(len(q), np.inf)
    return np.quantile(second, JOLT_QUANTILE, axis=1)


def jolted(q: Array, bend: Array) -> NDArray[np.bool_]:
    """Rows at or next to which a joint jolts, `(N,)`; positions `(n, N)` are without outliers."""
    from scipy.ndimage import binary_dilation

    sharp = (np.abs(np.diff(q, n=2, axis=1)) > JOLT_RATIO * bend[:, None]).any(axis=0)
    return np.asarray(binary_dilation(np.pad(sharp, 1), np.ones(2 * LONGEST_SPIKE + 1)))


def bridged(t: Array, x: Array, marks: NDArray[np.bool_], smooth: Sequence[int]) -> Array:
    """The channels `(C, N)` with marked rows interpolated between their neighbours.

    Channels in `smooth` take the cubic through two neighbours on each side; others take the
    straight line between two.
    """
    filled = x.copy() if marks.any() else x
    for channel in np.flatnonzero(marks.any(axis=1) & ~marks.all(axis=1)).tolist():
        known, rows = np.flatnonzero(~marks[channel]), np.flatnonzero(marks[channel])
        filled[channel, rows] = np.interp(t[rows], t[known], x[channel, known])
        if channel in smooth:
            after = np.searchsorted(known, rows)
            inside = (after >= 2) & (after <= len(known) - 2)
            points, rows = known[after[inside, None] + np.arange(-2, 2)], rows[inside]
            filled[channel, rows] = _through(t[points], x[channel, points], t[rows])
    return filled


def _through(t: Array, values: Array, at: Array) -> Array:
    """Lagrange's polynomials through some points each, `(M, 4)`, at one other time each, `(M,)`."""
    result = np.zeros_like(at)
    for k in range(t.shape[1]):
        others = np.delete(t, k, axis=1)
        result += values[:, k] * np.prod((at[:, None] - others) / (t[:, [k]] - others), axis=1)
    return result


ROWS_OF_STAY = 5  # rows in a row at the extreme value that are a stay
STAY_OVER_USUAL = 3.0
"""Stays at the extreme over the rows for which a value is usually held, at least: some drives
report at a lower rate than they are logged."""
ABRUPT_STEP = 0.5
"""Step into a stay over the usual step, at least: a smooth peak comes with steps near zero."""
ABRUPT_QUANTA = 2.5
"""Step into a stay over the smallest step, at least: a coarse signal's peak comes with one."""
ABRUPT_SHARE = 0.25  # share of the long stays at the extreme that must be abrupt
ABRUPT_STAYS = 2  # abrupt stays at the extreme that are saturation; one may be a pose held at rest


class Extremes:
    """The highest and lowest value of each channel and how it stays there, from parts."""

    def __init__(self, channels: int) -> None:
        self._tops = [_Top() for _ in range(2 * channels)]  # of the channels, then upside down
        self._squares = np.zeros(channels)
        self._changes = np.zeros(channels, dtype=np.int64)
        self._rows = 0
        self._last = np.zeros((channels, 0))

    def add(self, x: Array) -> None:
        """Take in rows of one segment that follow those before, shape `(C, N)`."""
        change = np.diff(np.concatenate((self._last, x), axis=1), axis=1)
        self._squares += np.square(change).sum(axis=1)
        self._changes += np.count_nonzero(change, axis=1)
        self._rows += x.shape[1]
        self._last = x[:, -1:].copy()
        for top, row in zip(self._tops, np.concatenate((x, -x)), strict=True):
            top.add(row)

    def end_segment(self) -> None:
        """What follows does not follow the rows before."""
        self._last = self._last[:, :0]
        for top in self._tops:
            top.end_stay()

    def limits(self, resolution: Array) -> Array:
        """Lower and upper value at which each channel is cut off, shape `(C, 2)`; NaN for none.

        `resolution`: smallest step of each channel that is not zero, shape `(C,)`.
        """
        self.end_segment()
        changes = np.maximum(self._changes, 1)
        least = np.maximum(ROWS_OF_STAY, STAY_OVER_USUAL * (self._rows / changes))
        usual = np.sqrt(self._squares / changes)
        step = np.maximum(ABRUPT_STEP * usual, ABRUPT_QUANTA * resolution)
        known = np.tile((least, step), 2).T
        high, low = np.reshape(
            [t.limit(*k) for t, k in zip(self._tops, known, strict=True)], (2, -1)
        )
        return np.column_stack((-low, high))


class _Top:
    """The highest value of one channel, and its stays there: length and the step into each."""

    MOST = 1000

    def __init__(self) -> None:
        self.level = -np.inf
        self._stays: list[tuple[int, float]] = []
        self._open: tuple[int, float] | None = None
        self._before = np.nan

    def add(self, row: Array) -> None:
        highest = float(row.max(initial=-np.inf))
        if highest > self.level:
            self.level, self._stays, self._open = highest, [], None
        if highest == self.level:
            for start, stop in stretches(row == self.level):
                if start > 0 or self._open is None:
                    self.end_stay()
                    before = float(row[start - 1]) if start > 0 else self._before
                    self._open = 0, self.level - before
                self._open = self._open[0] + stop - start, self._open[1]
                if stop < len(row):
                    self.end_stay()
        elif self._open is not None:
            self.end_stay()
        self._before = float(row[-1]) if len(row) else self._before

    def end_stay(self) -> None:
        if self._open is not None and len(self._stays) < self.MOST:
            self._stays.append(self._open)
        self._open, self._before = None, np.nan

    def limit(self, least: float, step: float) -> float:
        """The value, if it is stayed at for `least` rows and entered by a `step`; NaN else."""
        long = [into for length, into in self._stays if length >= least]
        abrupt = sum(into >= step for into in long)
        return self.level if abrupt >= max(ABRUPT_STAYS, ABRUPT_SHARE * len(long)) else np.nan


def saturated(x: Array, limits: Array) -> NDArray[np.bool_]:
    """Whether rows `(C, N)` stay at one of the limits `(C, 2)` for `ROWS_OF_STAY` rows or more."""
    low, high = (x == limit[:, None] for limit in limits.T)
    short = without_long(low, ROWS_OF_STAY - 1) | without_long(high, ROWS_OF_STAY - 1)
    return np.asarray((low | high) & ~short)


MOVED_STEPS = 3.0  # steps of the sensor that a joint must be expected to move from row to row
LONGEST_STALE = 4
"""Rows in a row that can be stale; more are a rest, or a gap that is not to be guessed across."""


def stale_rows(q: Array, step: Array) -> NDArray[np.bool_]:
    """Whether each row of `(n, N)` repeats all positions of the row before though a joint moves."""
    marks = np.zeros(q.shape[1], dtype=np.bool_)
    rows = np.flatnonzero((q[:, 1:] == q[:, :-1]).all(axis=0)) + 1
    rows = rows[(rows >= LONGEST_STALE + 1) & (rows < q.shape[1] - LONGEST_STALE - 1)]
    if len(rows) == 0:
        return marks
    reach = LONGEST_STALE + 1
    ahead, behind = (np.abs(q[:, rows + side] - q[:, rows]) for side in (reach, -reach))
    pace = np.minimum(ahead, behind) / reach
    marks[rows[(pace > MOVED_STEPS * step[:, None]).any(axis=0)]] = True
    return np.asarray(without_long(marks[None], LONGEST_STALE)[0])
