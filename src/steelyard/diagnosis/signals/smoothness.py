r"""Noise of signals of any shape, by divided differences over few rows.

A divided difference $\sum_i w_i x_i$ over `ORDER + 1` rows vanishes for polynomials below that
order; of white noise it has the standard deviation $\sigma \|w\|$. What is left of a smooth signal
falls with the `ORDER`-th power of the rows' distance, so noise far below what varies is measured.
"""

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

ORDER = 6
"""Of the differences."""


def noise_levels(t: Array, x: Array, moving: NDArray[np.bool_]) -> Array:
    """Standard deviation of the white noise of each signal while its joint moves.

    The rows' distance in time is taken once from the stamps and once as even, for stamps may
    jitter although rows are even; the lower noise of both counts. The median makes jumps and gaps
    harmless.

    Args:
        t: Times of the rows, increasing, shape `(N,)`.
        x: Signals, shape `(N, n)`.
        moving: Whether each joint moves, shape `(N, n)`.

    Returns:
        Shape `(n,)`; NaN of signals that have fewer than `10 * ORDER` rows in motion, or of which
        more than a tenth of these repeat the row before: they are quantised too coarsely.
    """
    levels = np.full(x.shape[1], np.nan)
    if len(t) <= ORDER:
        return levels
    found = [np.abs(_difference(s, x)) for s in (t, np.arange(float(len(t))))]
    inside = moving[ORDER // 2 : len(t) - ORDER // 2]
    same = np.diff(x, axis=0, prepend=np.nan) == 0.0
    for j in range(x.shape[1]):
        mine = inside[:, j]
        if mine.sum() >= 10 * ORDER and same[moving[:, j], j].mean() <= 0.1:
            levels[j] = 1.4826 * min(float(np.median(d[mine, j])) for d in found)
    return levels


def _difference(t: Array, x: Array) -> Array:
    """Divided differences with weights of unit length, shape `(N - ORDER, n)`."""
    count = len(t) - ORDER
    at = np.lib.stride_tricks.sliding_window_view(t, ORDER + 1)
    at = at / np.maximum((at[:, -1:] - at[:, :1]) / ORDER, 1e-300)
    apart = at[:, :, None] - at[:, None, :] + np.eye(ORDER + 1)
    weights = 1.0 / np.prod(apart, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray(sum(weights[:, [i]] * x[i : i + count] for i in range(ORDER + 1)))
