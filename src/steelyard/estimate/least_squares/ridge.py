r"""Ridge regression: towards zero, or towards the nominal bodies, as far as the data are weak.

Minimises $\chi^2 + \lambda \|S (\phi - \phi_0)\|^2$ with $S$ the lengths of the whitened columns.
The weight is that of least generalised cross-validation [Golub1979],
$N\,\mathrm{RSS}(\lambda) / (N - \mathrm{tr} H(\lambda))^2$, which follows from the Gram matrix:
with its eigenvalues $d$, $\mathrm{tr} H = \sum d / (d + \lambda)$.
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimate.least_squares.normal_equations import Fit, Spread, described, unit_length
from steelyard.estimate.least_squares.residual_covariance import honest_covariance
from steelyard.estimate.prior.prior import Knowledge

WEIGHTS = 1e-14, 1e4  # least and greatest weight; the eigenvalues add up to the number of columns
STEPS = 240  # weights that are tried before the best one is refined


@dataclass(frozen=True, eq=False)
class Ridge:
    """Rows are weighted as weighted least squares has them; blind parameters stay blind.

    The covariance is that after the data if `1 / weight` was the variance before them in units of
    the columns' lengths, residuals that are alike for longer than the filter allowed for; `learned`
    is what the data took of it.
    """

    # base parameters by name that the estimate is drawn to; zero where there is none
    towards: tuple[tuple[str, float], ...] = ()
    target: str = "zero"  # what they are, for people to read
    weight: float | None = None  # of the deviation; by generalised cross-validation if `None`
    # columns whose parameters every run has for itself; they are not drawn anywhere
    per_run: tuple[str, ...] = ()

    @classmethod
    def nominal(cls, base: BaseMap, knowledge: Knowledge, per_run: tuple[str, ...] = ()) -> "Ridge":
        """Towards the nominal bodies, if every body has a prior; towards zero otherwise."""
        if not knowledge.priors or any(prior is None for prior in knowledge.priors):
            return cls(per_run=per_run)
        place = {name: k for k, name in enumerate(base.names)}
        standard = np.zeros(len(base.names))
        for body, prior in enumerate(knowledge.priors):
            if prior is not None:
                tens = [place[knowledge.names[k]] for k in knowledge.tens(body)]
                standard[tens] = prior.ten
        values = base.base_values(standard).tolist()
        named = tuple(zip(base.base_names, values, strict=True))
        return cls(named, "the nominal inertial parameters, zero friction", per_run=per_run)

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        fit = WeightedLeastSquares(per_run=self.per_run).fit(information)
        solution, kept = fit.solution, fit.solution.kept
        matrix, vector, _, _ = fit.data.normal(1.0 / fit.variances)
        names, given = information.layout.columns, dict(self.towards)
        aim = np.array([given.get(name, 0.0) for name in names])
        target = solution.inverse @ (matrix[kept] @ aim)
        unit, lengths = unit_length(matrix[np.ix_(kept, kept)])
        problem = _Problem.of(unit, lengths * (solution.values[kept] - target), fit)
        weight = problem.best() if self.weight is None else self.weight
        values = np.zeros(len(vector))
        values[kept] = target + problem.step(weight) / lengths
        inverse = problem.inverse(weight)
        prior = np.diag(weight * np.square(lengths))
        covariance = honest_covariance(fit, inverse / lengths[:, None] / lengths, prior)
        drawn = fit.at(values)
        found = described("ridge regression", drawn, Spread.of(drawn.solution, covariance))
        # one minus the ratio of the variances after and before the data
        learned = np.clip(1.0 - weight * np.diag(inverse), 0.0, 1.0)
        share = {names[k]: x for k, x in zip(kept, learned, strict=True)}
        how = "given" if self.weight is not None else "by generalised cross-validation"
        return replace(
            found,
            learned=frozen([share.get(name, 1.0) for name in found.parameters.names]),
            notes=(f"shrunk towards {self.target} with weight {weight:.3g} ({how})",),
        )


@dataclass(frozen=True, eq=False)
class _Problem:
    """Deviation from the target in units of the columns' lengths, in the Gram's own directions."""

    eigenvalues: Array  # of the Gram matrix, columns of unit length, `(k,)`
    vectors: Array  # their directions, `(k, k)`
    free: Array  # deviation of the free fit along them, `(k,)`
    rest: float  # weighted squares that the free fit leaves
    count: float  # independent samples less parameters of single runs

    @classmethod
    def of(cls, unit: Array, deviation: Array, fit: Fit) -> "_Problem":
        """The problem beside a free fit."""
        values, vectors = np.linalg.eigh(unit)
        rest, spent = 0.0, 0
        for run, own in zip(fit.data.runs, fit.solution.locals, strict=True):
            squares = run.residual_squares(own.among(fit.solution.values))
            rest += float(np.sum(squares / fit.variances))
            spent += len(own.columns)
        count = float(fit.data.whole.n_samples.sum()) - spent
        return cls(np.maximum(values, 0.0), vectors, vectors.T @ deviation, rest, count)

    def score(self, weight: Array) -> Array:
        """Generalised cross-validation of weights, the same shape."""
        d = self.eigenvalues
        drawn = weight[..., None] / (d + weight[..., None])
        squares = self.rest + np.sum(d * np.square(drawn * self.free), axis=-1)
        left = self.count - np.sum(1.0 - drawn, axis=-1)
        return np.where(left > 0.0, squares / np.square(np.maximum(left, 1e-9)), np.inf)

    def best(self) -> float:
        """The weight of least score; the greatest one if there are too few samples."""
        from scipy.optimize import minimize_scalar

        grid = np.linspace(np.log(WEIGHTS[0]), np.log(WEIGHTS[1]), STEPS)
        scores = self.score(np.exp(grid))
        if not np.isfinite(scores).any():
            return WEIGHTS[1]
        k = int(np.argmin(scores))
        around = grid[max(k - 1, 0)], grid[min(k + 1, STEPS - 1)]
        refined = minimize_scalar(
            lambda x: float(self.score(np.exp(np.array(x)))), bounds=around, method="bounded"
        )
        return float(np.exp(refined.x if refined.fun < scores[k] else grid[k]))

    def step(self, weight: float) -> Array:
        """Deviation from the target, shape `(k,)`."""
        d = self.eigenvalues
        return np.asarray(self.vectors @ (d / (d + weight) * self.free))

    def inverse(self, weight: float) -> Array:
        """Covariance after the data, shape `(k, k)`."""
        return np.asarray((self.vectors / (self.eigenvalues + weight)) @ self.vectors.T)
