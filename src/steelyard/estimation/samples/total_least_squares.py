r"""Total least squares: noise in the columns as well as in the effort.

Finds the smallest change of $[A \mid b]$, rows weighted by their noise, that makes $A x = b$
solvable; columns and effort are scaled to unit length first, so each is thought wrong by the same
share of itself. With $\sigma^2$ the smallest eigenvalue of the Gram matrix of $[A \mid b]$,
$x = (A^T A - \sigma^2 I)^{-1} A^T b$ [VanHuffel1991]. Sums of products are all it takes.
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.least_squares.normal_equations import Fit, Spread, described, variances_of
from steelyard.estimation.least_squares.sandwich import honest_covariance
from steelyard.regression.information import Information

GENERIC = 1e-12
"""Least gap between the smallest eigenvalue of columns alone and that of columns and effort."""


@dataclass(frozen=True)
class TotalLeastSquares:
    r"""Rows are weighted as weighted least squares has them.

    The covariance is $H^{-1} (\sum_j \varphi_j G_j) H^{-1}$ with $H = A^T A - \sigma^2 I$, $G_j$
    what row $j$ adds to $A^T A$ and $\varphi_j$ as in `sandwich`, times the residual variance: a
    little wider than to first order, and right if all columns are as noisy as they are taken to be.

    Attributes:
        per_run: Columns whose parameters every run has for itself; they are taken as exact.
    """

    per_run: tuple[str, ...] = ()

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see.

        Raises:
            DataError: The data see no parameter, or no small change of them makes them consistent.
        """
        fit = WeightedLeastSquares(per_run=self.per_run).fit(information)
        solution, weights = fit.solution, 1.0 / fit.variances
        matrix, vector, _, _ = fit.data.normal(weights)
        kept = solution.kept
        lengths = np.sqrt(np.diag(matrix)[kept])
        unit = matrix[np.ix_(kept, kept)] / lengths[:, None] / lengths
        right = vector[kept] / lengths
        effort = np.sqrt(_effort_square(fit, weights))
        x, inverse = _solved(unit, right / max(effort, 1e-300), information)
        values = np.zeros(len(vector))
        values[kept] = effort * x / lengths
        parts = tuple(part.solved(values) for part in solution.locals)
        found = replace(solution, values=values, locals=parts)
        variances = variances_of(fit.data, found, weights)
        covariance = honest_covariance(fit, inverse / lengths[:, None] / lengths)
        covariance *= np.average(variances / fit.variances, weights=information.n_samples)
        own = tuple(part.covariance(kept, covariance) for part in parts)
        spread = Spread(covariance, own)
        return described("total least squares", Fit(fit.data, found, variances), spread)


def _solved(unit: Array, right: Array, information: Information) -> tuple[Array, Array]:
    """Parameters in unit lengths, and the inverse of what is left of the Gram matrix."""
    size = len(right)
    whole = np.ones((size + 1, size + 1))
    whole[:size, :size], whole[size, :size], whole[:size, size] = unit, right, right
    smallest = max(float(np.linalg.eigvalsh(whole)[0]), 0.0)
    if np.linalg.eigvalsh(unit)[0] - smallest < GENERIC:
        raise DataError(
            "total least squares has no solution: the smallest change of the data that makes them "
            "consistent makes a column vanish",
            where=", ".join(dict.fromkeys(w.run for w in information.windows)),
            fix="use weighted least squares, or a more exciting motion",
        )
    left = unit - smallest * np.eye(size)
    inverse = np.asarray(np.linalg.inv(left), dtype=np.float64)
    x = inverse @ right
    x += inverse @ (right - left @ x)
    return x, inverse


def _effort_square(fit: Fit, weights: Array) -> float:
    """Weighted squares of the efforts, parameters of single runs eliminated."""
    total = 0.0
    for run, own in zip(fit.data.runs, fit.solution.locals, strict=True):
        _, vector, square = run.normal(weights)
        total += square - float(vector[list(own.columns)] @ own.offset)
    return max(total, 0.0)
