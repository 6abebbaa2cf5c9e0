"""Velocities that are differences of logged positions: half a row late, and nothing new."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

SAME = 0.1
"""Distance from a difference, over the noise that the difference has from its positions, below
which a velocity is that difference: a velocity that was measured does not have this noise."""
FEWEST = 50
"""Rows in motion from which on there is a finding."""
SLOW = 0.05
"""Share of the fastest below which a joint rests."""
SCALE = 0.05
"""How far the step that differences were divided by may be off the clock's."""
ROUNDING = 1e-6
"""The same over the velocities, where positions have no noise."""


def one_sided(t: Array, q: Array, dq: Array) -> NDArray[np.bool_]:
    """Whether each velocity is the difference of its row's position and a neighbour's.

    Args:
        t: Times of the rows, increasing, shape `(N,)` [s].
        q: Positions, shape `(N, n)`.
        dq: Velocities in their unit per second, shape `(N, n)`.

    Returns:
        Shape `(n,)`.
    """
    if len(t) < FEWEST:
        return np.zeros(q.shape[1], dtype=np.bool_)
    steps, change = np.diff(t)[:, None], np.diff(q, axis=0)
    slopes = (change / steps, change / np.median(steps))
    return np.array([_is_one([x[:, j] for x in slopes], dq[:, j]) for j in range(q.shape[1])])


def _is_one(slopes: Sequence[Array], dq: Array) -> bool:
    """Whether a velocity, shape `(N,)`, is a slope of its rows, `(N - 1,)`, where it moves.

    Args:
        slopes: By the stamps, and by even ones.
        dq: The velocity.
    """
    fast = np.abs(slopes[0]) > SLOW * np.quantile(np.abs(slopes[0]), 0.98)
    fast &= slopes[1] != 0.0
    if np.count_nonzero(fast) < FEWEST:
        return False
    noise = min(float(np.median(np.square(np.diff(x, n=2))[fast[1:-1]])) for x in slopes)
    size = float(np.sqrt(np.mean(np.square(dq))))
    bound = max(SAME * np.sqrt(noise / 6.0), ROUNDING * size)
    pairs = [(logged, slope) for logged in (dq[1:], dq[:-1]) for slope in slopes]
    return any(_distance(x[fast], slope[fast]) <= bound for x, slope in pairs)


def _distance(dq: Array, slope: Array) -> float:
    """Distance of nine rows in ten, up to a factor near one for the step that was divided by."""
    factor = np.clip(np.median(dq / slope), 1.0 - SCALE, 1.0 + SCALE)
    return float(np.quantile(np.abs(dq - factor * slope), 0.9))
