r"""Least squares with known values, within bounds of the base parameters, and ridge regression.

Of $\tau = X \varphi$ with known $\varphi_k$, $\tau - X_k \varphi_k = X_u \varphi_u$ is solved for
the others: columns of known parameters are left out, so the values are met exactly.

$\min \|R\varphi - z\|$ subject to $l \le \varphi \le u$, weighted as weighted least squares is;
solved by an active set [Stark1995], so the optimum is exact.

Ridge regression: towards zero, or towards the nominal bodies, as far as the data are weak.
Minimises $\chi^2 + \lambda \|S (\phi - \phi_0)\|^2$ with $S$ the lengths of the whitened columns.
The weight is that of least generalised cross-validation [Golub1979],
$N\,\mathrm{RSS}(\lambda) / (N - \mathrm{tr} H(\lambda))^2$, which follows from the Gram matrix:
with its eigenvalues $d$, $\mathrm{tr} H = \sum d / (d + \lambda)$.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.base.arrays import Array, Parameters, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.covariance_from_residuals import (
    covariances,
    honest_covariance,
    scatter,
)
from steelyard.estimate.least_squares.normal_equations import (
    Fit,
    described,
    inverse_of_gram,
    unit_length,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    WeightedLeastSquares,
    whitened,
)
from steelyard.estimate.prior.body_priors import Knowledge


def fixed_values(
    base: BaseMap, knowledge: Knowledge
) -> tuple[Mapping[str, float], tuple[str, ...]]:
    """Base parameters all of whose members have a value that constraints of single ones give.

    And labels of the constraints that determine none.
    """
    known: dict[str, float] = {}
    for row in knowledge.rows:
        if len(row.coefficients) == 1 and row.lower == row.upper:
            ((name, factor),) = row.coefficients.items()
            known[name] = row.lower / factor
    values, used = dict[str, float](), {base.names[k] for k in base.unseen}
    for name, lift in zip(base.base_names, base.lift, strict=True):
        members = {base.names[k]: float(lift[k]) for k in np.flatnonzero(lift)}
        if members.keys() <= known.keys():
            values[name] = sum(factor * known[member] for member, factor in members.items())
            used |= members.keys()
    unused = [
        row.label
        for row in knowledge.rows
        if row.lower != row.upper or not row.coefficients.keys() <= used & known.keys()
    ]
    return values, tuple(unused)


@dataclass(frozen=True, eq=False)
class WithKnownValues:
    """An estimator of the parameters that are not known, by their names; others are ignored."""

    inner: Estimator[Information]
    values: Mapping[str, float]

    def __call__(self, information: Information) -> Estimate:
        """Estimate the columns that are not known; the known ones have no uncertainty."""
        columns = information.layout.columns
        known = {name: self.values[name] for name in columns if name in self.values}
        if not known:
            return self.inner(information)
        left = [k for k, name in enumerate(columns) if name not in known]
        names, units = ([of[k] for k in left] for of in (columns, information.layout.units))
        given = np.array([known.get(name, 0.0) for name in columns])
        others = information.map(np.eye(len(columns))[:, left], names, units, given)
        estimate = self.inner(others)
        values = estimate.parameters.as_dict() | known
        order = [k for k, name in enumerate(columns) if name in values]
        every = [values.get(name, 0.0) for name in columns]
        parameters = Parameters(columns, information.layout.units, every).of(order)
        covariance = frozen(estimate.covariance_of(parameters.names))
        return replace(estimate, parameters=parameters, covariance=covariance, known=tuple(known))


Bounds = Mapping[str, tuple[float, float]]  # by name of the column; infinite if none
AT_BOUND = 1e-6  # distance from a bound, in standard deviations, up to which a parameter lies on it


def base_bounds(base: BaseMap, knowledge: Knowledge) -> Bounds:
    """Bounds of base parameters that follow from those of the standard parameters in them."""
    lower = dict(zip(knowledge.names, knowledge.lower, strict=True))
    upper = dict(zip(knowledge.names, knowledge.upper, strict=True))
    result = {}
    for name, row in zip(base.base_names, base.lift, strict=True):
        low = high = 0.0
        for k in np.flatnonzero(row):
            ends = (row[k] * lower[base.names[k]], row[k] * upper[base.names[k]])
            low, high = low + min(ends), high + max(ends)
        result[name] = (float(low), float(high))
    return result


def residual_squares(fit: Fit, values: Array) -> Array:
    """Squared residuals per row `(rows,)` at shared values `(p,)`, each run's own fitted."""
    total = np.zeros(len(fit.variances))
    for run, own in zip(fit.data.runs, fit.locals, strict=True):
        total += run.residual_squares(own.solved(values).among(values))
    return total


@dataclass(frozen=True)
class BoundedLeastSquares:
    """Weighted least squares within bounds; intervals are those without them, if anything wide.

    Of a parameter that stands for others, which the data cannot distinguish from it, bounds do not
    hold: they are left out. The covariance counts the residuals that the bounds leave.
    """

    # lower and upper bound by column, see `base_bounds`
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    per_run: tuple[str, ...] = ()  # columns whose parameters every run has for itself

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        problem, columns = whitened(information, self.per_run), information.layout.columns
        fit = problem.fit
        tied = {name for blind in fit.blind for name in blind.tied_to}
        names, free = [columns[k] for k in fit.kept], (-np.inf, np.inf)
        ends = [free if name in tied else self.bounds.get(name, free) for name in names]
        lower, upper = np.array(ends, dtype=np.float64).reshape(-1, 2).T
        root = problem.matrix[:, [problem.names.index(name) for name in names]]
        values = optimum_within(root, problem.vector, lower, upper)
        full = np.zeros(len(fit.values))
        full[fit.kept] = values
        rise = residual_squares(fit, full) - residual_squares(fit, fit.values)
        counts = np.maximum(information.n_samples, 1.0)
        variances = fit.variances + np.maximum(rise, 0.0) / counts
        matrix, _, eliminated, _ = fit.data.normal(1.0 / variances)
        inverse = inverse_of_gram(matrix[np.ix_(fit.kept, fit.kept)])
        own = tuple(part.solved(full) for part in eliminated)
        found = replace(fit, values=full, inverse=inverse, locals=own, variances=variances)
        both = covariances(found, scatter(fit) / variances)
        slack = AT_BOUND / np.linalg.norm(root, axis=0)
        at = np.flatnonzero((values <= lower + slack) | (values >= upper - slack))
        notes = (f"at a bound: {', '.join(names[k] for k in at)}",) if len(at) else ()
        return replace(described("bounded least squares", found, *both), notes=notes)


def optimum_within(root: Array, vector: Array, lower: Array, upper: Array) -> Array:
    """The best values within bounds, by an active set, shape `(k,)`."""
    from scipy.optimize import lsq_linear

    lengths = np.linalg.norm(root, axis=0)
    ends = (lower * lengths, upper * lengths)
    found = lsq_linear(root / lengths, vector, ends, method="bvls", tol=1e-14)
    if not found.success:
        wrong = f"bounded least squares did not converge: {found.message}"
        fix = "remove bounds that contradict the data, or use WLS"
        raise DataError(wrong, where=f"{len(lengths)} parameters", fix=fix)
    return np.asarray(np.clip(found.x / lengths, lower, upper))


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
        standard = np.zeros(len(base.names))
        for body, prior in enumerate(knowledge.priors):
            if prior is not None:
                standard[knowledge.tens(body)] = prior.ten
        named = tuple(zip(base.base_names, base.base_values(standard).tolist(), strict=True))
        return cls(named, "the nominal inertial parameters, zero friction", per_run=per_run)

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        fit = WeightedLeastSquares(per_run=self.per_run).fit(information)
        kept = fit.kept
        matrix, vector, _, _ = fit.data.normal(1.0 / fit.variances)
        names, given = information.layout.columns, dict(self.towards)
        aim = np.array([given.get(name, 0.0) for name in names])
        target = fit.inverse @ (matrix[kept] @ aim)
        unit, lengths = unit_length(matrix[np.ix_(kept, kept)])
        problem = _RidgeProblem.of(unit, lengths * (fit.values[kept] - target), fit)
        weight = problem.best() if self.weight is None else self.weight
        values, left = np.zeros(len(vector)), problem.eigenvalues + weight
        step = problem.vectors @ (problem.eigenvalues / left * problem.free)
        values[kept] = target + step / lengths
        inverse = (problem.vectors / left) @ problem.vectors.T
        prior = np.diag(weight * np.square(lengths))
        covariance = honest_covariance(fit, inverse / lengths[:, None] / lengths, prior)
        drawn = fit.at(values)
        found = described("ridge regression", drawn, covariance)
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
class _RidgeProblem:
    """Deviation from the target in units of the columns' lengths, in the Gram's own directions."""

    eigenvalues: Array  # of the Gram matrix, columns of unit length, `(k,)`
    vectors: Array  # their directions, `(k, k)`
    free: Array  # deviation of the free fit along them, `(k,)`
    rest: float  # weighted squares that the free fit leaves
    count: float  # independent samples less parameters of single runs

    @classmethod
    def of(cls, unit: Array, deviation: Array, fit: Fit) -> "_RidgeProblem":
        values, vectors = np.linalg.eigh(unit)
        rest = float(np.sum(residual_squares(fit, fit.values) / fit.variances))
        spent = sum(len(own.columns) for own in fit.locals)
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
