"""Numbers that all joints share, such as gravity or a payload, fitted beside friction."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array

ROUNDS = 4
WIDE = 1e6


@dataclass(frozen=True, eq=False)
class SharedFit:
    """Values `(k,)` and their covariance `(k, k)`."""

    values: Array
    covariance: Array


def shared_fit(
    residual: Array,
    columns: Array,
    nuisances: Array,
    bounds: tuple[Array, Array],
    size: Array,
    worth: float,
    prior: Array,
) -> SharedFit:
    r"""Weighted least squares of $r_j = C_j x + Y_j \theta_j$ over all joints.

    Every joint weighs by its own residuals; bounds are taken as a normal distribution of their
    width.

    Args:
        residual: Efforts less what is predicted without the columns, shape `(n, B)`, zero where a
            joint does not count.
        columns: Shape `(k, n, B)`.
        nuisances: Shape `(n, 4, B)`.
        bounds: Least and largest nuisances, each `(n, 4)`.
        size: Least standard deviation of each joint's residuals, shape `(n,)`.
        worth: Independent samples per sample.
        prior: Standard deviation of the numbers around zero, shape `(k,)`.
    """
    n, k = len(residual), len(columns)
    middle, width = _normal(bounds, size)
    columns = np.asarray(columns * (nuisances[:, 2] != 0.0))
    variance = np.maximum(np.mean(np.square(residual), axis=1), np.square(size))
    values: Array = np.zeros(k)
    covariance: Array = np.eye(k)
    for _ in range(ROUNDS):
        matrix, vector = np.diag(1.0 / np.square(prior)), np.zeros(k)
        eliminated = []
        for j in range(n):
            weight = worth / variance[j]
            c, y, r = columns[:, j], nuisances[j], residual[j]
            inner = weight * y @ y.T + np.diag(1.0 / np.square(width[j]))
            right = weight * y @ r + middle[j] / np.square(width[j])
            cross = weight * c @ y.T
            gain = np.linalg.solve(inner, np.column_stack((cross.T, right)))
            eliminated.append(gain)
            matrix += weight * c @ c.T - cross @ gain[:, :k]
            vector += weight * c @ r - cross @ gain[:, k]
        covariance = np.asarray(np.linalg.inv(matrix))
        values = covariance @ vector
        for j in range(n):
            theta = eliminated[j][:, k] - eliminated[j][:, :k] @ values
            left = residual[j] - values @ columns[:, j] - theta @ nuisances[j]
            count = max(float(np.count_nonzero(nuisances[j, 2])), 1.0)
            variance[j] = max(float(left @ left) / count, float(size[j]) ** 2)
    return SharedFit(values, covariance)


def _normal(bounds: tuple[Array, Array], size: Array) -> tuple[Array, Array]:
    """Middle and half-width of bounds; infinite ones are wide."""
    lower, upper = bounds
    known = np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(known, lower, 0.0), np.where(known, upper, 0.0)
    wide = WIDE * np.maximum(size, 1e-12)[:, None]
    tiny = 1e-9 * np.maximum(size, 1e-12)[:, None]
    width = np.where(known, np.maximum(0.5 * (high - low), tiny), wide)
    return 0.5 * (low + high), width
