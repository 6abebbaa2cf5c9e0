r"""Exact extremes of piecewise polynomials.

A polynomial on $[0, 1]$ lies between the least and the greatest of its Bernstein coefficients, and
the first and the last of them are values of it. Halving the interval brings both together
quadratically; a half whose coefficients stay below a value already found is done with
[Farouki2012]. What remains is a bound over all times that no sample exceeds and one attains.
"""

from functools import lru_cache
from math import comb, perm

import numpy as np

from steelyard.arrays import Array

_HALVINGS = 60
_EPSILON = float(np.finfo(np.float64).eps)


def polynomial_extremes(pieces: Array) -> tuple[Array, Array]:
    r"""Least and greatest value of $\sum_i a_i \tau^i$ over all pieces and $0 \le \tau \le 1$.

    Args:
        pieces: Coefficients `a`, ascending, shape `(p, d + 1, n)`.

    Returns:
        Two arrays of shape `(n,)`, rounded away from each other.
    """
    degree, joints = pieces.shape[1] - 1, pieces.shape[2]
    points = np.einsum("ji,pin->pnj", _to_bernstein(degree), pieces)
    rounding = 8 * (degree + 1) * np.abs(pieces).sum(axis=1).max(axis=0)
    slack = _EPSILON * (rounding + 128 * np.abs(points).max(axis=(0, 2)))
    top = _greatest(np.concatenate([points, -points], axis=1), np.tile(slack, 2))
    return -top[joints:], top[:joints]


def _greatest(points: Array, slack: Array) -> Array:
    """The greatest value of Bernstein polynomials `(p, k, d + 1)` per column, shape `(k,)`."""
    columns, degree = points.shape[1], points.shape[2] - 1
    best = points[:, :, [0, -1]].max(axis=(0, 2))
    owner = np.tile(np.arange(columns), len(points))
    rows = points.reshape(-1, degree + 1)
    halves = _halves(degree)
    for _ in range(_HALVINGS):
        open_ = rows.max(axis=1) > (best + slack)[owner]
        if not open_.any():
            return np.asarray(best + slack)
        rows, owner = rows[open_], np.tile(owner[open_], 2)
        rows = np.concatenate([rows @ half for half in halves])
        np.maximum.at(best, owner, np.maximum(rows[:, 0], rows[:, -1]))
    np.maximum.at(best, owner, rows.max(axis=1))
    return np.asarray(best + slack)


def differentiated(pieces: Array, widths: Array, order: int) -> Array:
    """Coefficients of a derivative in time.

    Args:
        pieces: Ascending coefficients in the share of the piece's time, shape `(p, d + 1, n)`.
        widths: Length of the pieces, shape `(p,)` [s].
        order: How often to differentiate.

    Returns:
        Shape `(p, max(d - order, 0) + 1, n)`.
    """
    degree = pieces.shape[1] - 1
    if order > degree:
        return np.zeros((len(pieces), 1, pieces.shape[2]))
    factor = np.array([perm(i, order) for i in range(order, degree + 1)], dtype=np.float64)
    return np.asarray(pieces[:, order:] * factor[:, None] / widths[:, None, None] ** order)


@lru_cache
def _to_bernstein(degree: int) -> Array:
    """From ascending powers to Bernstein coefficients, shape `(d + 1, d + 1)`."""
    rows = range(degree + 1)
    return np.array([[comb(j, i) / comb(degree, i) for i in rows] for j in rows])


@lru_cache
def _halves(degree: int) -> tuple[Array, Array]:
    """From Bernstein coefficients in rows to those of the first and of the second half."""
    rows = range(degree + 1)
    first = np.array([[comb(j, i) / 2.0**j for i in rows] for j in rows])
    return first.T.copy(), first[::-1, ::-1].T.copy()
