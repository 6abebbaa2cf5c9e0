r"""Ordinary and weighted least squares on base parameters, from information alone.

Weights are one per effort row, $1/\sigma_j^2$, found by iteration: fit, take each row's residuals,
fit again [Gautier1997]. Information counts filtered samples for what they are worth, as many as
there are independent ones, so the covariance is right for white residuals behind a low-pass; where
windows of time show that they are alike for longer or for less, it follows (see `sandwich`), and
what samples beside rests move is added (see `beside_rests`).
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.beside_rests import moved_scores
from steelyard.estimation.least_squares.normal_equations import (
    Fit,
    Solution,
    Spread,
    described,
    scores_of,
    solve,
    spread_of,
    variances_of,
)
from steelyard.estimation.least_squares.sandwich import note_of, scatter
from steelyard.estimation.per_run import Runs
from steelyard.regression.information import Information

DEPTH = 4
"""Earlier points that are mixed."""

NEAR = 0.1
"""Change of a logarithm from which on earlier points are mixed."""

LONGEST = 1.0
"""Longest mixed step of a logarithm."""


@dataclass(frozen=True)
class OrdinaryLeastSquares:
    """All rows weigh the same, whatever their noise.

    Attributes:
        per_run: Columns whose parameters every run has for itself.
    """

    per_run: tuple[str, ...] = ()

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        data = Runs.of(information, self.per_run)
        ones = np.ones(len(information.layout.rows))
        solution = solve(data, ones)
        fit = Fit(data, solution, variances=variances_of(data, solution, ones))
        factors = scatter(WeightedLeastSquares(per_run=self.per_run).fit(information))
        spread = _spread(fit, ones, factors * fit.variances)
        estimate = described("ordinary least squares", fit, spread)
        return replace(estimate, notes=note_of(information.layout.rows, factors))


@dataclass(frozen=True)
class WeightedLeastSquares:
    """Every row weighs by the variance of its own residuals.

    Attributes:
        rounds: Most iterations of the weights.
        tolerance: Relative change of the weights at which they have converged.
        per_run: Columns whose parameters every run has for itself.
    """

    rounds: int = 50
    tolerance: float = 1e-6
    per_run: tuple[str, ...] = ()

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        fit = self.fit(information)
        factors = scatter(fit)
        spread = _spread(fit, 1.0 / fit.variances, factors / fit.variances)
        estimate = described("weighted least squares", fit, spread)
        return replace(estimate, notes=note_of(information.layout.rows, factors))

    def fit(self, information: Information) -> Fit:
        """Values and converged weights, without covariances."""
        data = Runs.of(information, self.per_run)
        energy = information.effort_squares() / np.maximum(information.n_samples, 1.0)
        logs, mixed = np.log(np.where(energy > 0.0, energy, 1.0)), Mixing()
        before: Solution | None = None
        for _ in range(self.rounds):
            weights = np.exp(-logs)
            solution = before = solve(data, weights, before)
            variances = variances_of(data, solution, weights)
            change = np.log(variances) - logs
            if np.abs(change).max() < self.tolerance:
                break
            logs = mixed.next(logs, change)
        return Fit(data, solution, variances)


def _spread(fit: Fit, weights: Array, noise: Array) -> Spread:
    """What noise does to a fit, and what samples beside rests move.

    Args:
        fit: The fit.
        weights: One per row.
        noise: Variance of the residuals times the square of their weight, per row.
    """
    spread, solution = spread_of(fit, noise), fit.solution
    scores = scores_of(fit.data, solution.locals, solution.kept, noise)
    shift = solution.inverse @ moved_scores(fit, weights, scores)
    own = [part.slopes[:, solution.kept] @ shift for part in solution.locals]
    return Spread(
        spread.shared + np.outer(shift, shift),
        tuple(found + np.outer(x, x) for found, x in zip(spread.own, own, strict=True)),
    )


class Mixing:
    """Anderson's mixing: the next point of a fixed-point iteration from the last few."""

    def __init__(self) -> None:
        self._points: list[Array] = []
        self._changes: list[Array] = []

    def next(self, point: Array, change: Array) -> Array:
        """The point at which a linear model of the changes is zero, or the plain next one.

        Args:
            point: Where the iteration stands.
            change: What one plain step would add to it.
        """
        size = float(np.abs(change).max())
        if size > NEAR:
            self._points, self._changes = [], []
            return point + change
        self._points = [*self._points[-DEPTH:], point]
        self._changes = [*self._changes[-DEPTH:], change]
        slopes = np.diff(self._changes, axis=0).T
        if not slopes.size:
            return point + change
        shares = np.linalg.lstsq(slopes, change, rcond=1e-8)[0]
        step = change - (np.diff(self._points, axis=0).T + slopes) @ shares
        return np.asarray(point + np.clip(step, -LONGEST, LONGEST))
