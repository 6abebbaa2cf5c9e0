r"""Which columns of a regressor are independent, in natural order where that is well-conditioned.

Calibrated model files have joint axes that are parallel to 1e-4 rad. Natural order alone then takes
columns whose new part is no more than 1e-8, and the rounding errors of everything after it, blown
up by 1e8, look like new parts as well. Here the rank stands at the largest gap of the singular
values. A column is taken in natural order only if a good part of it is new; the columns that are
then missing are those that add most (QR with column pivoting [Businger1965, Gautier1991]).
"""

from typing import cast

import numpy as np
from scipy.linalg import qr

from steelyard.arrays import Array

NEW = 1e-2
"""Part of a column, relative to its norm, that must be new for it to be taken in natural order."""

UNSEEN = 1e-9
"""Norm of a column, relative to the largest, at which it is zero but for rounding errors."""

GAP = 1e-3
"""Singular values above this part of the largest one count in any case."""

ROUNDING = 1e-14
"""Singular values below this part of the largest one are rounding errors."""


def seen_columns(matrix: Array) -> list[int]:
    """Indices of the columns of a `(rows, p)` matrix that are not zero."""
    norms = np.linalg.norm(matrix, axis=0)
    return [int(k) for k in np.flatnonzero(norms > UNSEEN * norms.max(initial=0.0))]


def independent_columns(matrix: Array) -> list[int]:
    """Indices of columns that span a matrix, as many as its rank, in ascending order.

    Args:
        matrix: Shape `(rows, p)`, `rows >= p`.
    """
    seen = seen_columns(matrix)
    if not seen:
        return []
    unit = matrix[:, seen] / np.linalg.norm(matrix[:, seen], axis=0)
    triangle = np.asarray(np.linalg.qr(unit, mode="r"))
    natural, basis = _natural(triangle)
    values: Array = np.linalg.svd(triangle, compute_uv=False)
    missing = rank(values) - len(natural)
    others = [k for k in range(len(seen)) if k not in set(natural)]
    if missing > 0:
        rest = triangle[:, others]
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        _, order = cast(tuple[Array, Array], qr(rest, mode="r", pivoting=True))
        natural += [others[int(k)] for k in order[:missing]]
    return sorted(seen[k] for k in natural)


def rank(values: Array) -> int:
    """How many descending singular values stand before their largest gap."""
    sizes = np.maximum(np.append(values / values[0], 0.0), ROUNDING)
    first = max(1, int((sizes >= GAP).sum()))
    return first + int(np.argmax(sizes[first - 1 : -1] / sizes[first:]))


def _natural(columns: Array) -> tuple[list[int], Array]:
    """Unit columns that are new by `NEW`, one after another; an orthonormal basis of them."""
    rows, count = columns.shape
    basis, taken = np.empty((rows, min(rows, count)), order="F"), list[int]()
    for k in range(count):
        before, rest = basis[:, : len(taken)], columns[:, k]
        for _ in range(2):
            rest = rest - before @ (before.T @ rest)
        new = float(np.linalg.norm(rest))
        if new > NEW:
            basis[:, len(taken)] = rest / new
            taken.append(k)
    return taken, basis[:, : len(taken)]
