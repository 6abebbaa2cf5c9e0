"""Bounded linear recurrences over samples, the engine of friction with memory."""

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.native.compiled import loops


def recurrence(decay: Array, drive: Array, bound: Array, start: Array) -> tuple[Array, Array]:
    r"""$y_k = \operatorname{clip}(a_k y_{k-1} + b_k, \pm c_k)$, row by row.

    Args:
        decay: $a$, shape `(rows, N)`.
        drive: $b$, shape `(rows, N)`.
        bound: $c$, shape `(rows, N)`.
        start: $y_{-1}$, shape `(rows,)`.

    Returns:
        $y$, shape `(rows, N)`, and its last column, where the next call goes on.
    """
    a, b, c = (np.ascontiguousarray(x, dtype=np.float64) for x in (decay, drive, bound))
    if not a.shape == b.shape == c.shape or start.shape != a.shape[:1]:
        raise ValueError("decay, drive, bound and start differ in shape")
    result, last = np.empty_like(a), np.array(start, dtype=np.float64)
    if result.size:
        addresses = (x.ctypes.data for x in (a, b, c, result))
        loops().recurrence(*addresses, *a.shape, last.ctypes.data)
    return result, last
