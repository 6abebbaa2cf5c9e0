r"""Physically consistent bodies from numbers that are free: log-Cholesky coordinates [Rucker2022].

A pseudo-inertia in the scale of its prior is $X = U U^T$ with a lower triangular $U$ whose diagonal
is $e^{a_i}$: every choice of the ten coordinates is a body, and zero is the prior.
"""

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.consistent.unknowns import ENTRIES, ORDER

_COLUMNS, _ROWS = np.array(ENTRIES).T
"""Of the coordinates in `U`: those of `ENTRIES`, transposed."""

_ON = _ROWS == _COLUMNS


def entries(coordinates: Array) -> tuple[Array, Array]:
    """Entries of `X`, as `ENTRIES` has them, shape `(10,)`, and their derivatives `(10, 10)`.

    Args:
        coordinates: Shape `(10,)`.
    """
    triangle = np.zeros((ORDER, ORDER))
    triangle[_ROWS, _COLUMNS] = np.where(_ON, np.exp(coordinates), coordinates)
    slopes = np.empty((len(ENTRIES), len(ENTRIES)))
    for k, (row, column) in enumerate(zip(_ROWS, _COLUMNS, strict=True)):
        change = np.zeros((ORDER, ORDER))
        change[row] = (triangle[row, row] if row == column else 1.0) * triangle[:, column]
        slopes[:, k] = (change + change.T)[_COLUMNS, _ROWS]
    return (triangle @ triangle.T)[_COLUMNS, _ROWS], slopes
