"""Zero-order hold: channels that are new only every n-th row of a log."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.finding import Picture, Trace

STEPS = 3.0
"""Steps of its sensor by which a channel changes before and after a stretch that counts: neither
rest nor a sensor too coarse for the motion makes such ones."""
FEWEST, MOST = 100, 0.9
"""Fewest stretches, and the share of them that has one length where samples are held."""
SHOWN = 20
"""Longest stretch that is shown [rows]."""


@dataclass(frozen=True, eq=False)
class Hold:
    """How long some channels keep a value.

    Attributes:
        lengths: Of stretches of one value between two clear changes, of all channels [rows].
        every: Rows from one new sample to the next; 1 if samples are not held.
        share: Of the stretches that have the commonest length, in [0, 1].
    """

    lengths: NDArray[np.intp]
    every: int
    share: float

    @property
    def value_text(self) -> str:
        """The evidence in words."""
        return (
            f"{100.0 * self.share:.3g} % of {len(self.lengths)} clear changes come {self.every} "
            f"rows after the one before, regular from {100.0 * MOST:g} % on"
        )

    @property
    def picture(self) -> Picture:
        """How often each length occurs."""
        rows = np.arange(1, max(SHOWN, 2 * self.every) + 1)
        count = np.bincount(np.minimum(self.lengths, rows[-1]), minlength=len(rows) + 1)[1:]
        bars = Trace("stretches", rows.astype(np.float64), count.astype(np.float64), "bars")
        return Picture("rows with one value", "stretches", (bars,))


def hold(x: Array, step: Array) -> Hold:
    """How long channels keep a value.

    Args:
        x: Channels, shape `(N, c)`.
        step: Smallest change of each, shape `(c,)`.
    """
    lengths = np.concatenate([_stretches(*channel) for channel in zip(x.T, step, strict=True)])
    if len(lengths) < FEWEST:
        return Hold(lengths, 1, 0.0)
    count = np.bincount(lengths)
    every = int(count.argmax())
    share = float(count[every]) / len(lengths)
    return Hold(lengths, every if share >= MOST else 1, share)


def old_rows(x: Array) -> NDArray[np.bool_]:
    """Whether each row has all values of the row before, shape `(N,)`."""
    return np.concatenate(([False], (x[1:] == x[:-1]).all(axis=1)))


def mean_age(x: Array, updates: Hold, rows: NDArray[np.bool_]) -> float:
    """How many rows ago values were new on average, at rest left out [rows].

    Args:
        x: Channels, shape `(N, c)`.
        updates: How long they keep a value.
        rows: Rows that count also where values are old, shape `(N,)`.
    """
    row = np.arange(len(x))[:, None]
    new = np.concatenate((np.ones((1, x.shape[1]), dtype=np.bool_), x[1:] != x[:-1]))
    age = row - np.maximum.accumulate(np.where(new, row, 0), axis=0)
    return float(age[(age < updates.every) & (rows[:, None] | (age == 0))].mean())


def _stretches(x: Array, step: float) -> NDArray[np.intp]:
    """Lengths of stretches of one value between two clear changes of a channel [rows]."""
    change = np.abs(np.diff(x))
    rows = np.flatnonzero(change)
    clear = change[rows] >= STEPS * step
    lengths: NDArray[np.intp] = np.diff(rows)[clear[1:] & clear[:-1]]
    return lengths
