"""A genetic algorithm over any criterion within a box.

Real genes, tournaments of two, simulated binary crossover [Deb1995] and polynomial mutation; of
parents and offspring together the best survive, so the best one is never lost.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.progress import Progress, report_progress, silent


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
        Stopped: `progress` requested a stop.
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
        report_progress(progress, "genetic algorithm", generation + 1, generations)
    return Evolved(values, cost, evaluations)


def refuse_small(population: int, generations: int) -> None:
    """There must be someone to pair, at least once.

    Raises:
        DataError: There is not.
    """
    if population < 2 or generations < 1:
        raise DataError(
            f"a population of {population} over {generations} generations",
            where="genetic algorithm",
            fix="give at least two individuals and one generation, such as 30 and 100",
        )
