r"""Bodies that can exist from numbers that are free: log-Cholesky coordinates [Rucker2022].

A pseudo-inertia in the scale of its prior is $X = U U^T$ with a lower triangular $U$ whose diagonal
is $e^{a_i}$: every choice of the ten coordinates is a body, and zero is the prior.
"""

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.unknowns import ENTRIES, ORDER

_COLUMNS, _ROWS = np.array(ENTRIES).T
"""Of the coordinates in `U`: those of `ENTRIES`, transposed."""

_ON = _ROWS == _COLUMNS

SERIES = 1e-4
"""Coordinate up to which the divergence is taken from its series."""


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


def divergence(coordinates: Array) -> tuple[Array, Array]:
    r"""The entropic distance from the prior as a sum of squares.

    $\mathrm{tr}\,X - \log\det X - 4 = \sum_{i>j} u_{ij}^2 + \sum_i (e^{2 a_i} - 2 a_i - 1)$.

    Args:
        coordinates: Shape `(10,)`.

    Returns:
        Residuals whose squares sum up to it, shape `(10,)`, and the derivative of each by its own
        coordinate, shape `(10,)`.
    """
    residuals, slopes = coordinates.copy(), np.ones(len(coordinates))
    a = coordinates[_ON]
    near = np.abs(a) < SERIES
    root = np.sqrt(np.where(near, 1.0, np.expm1(2.0 * a) - 2.0 * a))
    residuals[_ON] = np.where(near, np.sqrt(2.0) * a * (1.0 + a / 3.0), np.sign(a) * root)
    exact = np.abs(np.expm1(2.0 * a)) / root
    slopes[_ON] = np.where(near, np.sqrt(2.0) * (1.0 + 2.0 * a / 3.0), exact)
    return residuals, slopes
