r"""Least squares within bounds by a genetic algorithm, as [WangC] identifies (section III.D).

It minimises $\sqrt{\tfrac{1}{M} \sum_m (\tau(m) - Y(m)\,\phi)^2}$ over all rows of all joints
(eq. 24) for base parameters within bounds. The squares follow from the sums of products: an
individual costs a quadratic form, however many samples there are. The objective is convex, so
least squares within bounds solves the same problem exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.estimate import Estimate, Evolution
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.covariance_from_residuals import covariances, scatter
from steelyard.estimate.least_squares.known_bounded_and_ridge import (
    base_bounds,
    residual_squares,
)
from steelyard.estimate.least_squares.normal_equations import (
    Runs,
    described,
    solve,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.robot.file.sections import GeneticSection

CROSSOVER, MUTATION = 0.8, 0.2  # probability of an individual, and of a gene; not printed
STEP = 0.1  # first standard deviation of a mutation, over the width of the box; not printed


def evolved(
    criterion: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    settings: GeneticSection,
    progress: Progress = silent,
) -> tuple[Array, Array]:
    """Minimise a criterion, `(B, k)` to costs `(B,)`, within a box by the steps 1 to 10 of [WangC].

    After crossover, and again after mutation, the best of old and new individuals survive. What the
    paper does not print is assumed: parents from tournaments of two, children on the line through
    both, up to half their distance beyond; normal mutations that become smaller to the end.

    Returns:
        The best individual, `(k,)`, and the best and the mean cost of every generation, `(g, 2)`.
    """
    population, generations, enough = settings.population, settings.generations, settings.sufficient
    random, size = np.random.default_rng(settings.seed), (population, len(lower))

    def survivors(genes: Array, costs: Array, children: Array) -> tuple[Array, Array]:
        children = np.clip(children, 0.0, 1.0)
        costs = np.concatenate([costs, criterion(lower + (upper - lower) * children)])
        best = np.argsort(costs, kind="stable")[:population]
        return np.concatenate([genes, children])[best], costs[best]

    genes, costs = survivors(np.empty((0, len(lower))), np.empty(0), random.random(size))
    history = []
    for generation in range(generations):
        # individuals are sorted: the lower number wins its tournament
        one, other = genes[random.integers(population, size=(2, 2, population)).min(axis=1)]
        share = random.uniform(-0.5, 1.5, size) * (random.random((population, 1)) < CROSSOVER)
        genes, costs = survivors(genes, costs, one + share * (other - one))
        step = STEP * (1.0 - generation / generations) ** 2 * (random.random(size) < MUTATION)
        genes, costs = survivors(genes, costs, genes + step * random.standard_normal(size))
        history.append((costs[0], costs.mean()))
        report_progress(progress, "genetic algorithm", generation + 1, generations)
        if enough is not None and costs[0] <= enough:
            break
    return lower + (upper - lower) * genes[0], np.array(history)


def bounded_by_priors(knowledge: Knowledge) -> Knowledge:
    r"""The same with all bounds that single standard parameters have, and those of priors.

    A link with a prior has up to twice its mass and its second moments $\int r r^T\,dm$ about the
    origin; bounds that prior constraints give to single parameters take precedence.
    """
    place = {name: k for k, name in enumerate(knowledge.names)}
    lower, upper = knowledge.lower.copy(), knowledge.upper.copy()
    for body, prior in enumerate(knowledge.priors):
        if prior is not None:
            tens, moment = knowledge.tens(body), 0.5 * float(prior.ten[[4, 6, 9]].sum())
            first, product = 2.0 * np.sqrt(prior.mass * moment), np.isin(range(6), (1, 3, 4))
            lower[tens] = [0.0, *[-first] * 3, *np.where(product, -moment, 0.0)]
            upper[tens] = [2.0 * prior.mass, *[first] * 3, *np.where(product, moment, 2.0 * moment)]
    for row in knowledge.rows:
        if len(row.coefficients) == 1:
            ((name, factor),) = row.coefficients.items()
            low, high = sorted((row.lower / factor, row.upper / factor))
            k = place[name]
            lower[k] = low if np.isfinite(low) else lower[k]
            upper[k] = high if np.isfinite(high) else upper[k]
    return replace(knowledge, lower=lower, upper=upper)


AT_BOUND = 1e-3  # distance from a bound, over the range, up to which a value lies on it


@dataclass(frozen=True, eq=False)
class Genetic:
    """Ordinary least squares within bounds by a genetic algorithm ([WangC], section III.D).

    The standard deviations are those of least squares with the residuals that are left; what the
    search leaves of the way to the optimum is not in them.
    """

    base: BaseMap
    knowledge: Knowledge  # bounds of parameters, priors of links
    settings: GeneticSection = GeneticSection()
    progress: Progress = silent

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see; a `DataError` names those without bounds."""
        data, ones = Runs.of(information, ()), np.ones(len(information.layout.rows))
        free = solve(data, ones)
        names = tuple(information.layout.columns[k] for k in free.kept)
        lower, upper = self._box(names)
        optimum = free.values[free.kept]
        least = float(residual_squares(free, free.values).sum())
        count = float(information.n_samples.sum())

        def error(values: Array) -> Array:
            away = values - optimum
            squares = least + np.sum(away @ free.normal * away, axis=1)
            return np.asarray(np.sqrt(np.maximum(squares, 0.0) / count))

        values, history = evolved(error, lower, upper, self.settings, self.progress)
        best, mean = history.T
        full = np.zeros(len(free.values))
        full[free.kept] = values
        fit = free.at(full)
        factors = scatter(WeightedLeastSquares().fit(information))
        made = described("genetic algorithm", fit, *covariances(fit, factors * fit.variances, ones))
        end = float(np.sqrt(max(least, 0.0) / count))
        room = np.minimum(values - lower, upper - values)
        held = np.flatnonzero(room <= AT_BOUND * (upper - lower))
        unused = [row.label for row in self.knowledge.rows if len(row.coefficients) > 1]
        return replace(
            made,
            at_bound=tuple(names[k] for k in held),
            notes=(
                f"root mean square error {best[-1]:.4g} after {len(best)} generations of "
                f"{self.settings.population}; least squares without bounds has {end:.4g}",
                *([f"the genetic algorithm does not use: {'; '.join(unused)}"] if unused else []),
            ),
            evolution=Evolution(
                names, frozen(lower), frozen(upper), frozen(best), frozen(mean), end
            ),
        )

    def _box(self, names: tuple[str, ...]) -> tuple[Array, Array]:
        """Lower and upper bounds of columns, shape `(k,)` each."""
        known = bounded_by_priors(self.knowledge)
        every = base_bounds(self.base, known)
        bounds = {name: every.get(name, (-np.inf, np.inf)) for name in names}
        ends = zip(known.names, known.lower, known.upper, strict=True)
        free = {name for name, *both in ends if not np.isfinite(both).all()}
        groups = {
            name: [self.base.names[k] for k in np.flatnonzero(row)]
            for name, row in zip(self.base.base_names, self.base.lift, strict=True)
        }
        open_ = [name for name, both in bounds.items() if not np.isfinite(both).all()]
        members = dict.fromkeys(x for name in open_ for x in groups.get(name, [name]))
        if missing := [x for x in members if x in free or x not in known.names]:
            raise DataError(
                f"the genetic algorithm has no bounds to search between for {', '.join(missing)}",
                where="[[knowledge]]",
                fix='state them in the robot file: [[knowledge]] kind = "parameter", parameter = '
                f'"{missing[0].split(".")[0]}.*", lower = 0.0, upper = 2.0; those of links follow '
                "from the masses of the model file or of [prior.links] where these are known",
            )
        lower, upper = np.array([bounds[name] for name in names]).T
        return lower, upper
