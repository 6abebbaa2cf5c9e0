"""Inverses and eigenvalues of information matrices whose columns have any units."""

import math

import numpy as np

from steelyard.arrays import Array

DEFINITE = 1e-13
"""Least eigenvalue, next to the Frobenius norm, of a matrix that is definite beyond rounding."""
FAINT = 1e-9
"""With an eigenvalue below this part of the largest, the small ones are taken from the inverse:
where units of columns made them small, they are exact there. Above, the matrix is definite."""


Spectrum = tuple[Array, Array]
"""Eigenvalues in ascending order, shape `(c,)`, and their vectors, shape `(c, c)`."""


def excited(gram: Array) -> bool:
    """Whether all is finite, and every column has information of its own."""
    return bool(np.all(np.diagonal(gram) > 0.0) and np.all(np.isfinite(gram)))


def definite(gram: Array) -> bool:
    """Whether a symmetric matrix `(c, c)` is positive definite beyond rounding.

    Judged with its diagonal scaled to one, so that units of columns play no part.
    """
    if not excited(gram):
        return False
    unit, _ = equilibrated(gram)
    np.fill_diagonal(unit, 1.0 - DEFINITE * float(np.linalg.norm(unit)))
    try:
        np.linalg.cholesky(unit)
    except np.linalg.LinAlgError:
        return False
    return True


def scaled(matrix: Array, d: Array) -> Array:
    """Rows and columns multiplied with `d`."""
    result: Array = matrix * d[:, None] * d
    return result


def equilibrated(gram: Array) -> tuple[Array, Array]:
    """With a diagonal of ones; and what its rows and columns were multiplied with, `(c,)`."""
    d = 1.0 / np.sqrt(np.diagonal(gram))
    return scaled(gram, d), d


def inverse(gram: Array) -> Array:
    """Of a definite matrix; its error grows with the condition of the equilibrated one only."""
    unit, d = equilibrated(gram)
    half = 0.5 * np.linalg.inv(unit)
    return scaled(half + half.T, d)


def spectra(gram: Array) -> tuple[Spectrum, Spectrum] | None:
    """Of a symmetric matrix, and of its inverse; `None` if it is not definite beyond rounding."""
    if not np.all(np.isfinite(gram)):
        return None
    values, vectors = np.linalg.eigh(gram)
    if values[0] > FAINT * values[-1]:
        return (values, vectors), (1.0 / values[::-1], vectors[:, ::-1])
    if not definite(gram):
        return None
    spreads, axes = np.linalg.eigh(inverse(gram))
    return (values, vectors), (spreads, axes)


def soft_greatest(values: Array, sharpness: float) -> tuple[float, Array]:
    r"""$\frac1p \log \sum_i \lambda_i^p$ of eigenvalues in ascending order; its slope by them.

    Those that are rounding next to the largest count as that rounding.
    """
    logs = np.log(np.maximum(values / values[-1], np.finfo(np.float64).eps))
    weights = np.exp(sharpness * logs)
    total = float(np.sum(weights))
    value = math.log(values[-1]) + math.log(total) / sharpness
    return value, np.exp((sharpness - 1.0) * logs) / (total * values[-1])


def assembled(vectors: Array, values: Array) -> Array:
    r"""$V \mathrm{diag}(v) V^T$."""
    result: Array = (vectors * values) @ vectors.T
    return result
