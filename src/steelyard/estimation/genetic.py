"""A genetic algorithm over base parameters, and over whatever else a criterion takes.

Real genes, tournaments of two, simulated binary crossover [Deb1995] and polynomial mutation; of
parents and offspring together the best survive, so the best one is never lost.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.box import Box
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.whitened import whitened
from steelyard.progress import Progress, silent, tell
from steelyard.regression.information import Information


@dataclass(frozen=True)
class Genetic:
    r"""The weighted squares of the residuals, minimised by a genetic algorithm.

    What it minimises is linear least squares, of which `BoundedLeastSquares` has the exact optimum
    at once; the notes say how far from it the search ended. For what is not linear, such as a
    Stribeck speed, give a criterion to `evolved`.

    Attributes:
        bounds: Lower and upper bound by column, see `box.base_bounds`.
        population: Individuals of a generation.
        generations: How many.
        reach: Where no bounds are given, how far from zero a parameter is searched, in units of
            its size by weighted least squares (see `Box.closed`).
        seed: Of all random choices.
        per_run: Columns whose parameters every run has for itself.
        progress: Told about every generation.
    """

    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    population: int = 30
    generations: int = 100
    reach: float = 3.0
    seed: int = 0
    per_run: tuple[str, ...] = ()
    progress: Progress = silent

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see.

        Raises:
            DataError: pymoo is missing, the data show nothing, or a bound is unusable.
            Stopped: `progress` asked to stop.
        """
        box = Box.of(whitened(information, self.per_run), self.bounds).closed(self.reach)
        found = evolved(
            box.costs,
            box.lower,
            box.upper,
            population=self.population,
            generations=self.generations,
            seed=self.seed,
            progress=self.progress,
        )
        why = f"ended after {self.generations} generations of {self.population}"
        return box.searched("genetic algorithm", found.values, found.evaluations, why)


@dataclass(frozen=True, eq=False)
class Evolved:
    """The best individual.

    Attributes:
        values: Its genes, shape `(k,)`.
        cost: Its criterion.
        evaluations: How often the criterion was evaluated.
    """

    values: Array
    cost: float
    evaluations: int


def evolved(
    criterion: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    population: int = 30,
    generations: int = 100,
    seed: int = 0,
    progress: Progress = silent,
) -> Evolved:
    """Minimise any criterion within a box by a genetic algorithm with elitism.

    Args:
        criterion: Costs `(B,)` of individuals `(B, k)`.
        lower: Shape `(k,)`.
        upper: Shape `(k,)`.
        population: Individuals of a generation.
        generations: How many.
        seed: Of all random choices.
        progress: Told about every generation.

    Raises:
        DataError: pymoo is missing.
        Stopped: `progress` asked to stop.
    """
    try:
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.core.evaluator import Evaluator
        from pymoo.core.problem import Problem
        from pymoo.problems.static import StaticProblem
    except ImportError as error:
        raise DataError(
            f"the genetic algorithm needs the package pymoo ({error})",
            where="estimator 'genetic algorithm'",
            mend='pip install "steelyard[population]"',
        ) from error
    refuse_small(population, generations)
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
        tell(progress, "genetic algorithm", generation + 1, generations)
    return Evolved(values, cost, evaluations)


def refuse_small(population: int, generations: int) -> None:
    """There must be someone to pair, at least once.

    Raises:
        DataError: There is not.
    """
    if population < 2 or generations < 1:
        raise DataError(
            f"a population of {population} over {generations} generations",
            where="estimator 'genetic algorithm'",
            mend="give at least two individuals and one generation, such as 30 and 100",
        )
