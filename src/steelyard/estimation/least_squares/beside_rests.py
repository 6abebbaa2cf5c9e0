r"""What samples beside rests move: an error that a fit shows, and that its residuals hide.

A joint that stands still is held by whatever balances it, not by its friction times the sign of a
speed. Samples at rest are left out, but the low-pass takes their share into those beside. At every
reversal that error has the same sign, so it does not average out: it is a bias.

The same fit without the samples beside rests estimates it. In coordinates whose noise is white,
$z = R\phi + \epsilon$, these samples left out give the normal matrix $A \preceq 1$ and vector $a$,
and $\delta = A^{-1} a - z$. Chance alone gives $\delta$ in an eigendirection of $A$ the variance
$\nu\,(1/\lambda - 1)$ [Hausman1978], $\nu$ that of $\epsilon$; what is beyond counts as an error of
$z$ with the covariance $\delta\delta^T$. The estimate stays.
"""

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.least_squares.normal_equations import Fit, solve

LEAST = 0.01
"""Eigenvalue of `A` below which nothing away from rests identifies a direction."""


def moved(fit: Fit, weights: Array, root: Array, columns: Sequence[int], noise: Array) -> Array:
    r"""How far the samples beside rests move a fit, beyond chance: $\delta$.

    Args:
        fit: The fit.
        weights: One per row.
        root: From normal vectors over `columns` to white coordinates, shape `(rank, c)`.
        columns: Shared columns.
        noise: Covariance of the white coordinates, shape `(rank, rank)`.

    Returns:
        Shape `(rank,)`; zeros where nothing is beside rests.
    """
    if fit.data.whole.beside is None:
        return np.zeros(len(root))
    _, whole, _, _ = fit.data.normal(weights)
    matrix, vector, _, _ = fit.data.without_beside().normal(weights)
    values, vectors = np.linalg.eigh(root @ matrix[np.ix_(columns, columns)] @ root.T)
    resolved = values > LEAST
    values = np.where(resolved, np.minimum(values, 1.0), 1.0)
    shift = (vectors.T @ (root @ vector[columns])) / values - vectors.T @ (root @ whole[columns])
    variances = np.einsum("ki,kl,li->i", vectors, noise, vectors)
    chance = np.maximum(variances, 0.0) * (1.0 / values - 1.0)
    beyond = np.maximum(1.0 - chance / np.maximum(np.square(shift), 1e-300), 0.0)
    return np.asarray(vectors @ np.where(resolved, np.sqrt(beyond) * shift, 0.0))


def moved_scores(fit: Fit, weights: Array, scores: Array) -> Array:
    r"""The same as an error of the normal vector over the columns `fit.solution.kept`.

    Args:
        fit: The fit.
        weights: One per row.
        scores: Covariance of the normal vector by noise, shape `(k, k)`.
    """
    kept = fit.solution.kept
    if fit.data.whole.beside is None:
        return np.zeros(len(kept))
    root = _root(fit, weights)
    shift = moved(fit, weights, root, kept, root @ scores @ root.T)
    return np.asarray(np.linalg.solve(root, shift))


def away(fit: Fit) -> Fit | None:
    """The same fit to samples that are not beside rests; `None` if they do not identify all.

    Args:
        fit: Weighted least squares, weighted by the inverse of its variances.
    """
    data, weights, kept = fit.data.without_beside(), 1.0 / fit.variances, fit.solution.kept
    root = _root(fit, weights)
    matrix, _, _, _ = data.normal(weights)
    if np.linalg.eigvalsh(root @ matrix[np.ix_(kept, kept)] @ root.T)[0] <= LEAST:
        return None
    return Fit(data, solve(data, weights, fit.solution), fit.variances)


def _root(fit: Fit, weights: Array) -> Array:
    """From normal vectors over the columns `fit.solution.kept` to white coordinates."""
    kept = fit.solution.kept
    matrix, _, _, _ = fit.data.normal(weights)
    lengths = np.sqrt(np.diag(matrix)[kept])
    factor = np.linalg.cholesky(matrix[np.ix_(kept, kept)] / lengths[:, None] / lengths)
    return np.asarray(np.linalg.inv(factor) / lengths)
