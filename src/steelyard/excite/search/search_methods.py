"""Search methods by their names: Newton from random starts, genetic algorithm, CMA-ES.

Real genes, tournaments of two, simulated binary crossover [Deb1995] and polynomial mutation; of
parents and offspring together the best survive, so the best one is never lost.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from math import ceil

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, refuse_unknown, require
from steelyard.base.progress import Event, Progress, report_progress, silent
from steelyard.excite.design_problem_and_information import Problem, composed_motions
from steelyard.excite.search.feasibility import each_start
from steelyard.excite.search.margins_barrier_and_newton import STAGES, StepWatch, minimised

Method = Callable[[Problem, np.random.Generator, StepWatch], Array]
"""A search: of a problem, with a source of all its random choices, and told of every step.

It gives the coefficients that it ends with, feasible at their samples.
"""


def search_by_gradient(
    problem: Problem, random: np.random.Generator, watch: StepWatch, screened: int = 60
) -> Array:
    """Newton's method within a barrier from the best of `screened` random starts.

    Of a robot with `l` limbs one for `l**2` is tried: each start takes `l` looks at the
    constraints, and gives each limb one of its own. Starts that show too little are not reported.
    """
    count = ceil(screened / len(problem.limbs) ** 2)
    joints = [limb.joints for limb in problem.limbs]
    starts = each_start(problem.inequalities, random, count, joints)
    for start in composed_motions(problem, starts):
        if np.isfinite(problem.objective.value(start, STAGES[0][0])):
            watch(start)
    return minimised(problem.objective, problem.inequalities, start, watch=watch)


def seeded(seed: int, number: int) -> np.random.Generator:
    """The source of random choices of search `number`, the same on every machine."""
    return np.random.default_rng([seed, number])


BestPoint = tuple[Array, float]  # the best point that was tried, `(k,)`, and its criterion


def minimised_by_genes(
    criterion: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    population: int = 30,
    generations: int = 100,
    random: np.random.Generator,
    progress: Progress = silent,
) -> BestPoint:
    """Minimise any criterion, `(B, k)` to costs `(B,)`, within a box by a genetic algorithm."""
    require("pymoo", "population", "genetic searches", "genetic algorithm")
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.problems.static import StaticProblem

    span = upper - lower
    genes = Problem(n_var=len(span), n_obj=1, xl=np.zeros(len(span)), xu=np.ones(len(span)))
    algorithm, seed = GA(pop_size=population), int(random.integers(2**31))
    algorithm.setup(genes, termination=("n_gen", generations), seed=seed, verbose=False)
    values, cost = 0.5 * (lower + upper), np.inf
    for generation in range(generations):
        individuals = algorithm.ask()
        tried = lower + span * individuals.get("X")
        costs = criterion(tried)
        if costs.min() < cost:
            values, cost = tried[costs.argmin()], float(costs.min())
        Evaluator().eval(StaticProblem(genes, F=costs[:, None]), individuals)
        algorithm.tell(infills=individuals)
        report_progress(progress, "genetic algorithm", generation + 1, generations)
    return values, cost


FIRST_DEVIATION_SHARE = 0.3  # first standard deviation, over the width of the box


def minimised_by_cma_es(
    criterion: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    evaluations: int = 100_000,
    random: np.random.Generator,
    progress: Progress = silent,
) -> BestPoint:
    """Minimise any criterion, `(B, k)` to costs `(B,)`, within a box by CMA-ES [Hansen2001].

    It begins in the middle, and ends where nothing changes or the evaluations are spent.
    """
    spans, middle = upper - lower, 0.5 * (lower + upper)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        require("cma", "population", "searches by CMA-ES", "CMA-ES")
        import cma

        options = {
            "bounds": [lower.tolist(), upper.tolist()],
            "CMA_stds": (spans / spans.max()).tolist(),
            "maxfevals": evaluations,
            "randn": lambda *shape: random.standard_normal(shape),
            "seed": np.nan,
            "verbose": -9,
            "tolfun": 0.0,
        }
        strategy = cma.CMAEvolutionStrategy(middle, FIRST_DEVIATION_SHARE * spans.max(), options)
    values, best = middle, np.inf
    while not strategy.stop():
        points = strategy.ask()
        tried = np.clip(np.array(points), lower, upper)
        costs = criterion(tried)
        if costs.min() < best:
            values, best = tried[costs.argmin()], float(costs.min())
        strategy.tell(points, costs.tolist())
        report_progress(progress, "CMA-ES", strategy.countevals, evaluations)
    return values, best


POPULATION_SHARPNESS = 64.0  # of the criterion: within some percent of its value

_INSIDE_SHARE = 0.98
_SIZE_SHRINK = 0.7
_LEAST_SIZE = 1e-3


@dataclass(frozen=True, eq=False)
class _Genes:
    """Variables from -1 to 1: a posture per joint, then how far each function is moved."""

    problem: Problem

    @cached_property
    def units(self) -> Array:
        """How far each function alone may be moved, `(n, m)`."""
        inequalities = self.problem.inequalities
        middle = 0.5 * (inequalities.limits.lower + inequalities.limits.upper)
        still = inequalities.basis.still(middle)
        margins = inequalities.limit_margins(still)
        units = np.empty_like(still)
        for k in range(still.shape[1]):
            change = np.zeros_like(still)
            change[:, k] = 1.0
            rates = np.abs(inequalities.margin_rates(change))
            units[:, k] = np.min(margins / np.maximum(rates, 1e-12), axis=1)
        return units

    @property
    def count(self) -> int:
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
        room = inequalities.room(still, change)
        change = np.minimum(1.0, _INSIDE_SHARE * room)[:, None] * change
        factor = 1.0
        while inequalities.smallest_margin(still + factor * change) <= 0.0:
            factor *= _SIZE_SHRINK
            if factor < _LEAST_SIZE:
                return None
        return np.asarray(still + factor * change)

    def costs(self, watch: StepWatch, start: Array) -> Callable[[Array], Array]:
        """The criterion of many sets of genes, `(B, k)` to `(B,)`; each is shrunk until feasible.

        Where a posture is not free, what it lacks leads out. What is better than all before is
        reported.
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


NOTHING_SHOWN_COST = 50.0  # of showing too little, as a condition of 5e21; more if not free


def search_by_population(
    problem: Problem,
    random: np.random.Generator,
    watch: StepWatch,
    minimise: Callable[..., BestPoint],
    **sizes: int,
) -> Array:
    """Minimise over postures and amplitudes, shrunk until feasible.

    The best so far is reported at every generation.
    """
    genes = _Genes(problem)
    best = list(each_start(problem.inequalities, random, 1))

    def report(x: Array) -> None:
        best[:] = [x]
        watch(x)

    def progress(event: Event) -> bool:
        watch(best[-1])
        return True

    edge, costs = np.ones(genes.count), genes.costs(report, best[-1])
    minimise(costs, -edge, edge, random=random, progress=progress, **sizes)
    return best[-1]


search_by_genes = partial(
    search_by_population, minimise=minimised_by_genes, population=100, generations=400
)
search_by_cma_es = partial(search_by_population, minimise=minimised_by_cma_es, evaluations=40_000)

METHODS: Mapping[str, Method] = {
    "gradient": search_by_gradient,
    "genetic": search_by_genes,
    "cma_es": search_by_cma_es,
}


def method_of(name: str) -> Method:
    """The method of a name."""
    wrong, where = f"there is no search method '{name}'", "[excitation.search] method"
    refuse_unknown(name, METHODS, wrong, where, "methods", DataError)
    return METHODS[name]
