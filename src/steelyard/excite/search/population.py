"""Search methods by their names: Newton from random starts, genetic algorithm, CMA-ES.

Real genes, tournaments of two, simulated binary crossover [Deb1995] and polynomial mutation; of
parents and offspring together the best survive, so the best one is never lost.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil
from types import MappingProxyType
from typing import Protocol

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, advice
from steelyard.base.progress import Event, Progress, report_progress, silent
from steelyard.excite.problem import Problem, composed_motions
from steelyard.excite.search.feasibility import each_start, random_starts
from steelyard.excite.search.newton import STAGES, minimised

Watch = Callable[[Array], None]
"""Told of coefficients in the feasible set; may raise `progress.Stopped`."""


class Method(Protocol):
    """A way to search."""

    def search(self, problem: Problem, random: np.random.Generator, watch: Watch) -> Array:
        """The coefficients that one search ends with, feasible at their samples.

        Args:
            problem: What is designed.
            random: Source of all random choices: another one makes another search.
            watch: Told of every step.
        """
        ...


@dataclass(frozen=True)
class Gradient:
    """Random starts, and Newton's method within a barrier from the best of them.

    Attributes:
        screened: Random starts of which the best is improved; of a robot with `l` limbs one for
            `l**2`: each start takes `l` looks at the constraints, and gives each limb one of its
            own.
    """

    screened: int = 60

    def search(self, problem: Problem, random: np.random.Generator, watch: Watch) -> Array:
        """See `Method`; starts that show too little are not reported."""
        count = ceil(self.screened / len(problem.limbs) ** 2)
        joints = [limb.joints for limb in problem.limbs]
        starts = each_start(problem.inequalities, random, count, joints)
        for start in composed_motions(problem, starts):
            if np.isfinite(problem.objective.value(start, STAGES[0][0])):
                watch(start)
        return minimised(problem.objective, problem.inequalities, start, watch=watch)


def seeded(seed: int, number: int) -> np.random.Generator:
    """The source of random choices of search `number`, the same on every machine."""
    return np.random.default_rng([seed, number])


@dataclass(frozen=True, eq=False)
class PopulationResult:
    """The best point that was tried, shape `(k,)`, its criterion, and evaluations of that.

    The search is `spent` if its budget of evaluations ended it.
    """

    values: Array
    cost: float
    evaluations: int
    spent: bool = False


def minimised_by_genes(
    criterion: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    population: int = 30,
    generations: int = 100,
    seed: int = 0,
    progress: Progress = silent,
) -> PopulationResult:
    """Minimise any criterion within a box `(k,)` by a genetic algorithm with elitism.

    The criterion gives costs `(B,)` of individuals `(B, k)`.
    """
    try:
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.core.evaluator import Evaluator
        from pymoo.core.problem import Problem
        from pymoo.problems.static import StaticProblem
    except ImportError as error:
        raise DataError(
            f"the genetic algorithm needs the package pymoo ({error})",
            where="genetic algorithm",
            fix='pip install "steelyard[population]"',
        ) from error
    if population < 2 or generations < 1:
        raise DataError(
            f"a population of {population} over {generations} generations",
            where="genetic algorithm",
            fix="give at least two individuals and one generation, such as 30 and 100",
        )
    span = upper - lower
    genes = Problem(n_var=len(span), n_obj=1, xl=np.zeros(len(span)), xu=np.ones(len(span)))
    algorithm = GA(pop_size=population)
    algorithm.setup(genes, termination=("n_gen", generations), seed=seed, verbose=False)
    values, cost, evaluations = 0.5 * (lower + upper), np.inf, 0
    for generation in range(generations):
        individuals = algorithm.ask()
        tried = lower + span * individuals.get("X")
        costs = criterion(tried)
        evaluations += len(costs)
        if costs.min() < cost:
            values, cost = tried[costs.argmin()], float(costs.min())
        Evaluator().eval(StaticProblem(genes, F=costs[:, None]), individuals)
        algorithm.tell(infills=individuals)
        report_progress(progress, "genetic algorithm", generation + 1, generations)
    return PopulationResult(values, cost, evaluations)


FIRST_DEVIATION_SHARE = 0.3
"""First standard deviation, over the width of the box."""

BUDGET_SPENT = "maxfevals"
"""How cma says that its budget is spent."""


def minimised_by_cma_es(
    criterion: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    units: Array | None = None,
    evaluations: int = 100_000,
    least: float = 0.0,
    random: np.random.Generator,
    progress: Progress = silent,
) -> PopulationResult:
    """Minimise any criterion within a box `(k,)` by CMA-ES [Hansen2001], from its middle.

    Args:
        criterion: Costs `(B,)` of points `(B, k)`.
        lower: Shape `(k,)`.
        upper: Shape `(k,)`.
        units: Length of each variable for which all are alike, shape `(k,)`; ones if `None`.
        evaluations: Most evaluations.
        least: Difference of costs that counts as none.
        random: Source of all random choices.
        progress: Told about every generation.
    """
    lengths = np.ones_like(lower) if units is None else units
    spans = (upper - lower) * lengths
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import cma
        except ImportError as error:
            raise DataError(
                f"CMA-ES needs the package cma ({error})",
                where="CMA-ES",
                fix='pip install "steelyard[population]"',
            ) from error
        options = {
            "bounds": [(lower * lengths).tolist(), (upper * lengths).tolist()],
            "CMA_stds": (spans / spans.max()).tolist(),
            "maxfevals": evaluations,
            "randn": lambda *shape: random.standard_normal(shape),
            "seed": np.nan,
            "verbose": -9,
            "tolfun": least,
        }
        middle = 0.5 * (lower + upper) * lengths
        strategy = cma.CMAEvolutionStrategy(middle, FIRST_DEVIATION_SHARE * spans.max(), options)
    values, best = middle / lengths, np.inf
    while not strategy.stop():
        points = strategy.ask()
        tried = np.clip(np.array(points) / lengths, lower, upper)
        costs = criterion(tried)
        if costs.min() < best:
            values, best = tried[costs.argmin()], float(costs.min())
        strategy.tell(points, costs.tolist())
        report_progress(progress, "CMA-ES", strategy.countevals, evaluations)
    spent = BUDGET_SPENT in strategy.stop()
    return PopulationResult(values, best, int(strategy.countevals), spent)


POPULATION_SHARPNESS = 64.0
"""Of the criterion: within some percent of its value."""

_INSIDE_SHARE = 0.98
_SIZE_SHRINK = 0.7
_LEAST_SIZE = 1e-3


@dataclass(frozen=True, eq=False)
class _Genes:
    """Variables from -1 to 1: a posture per joint, then how far each function is moved.

    Attributes:
        units: How far each function alone may be moved, shape `(n, m)`.
    """

    problem: Problem
    units: Array

    @classmethod
    def of(cls, problem: Problem) -> "_Genes":
        inequalities = problem.inequalities
        middle = 0.5 * (inequalities.limits.lower + inequalities.limits.upper)
        still = inequalities.basis.still(middle)
        margins = inequalities.limit_margins(still)
        units = np.empty_like(still)
        for k in range(still.shape[1]):
            change = np.zeros_like(still)
            change[:, k] = 1.0
            rates = np.abs(inequalities.margin_rates(change))
            units[:, k] = np.min(margins / np.maximum(rates, 1e-12), axis=1)
        return cls(problem, units)

    @property
    def count(self) -> int:
        """Number of variables."""
        return len(self.units) + self.units.size

    def still(self, genes: Array) -> Array:
        """Coefficients of standing at the posture."""
        limits = self.problem.limits
        middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
        return self.problem.basis.still(middle + _INSIDE_SHARE * half * genes[: len(half)])

    def motion(self, genes: Array) -> Array | None:
        """Coefficients of a motion in the feasible set; `None` if its posture is not free."""
        inequalities, n = self.problem.inequalities, len(self.units)
        still = self.still(genes)
        if inequalities.smallest_margin(still) <= 0.0:
            return None
        change = self.units * genes[n:].reshape(self.units.shape)
        room = np.min(
            inequalities.limit_margins(still)
            / np.maximum(-inequalities.margin_rates(change), 1e-12),
            axis=1,
        )
        change = np.minimum(1.0, _INSIDE_SHARE * room)[:, None] * change
        factor = 1.0
        while inequalities.smallest_margin(still + factor * change) <= 0.0:
            factor *= _SIZE_SHRINK
            if factor < _LEAST_SIZE:
                return None
        return np.asarray(still + factor * change)

    def costs(self, watch: Watch, start: Array) -> Callable[[Array], Array]:
        """The criterion of many sets of genes, `(B, k)` to `(B,)`; each is shrunk until feasible.

        Where a posture is not free, what it lacks leads out. Whatever is better than `start` and
        all before is reported to `watch`.
        """
        best = [self.problem.objective(start, POPULATION_SHARPNESS)[0]]

        def cost(genes: Array) -> float:
            x = self.motion(genes)
            if x is None:
                lack = -self.problem.inequalities.smallest_margin(self.still(genes))
                return NOTHING_SHOWN_COST + min(max(lack, 0.0), NOTHING_SHOWN_COST)
            value = min(self.problem.objective.value(x, POPULATION_SHARPNESS), NOTHING_SHOWN_COST)
            if value < best[0]:
                best[0] = value
                watch(x)
            return value

        return lambda many: np.array([cost(genes) for genes in many])


NOTHING_SHOWN_COST = 50.0
"""Cost of a motion that shows too little, that of a condition number of 5e21; more if not free."""


def _evolved(
    problem: Problem,
    random: np.random.Generator,
    watch: Watch,
    minimise: Callable[[Callable[[Array], Array], Array, Progress], PopulationResult],
) -> Array:
    """Minimise over postures and amplitudes; the best so far is reported at every generation."""
    genes = _Genes.of(problem)
    best = random_starts(problem.inequalities, random, 1)

    def report(x: Array) -> None:
        best[:] = [x]
        watch(x)

    def progress(event: Event) -> bool:
        watch(best[-1])
        return True

    minimise(genes.costs(report, best[-1]), np.ones(genes.count), progress)
    return best[-1]


@dataclass(frozen=True)
class GeneticSearch:
    """A genetic algorithm over postures and amplitudes, shrunk until feasible."""

    population: int = 100
    generations: int = 400

    def search(self, problem: Problem, random: np.random.Generator, watch: Watch) -> Array:
        """See `Method`."""
        options: dict[str, int] = {"population": self.population, "generations": self.generations}
        return _evolved(
            problem,
            random,
            watch,
            lambda costs, box, progress: minimised_by_genes(
                costs, -box, box, **options, seed=int(random.integers(2**31)), progress=progress
            ),
        )


@dataclass(frozen=True)
class CmaEsSearch:
    """CMA-ES over postures and amplitudes, shrunk until feasible; most `evaluations`."""

    evaluations: int = 40_000

    def search(self, problem: Problem, random: np.random.Generator, watch: Watch) -> Array:
        """See `Method`."""
        return _evolved(
            problem,
            random,
            watch,
            lambda costs, box, progress: minimised_by_cma_es(
                costs, -box, box, evaluations=self.evaluations, random=random, progress=progress
            ),
        )


METHODS: Mapping[str, Method] = MappingProxyType(
    {"gradient": Gradient(), "genetic": GeneticSearch(), "cma_es": CmaEsSearch()}
)


def method_of(name: str) -> Method:
    """The method of a name."""
    if name not in METHODS:
        raise DataError(
            f"there is no search method '{name}'",
            where="[excitation.search] method",
            fix=advice(name, METHODS, "methods"),
        )
    return METHODS[name]
