"""Linear least squares by searches: a genetic algorithm and CMA-ES over base parameters.

`BoundedLeastSquares` has the exact optimum of the same problem at once; the notes of an estimate
say how far from it a search ended.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.covariance_from_residuals import covariances, scatter
from steelyard.estimate.least_squares.known_bounded_and_ridge import (
    AT_BOUND,
    BoundedLeastSquares,
    Bounds,
    optimum_within,
    residual_squares,
)
from steelyard.estimate.least_squares.normal_equations import described as described_fit
from steelyard.estimate.least_squares.normal_equations import inverse_of_gram
from steelyard.estimate.least_squares.weighted_robust_and_whitened import Whitened, whitened
from steelyard.excite.search.search_methods import minimised_by_cma_es, minimised_by_genes

REACHED = 1.0 + 1e-6
"""Weighted squares over those of the optimum up to which a search has reached it."""

REACH = 3.0
"""How far from zero a parameter without bounds is searched, in sizes of it by least squares."""


@dataclass(frozen=True, eq=False)
class Box:
    """Least squares of the columns that the data see, within a box."""

    data: Whitened
    names: tuple[str, ...]  # columns that the data see, `k` of them
    lower: Array  # their lower bounds, `(k,)`
    upper: Array  # their upper bounds, likewise
    root: Array  # their columns of $R$, `(rank, k)`

    @classmethod
    def of(cls, data: Whitened, bounds: Bounds) -> "Box":
        """A box of given bounds.

        Of a parameter that stands for others, which the data cannot distinguish from it, bounds do
        not hold: they are left out.
        """
        solution, columns = data.fit, data.fit.data.whole.layout.columns
        tied = {name for blind in solution.blind for name in blind.tied_to}
        names = tuple(columns[k] for k in solution.kept)
        free = (-np.inf, np.inf)
        ends = [free if name in tied else bounds.get(name, free) for name in names]
        lower, upper = np.array(ends, dtype=np.float64).reshape(-1, 2).T
        root = data.matrix[:, [data.names.index(name) for name in names]]
        return cls(data, names, lower, upper, root)

    def optimum(self) -> Array:
        """The best values within the box, shape `(k,)`."""
        return optimum_within(self.root, self.data.vector, self.lower, self.upper)

    def estimate(self, name: str, values: Array, notes: tuple[str, ...]) -> Estimate:
        """An estimate at values `(k,)`; its covariance counts the residuals that they leave."""
        fit = self.data.fit
        data, old = fit.data, fit
        full = np.zeros(len(old.values))
        full[old.kept] = values
        rise = residual_squares(fit, full) - residual_squares(fit, old.values)
        variances = fit.variances + np.maximum(rise, 0.0) / np.maximum(data.whole.n_samples, 1.0)
        matrix = data.normal(1.0 / variances)[0][np.ix_(old.kept, old.kept)]
        locals_ = tuple(part.solved(full) for part in data.normal(1.0 / variances)[2])
        inverse = inverse_of_gram(matrix)
        found = replace(fit, values=full, inverse=inverse, locals=locals_, variances=variances)
        made = described_fit(name, found, *covariances(found, scatter(fit) / variances))
        at_bounds = self.at_bounds(values)
        at = (f"at a bound: {', '.join(at_bounds)}",) if at_bounds else ()
        return replace(made, notes=(*notes, *at))

    def at_bounds(self, values: Array) -> list[str]:
        """Names of the parameters that lie at a bound."""
        slack = AT_BOUND / np.linalg.norm(self.root, axis=0)
        at = (values <= self.lower + slack) | (values >= self.upper - slack)
        return [name for name, is_at in zip(self.names, at, strict=True) if is_at]


@dataclass(frozen=True)
class Genetic:
    """The weighted squares of the residuals, minimised by a genetic algorithm.

    Attributes:
        bounds: Lower and upper bound by column, see `box.base_bounds`.
        population: Individuals of a generation.
        generations: How many.
        seed: Of all random choices.
    """

    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    population: int = 30
    generations: int = 100
    seed: int = 0

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        box = closed(Box.of(whitened(information, ()), self.bounds))
        values, _ = minimised_by_genes(
            partial(costs, box),
            box.lower,
            box.upper,
            population=self.population,
            generations=self.generations,
            random=np.random.default_rng(self.seed),
        )
        why = f"ended after {self.generations} generations of {self.population}"
        return described(box, "genetic algorithm", values, why)


@dataclass(frozen=True)
class CmaEs:
    """The weighted squares of the residuals, minimised by CMA-ES [Hansen2001].

    Every parameter counts in units of its column's length, so that they are alike for the first
    generation already; it starts in the middle of the box.

    Attributes:
        bounds: Lower and upper bound by column, see `box.base_bounds`.
        evaluations: Most evaluations of the criterion.
        seed: Of all random choices.
    """

    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    evaluations: int = 100_000
    seed: int = 0

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        box = closed(Box.of(whitened(information, ()), self.bounds))
        units, tried = np.linalg.norm(box.root, axis=0), [0]

        def criterion(scaled: Array) -> Array:
            tried[0] += len(scaled)
            return costs(box, scaled / units)

        values, _ = minimised_by_cma_es(
            criterion,
            box.lower * units,
            box.upper * units,
            evaluations=self.evaluations,
            random=np.random.default_rng(self.seed),
        )
        why = f"ended after {tried[0]} evaluations of {self.evaluations} at most"
        return described(box, "CMA-ES", np.clip(values / units, box.lower, box.upper), why)


def closed(box: Box) -> Box:
    r"""The box with ends everywhere: no parameter beyond $\pm r\,s$ around zero.

    $s$ is the parameter's size, $\max(|\varphi|, 3\sigma)$ of weighted least squares, and $r$ is
    `REACH`; where that range misses the bounds, it begins at the bound.
    """
    solution = box.data.fit
    sizes = np.maximum(
        np.abs(solution.values[solution.kept]), 3.0 * np.sqrt(np.diag(solution.inverse))
    )
    half = REACH * np.maximum(sizes, 1e-12)
    lower, upper = np.maximum(box.lower, -half), np.minimum(box.upper, half)
    above, below = box.lower >= half, box.upper <= -half
    upper = np.where(above, np.minimum(box.upper, box.lower + 2.0 * half), upper)
    lower = np.where(below, np.maximum(box.lower, box.upper - 2.0 * half), lower)
    return replace(box, lower=lower, upper=upper)


def costs(box: Box, values: Array) -> Array:
    """Weighted squares of the residuals of a population `(B, k)`, shape `(B,)`."""
    residuals = values @ box.root.T - box.data.vector
    return np.asarray(np.sum(np.square(residuals), axis=1) + rest_of(box))


def rest_of(box: Box) -> float:
    """Weighted squares of the residuals that no values explain."""
    fit = box.data.fit
    squares = float(np.sum(residual_squares(fit, fit.values) / fit.variances))
    left = box.root @ fit.values[fit.kept] - box.data.vector
    return max(squares - float(left @ left), 0.0)


def described(box: Box, name: str, values: Array, why: str) -> Estimate:
    """What a search found, and how near it came to the optimum."""
    found, best = costs(box, np.array([values, box.optimum()]))
    ratio = found / best if best > 0.0 else np.inf
    verb = "reached" if ratio <= REACHED else "did not reach"
    notes = (
        why,
        f"{verb} the optimum: weighted squares {ratio:.6g} times those of bounded least squares",
    )
    return box.estimate(name, values, notes)


def comparison(
    best: Callable[..., float], information: Information
) -> list[tuple[str, str, str, bool]]:
    """Rows for the benchmark's table: times, and what the searches say of the optimum."""
    rows = []
    for name, estimator in (
        ("bounded least squares", BoundedLeastSquares()),
        ("genetic algorithm, 30 x 100", Genetic()),
        ("CMA-ES, 10 000 evaluations", CmaEs(evaluations=10_000)),
    ):
        took = best(lambda estimator=estimator: estimator(information), 1)
        notes = estimator(information).notes[1:2]
        rows.append((f"linear problem, {name}", f"{1e3 * took:.0f} ms", *(notes or ("",)), True))
    return rows
