"""Information and covariance of some parameters when all others are free."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array

SEEN = 1e-10  # share of a parameter's information, all others free, that counts as some
TOUCHED = 1e-4  # component along an unseen direction from which on a parameter is not seen
RANK = 1e-13  # relative eigenvalue of a scaled normal matrix whose direction is left at zero


def inverse(matrix: Array) -> Array:
    """Inverse of a symmetric, non-negative matrix; directions without information stay at zero."""
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale)
    kept = values > RANK * values.max(initial=1e-300) * len(values)
    part = vectors[:, kept] / scale[:, None]
    return np.asarray((part / values[kept]) @ part.T)


def marginal(matrix: Array, chosen: Sequence[int]) -> Array:
    """Information left of some when all others are free, $A_{cc} - A_{co} A_{oo}^{-1} A_{oc}$."""
    mine = list(chosen)
    others = [k for k in range(len(matrix)) if k not in set(mine)]
    cross = matrix[np.ix_(mine, others)]
    left = matrix[np.ix_(mine, mine)] - cross @ inverse(matrix[np.ix_(others, others)]) @ cross.T
    return np.asarray((left + left.T) / 2.0)


def _scaled(matrix: Array, chosen: Sequence[int]) -> tuple[Array, Array, Array]:
    """Scale of each chosen parameter, eigenvalues and vectors of what is left about them in it."""
    size = np.sqrt(np.maximum(np.diag(matrix)[list(chosen)], 0.0))
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(marginal(matrix, chosen) / scale[:, None] / scale)
    return scale, values, vectors


def seen_information(matrix: Array, chosen: Sequence[int]) -> Array:
    """The same without directions that the data do not see, which rounding leaves in it."""
    scale, values, vectors = _scaled(matrix, chosen)
    seen = values >= SEEN
    kept = vectors[:, seen] * np.where(np.isfinite(scale), scale, 0.0)[:, None]
    return np.asarray((kept * values[seen]) @ kept.T)


def covariance_of(matrix: Array, chosen: Sequence[int]) -> Array:
    """Covariance `(c, c)` of chosen of `p` parameters with an information matrix; NaN if unseen."""
    scale, values, vectors = _scaled(matrix, chosen)
    null = values < SEEN
    kept = vectors[:, ~null] / scale[:, None]
    covariance = np.asarray((kept / values[~null]) @ kept.T)
    blind = np.linalg.norm(vectors[:, null], axis=1) > TOUCHED
    covariance[blind, :] = covariance[:, blind] = np.nan
    return covariance
