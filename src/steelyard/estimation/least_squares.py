r"""Ordinary and weighted least squares on base parameters, from information alone.

Weights are one per effort row, $1/\sigma_j^2$, found by iteration: fit, take each row's residuals,
fit again [Gautier1997]. Information counts filtered samples for what they are worth, as many as
there are independent ones, so the covariance is right for residuals behind a low-pass.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.estimate import Blind, Estimate
from steelyard.parameters import Parameters
from steelyard.regression.information import Information

SEEN = 1e-10
"""Squared sine of the angle to earlier columns below which the data do not see a column."""

TIED = 1e-3
"""Share of a column's length that another must have in it to be named as its twin."""


@dataclass(frozen=True)
class OrdinaryLeastSquares:
    """All rows weigh the same, whatever their noise."""

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        ones = np.ones(len(information.layout.rows))
        solution = _solve(information, ones)
        variances = _variances(information, solution, ones)
        meat, _, _ = information.normal(variances)
        meat = meat[np.ix_(solution.kept, solution.kept)]
        covariance = solution.inverse @ meat @ solution.inverse
        return _estimate("ordinary least squares", information, solution, variances, covariance)


@dataclass(frozen=True)
class WeightedLeastSquares:
    """Every row weighs by the variance of its own residuals.

    Attributes:
        rounds: Most iterations of the weights.
        tolerance: Relative change of the weights at which they are settled.
    """

    rounds: int = 50
    tolerance: float = 1e-6

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        energy = information.effort_squares() / np.maximum(information.n_samples, 1.0)
        variances = np.where(energy > 0.0, energy, 1.0)
        for _ in range(self.rounds):
            weights = 1.0 / variances
            solution = _solve(information, weights)
            settled = _variances(information, solution, weights)
            change = np.abs(settled / variances - 1.0).max()
            variances = settled
            if change < self.tolerance:
                break
        covariance = solution.inverse
        return _estimate("weighted least squares", information, solution, variances, covariance)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Values of all columns (unseen ones zero), those kept, and the inverse Gram of these."""

    values: Array
    kept: list[int]
    inverse: Array
    blind: tuple[Blind, ...]
    singular: Array
    singular_normalised: Array


def _solve(information: Information, weights: Array) -> _Solution:
    matrix, vector, _ = information.normal(weights)
    lengths = np.sqrt(np.diag(matrix))
    scale = np.where(lengths > 1e-12 * lengths.max(initial=1e-300), lengths, np.inf)
    unit = matrix / scale[:, None] / scale
    kept, blind = _visible(unit, np.isfinite(scale), information.layout.columns)
    if not kept:
        raise DataError(
            "the data show none of the model's parameters",
            where=", ".join(dict.fromkeys(w.run for w in information.windows)) or "no window",
            mend="log a motion in which the joints move",
        )
    reduced, scale = unit[np.ix_(kept, kept)], scale[kept]
    inverse = np.linalg.inv(reduced)
    values = np.zeros(len(vector))
    first = inverse @ (vector[kept] / scale)
    first += inverse @ (vector[kept] / scale - reduced @ first)
    values[kept] = first / scale
    return _Solution(
        values,
        kept,
        inverse / scale[:, None] / scale,
        blind,
        frozen(np.linalg.eigvalsh(matrix[np.ix_(kept, kept)])),
        frozen(np.linalg.eigvalsh(reduced)),
    )


def _visible(
    unit: Array, nonzero: Array, names: tuple[str, ...]
) -> tuple[list[int], tuple[Blind, ...]]:
    """Columns that are new to those before them: Cholesky in natural order, the others left out."""
    size = len(unit)
    if nonzero.all() and _all_new(unit):
        return list(range(size)), ()
    factor = np.zeros((size, size))
    kept: list[int] = []
    blind: list[Blind] = []
    for k in range(size):
        if not nonzero[k]:
            blind.append(Blind(names[k]))
            continue
        part = np.linalg.solve(factor[np.ix_(kept, kept)], unit[kept, k])
        rest = unit[k, k] - part @ part
        if rest < SEEN:
            weights = np.linalg.solve(unit[np.ix_(kept, kept)], unit[kept, k])
            tied = [names[j] for j, w in zip(kept, weights, strict=True) if abs(w) > TIED]
            blind.append(Blind(names[k], tuple(tied)))
            continue
        factor[k, kept] = part
        factor[k, k] = np.sqrt(rest)
        kept.append(k)
    return kept, tuple(blind)


def _all_new(unit: Array) -> bool:
    """Whether every column is new; LAPACK answers that at once."""
    try:
        return bool(np.square(np.diag(np.linalg.cholesky(unit))).min() >= SEEN)
    except np.linalg.LinAlgError:
        return False


def _variances(information: Information, solution: _Solution, weights: Array) -> Array:
    """Residual variance per row; a fit takes from each row the degrees of freedom it used there."""
    squares = information.residual_squares(solution.values)
    counts = information.n_samples
    position = {column: k for k, column in enumerate(solution.kept)}
    variances = np.empty(len(squares))
    for row, seen in enumerate(information.layout.sees):
        mine = [k for k, column in enumerate(seen) if column in position]
        place = [position[seen[k]] for k in mine]
        gram = information.row_gram(row)[np.ix_(mine, mine)]
        used = weights[row] * np.sum(gram * solution.inverse[np.ix_(place, place)])
        freedom = max(counts[row] - used, 1.0)
        variances[row] = squares[row] / freedom
    floor = 1e-24 * max(float(information.effort_squares().max()), 1e-300)
    return np.maximum(variances, floor)


def _estimate(
    name: str, information: Information, solution: _Solution, variances: Array, covariance: Array
) -> Estimate:
    layout = information.layout
    return Estimate(
        estimator=name,
        parameters=Parameters(
            [layout.columns[k] for k in solution.kept],
            [layout.units[k] for k in solution.kept],
            solution.values[solution.kept],
        ),
        covariance=frozen((covariance + covariance.T) / 2.0),
        blind=solution.blind,
        sigma=frozen(np.sqrt(variances)),
        n_samples=frozen(information.n_samples),
        condition=_condition(solution.singular),
        condition_normalised=_condition(solution.singular_normalised),
    )


def _condition(eigenvalues: Array) -> float:
    """Root of the ratio of a Gram matrix's extreme eigenvalues, as far as rounding shows it."""
    rounding = np.finfo(np.float64).eps * eigenvalues[-1]
    return float(np.sqrt(eigenvalues[-1] / max(eigenvalues[0], rounding)))
