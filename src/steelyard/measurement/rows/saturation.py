"""Saturation: an effort that is cut off stays at its extreme value, and gets there abruptly."""

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.measurement.rows.outliers import stretches

STAY = 5
"""Rows in a row at the extreme value that are a stay."""
REPEATED = 3.0
"""Stays at the extreme over the rows for which a value is usually held, at least: some drives
report at a lower rate than they are logged."""
ABRUPT = 0.5
"""Step into a stay over the usual step, at least: a smooth peak comes with steps near zero."""
QUANTA = 2.5
"""Step into a stay over the smallest step, at least: a coarse signal's peak comes with one."""
SHARE = 0.25
"""Share of the long stays at the extreme that must be abrupt."""
ENOUGH = 2
"""Abrupt stays at the extreme that are saturation; one may be a pose held at rest."""


class Extremes:
    """The highest and lowest value of each channel and how it stays there, from parts.

    Args:
        channels: Number of channels, C.
    """

    def __init__(self, channels: int) -> None:
        self._sides = [(_Top(), _Top()) for _ in range(channels)]
        self._squares = np.zeros(channels)
        self._changes = np.zeros(channels, dtype=np.int64)
        self._rows = 0
        self._last: Array | None = None

    def add(self, x: Array) -> None:
        """Take in rows of one segment that follow those before, shape `(C, N)`."""
        whole = x if self._last is None else np.concatenate((self._last[:, None], x), axis=1)
        change = np.diff(whole, axis=1)
        self._squares += np.square(change).sum(axis=1)
        self._changes += np.count_nonzero(change, axis=1)
        self._rows += x.shape[1]
        self._last = x[:, -1].copy()
        for (top, bottom), row in zip(self._sides, x, strict=True):
            top.add(row)
            bottom.add(-row)

    def end_segment(self) -> None:
        """What follows does not follow the rows before."""
        self._last = None
        for sides in self._sides:
            for side in sides:
                side.end_stay()

    def limits(self, resolution: Array) -> Array:
        """Lower and upper value at which each channel is cut off, shape `(C, 2)`; NaN for none.

        Args:
            resolution: Smallest step of each channel that is not zero, shape `(C,)`.
        """
        self.end_segment()
        changes = np.maximum(self._changes, 1)
        usual = np.sqrt(self._squares / changes)
        repeats = self._rows / changes
        found = np.full((len(self._sides), 2), np.nan)
        for channel, (top, bottom) in enumerate(self._sides):
            least = max(STAY, REPEATED * repeats[channel])
            step = max(ABRUPT * usual[channel], QUANTA * resolution[channel])
            if bottom.saturated(least, step):
                found[channel, 0] = -bottom.level
            if top.saturated(least, step):
                found[channel, 1] = top.level
        return found


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

    def saturated(self, least: float, step: float) -> bool:
        long = [into for length, into in self._stays if length >= least]
        return sum(into >= step for into in long) >= max(ENOUGH, SHARE * len(long))


def saturated(x: Array, limits: Array) -> NDArray[np.bool_]:
    """Whether rows stay at a limit for `STAY` rows or more, shape `(C, N)`.

    Args:
        x: Channels, shape `(C, N)`.
        limits: Lower and upper limits, shape `(C, 2)`; NaN for none.
    """
    marks = np.zeros(x.shape, dtype=np.bool_)
    for channel in np.flatnonzero(~np.isnan(limits).all(axis=1)).tolist():
        for limit in limits[channel]:
            for start, stop in stretches(x[channel] == limit):
                marks[channel, start:stop] |= stop - start >= STAY
    return marks
