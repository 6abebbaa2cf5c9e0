r"""Rows that were lost while the stamps go on evenly: positions of all joints leap ahead at once.

Where rows are missing, every joint moves as many times farther than from row to row around it as
rows are missing, plus one. With $s_k$ the velocities from one row to the next and $e_k$ the median
of those around, both over each joint's rms velocity, the factor is $m_k = s_k \cdot e_k / e_k^2$.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

AROUND = 4
"""Steps on each side that say how fast joints move."""
LEAP = 2.5
"""Factor from which on rows are missing."""
ALIKE = 0.3
"""Length of what the common factor leaves of the velocities, over theirs."""
SLOW = 0.2
"""Typical velocity, over the rms one, below which missing rows cannot be detected."""


@dataclass(frozen=True, eq=False)
class Leaps:
    """Where positions leap ahead.

    Attributes:
        rows: The rows before, numbers among those given, shape `(k,)`.
        missing: How many rows' time is missing at each, shape `(k,)`.
        moving: Rows at which a leap would have been seen.
    """

    rows: NDArray[np.intp]
    missing: Array
    moving: int


def leaps(t: Array, q: Array) -> Leaps:
    """Leaps of all joints at once; rows that repeat all positions are left out before.

    Args:
        t: Times of the rows, increasing, shape `(N,)` [s].
        q: Positions, shape `(N, n)`.
    """
    none = Leaps(np.zeros(0, dtype=np.intp), np.zeros(0), 0)
    fresh = np.flatnonzero(np.concatenate(([True], (np.diff(q, axis=0) != 0.0).any(axis=1))))
    if len(fresh) < 8 * AROUND:
        return none
    velocity = np.diff(q[fresh], axis=0) / np.diff(t[fresh])[:, None]
    size = np.sqrt(np.mean(np.square(velocity), axis=0))
    velocity = velocity[:, size > 0.0] / size[size > 0.0]
    around = _around(velocity)
    inner = velocity[AROUND:-AROUND]
    square = np.sum(np.square(around), axis=1)
    factor = np.sum(inner * around, axis=1) / np.maximum(square, 1e-300)
    left = np.linalg.norm(inner - factor[:, None] * around, axis=1)
    moving = square > SLOW**2 * velocity.shape[1]
    found = moving & (factor >= LEAP) & (left <= ALIKE * np.linalg.norm(inner, axis=1))
    at = np.flatnonzero(found)
    return Leaps(fresh[at + AROUND], factor[at] - 1.0, int(np.count_nonzero(moving)))


def _around(velocity: Array) -> Array:
    """Median of the velocities before and after each, itself aside, without the ends."""
    windows = np.lib.stride_tricks.sliding_window_view(velocity, 2 * AROUND + 1, axis=0)
    others = np.delete(windows, AROUND, axis=2)
    return np.asarray(np.median(others, axis=2))
