"""Searches by populations: without slopes, for comparison and for criteria that have none."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.problem import Problem
from steelyard.excitation.search.methods import Watch
from steelyard.excitation.search.starts import random_starts
from steelyard.progress import Event

SHARPNESS = 64.0
"""Of the criterion: within some percent of its value."""

_INSIDE = 0.98
_SHRINK = 0.7
_LEAST = 1e-3


@dataclass(frozen=True, eq=False)
class _Genes:
    """Variables from -1 to 1: a posture per joint, then how far each function is moved.

    Attributes:
        problem: What is designed.
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
        return self.problem.basis.still(middle + _INSIDE * half * genes[: len(half)])

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
        change = np.minimum(1.0, _INSIDE * room)[:, None] * change
        factor = 1.0
        while inequalities.smallest_margin(still + factor * change) <= 0.0:
            factor *= _SHRINK
            if factor < _LEAST:
                return None
        return np.asarray(still + factor * change)

    def costs(self, watch: Watch, start: Array) -> Callable[[Array], Array]:
        """The criterion of many sets of genes, `(B, k)` to `(B,)`; each is shrunk until feasible.

        Where a posture is not free, what it lacks leads out. Whatever is better than `start` and
        all before is reported to `watch`.
        """
        best = [self.problem.objective(start, SHARPNESS)[0]]

        def cost(genes: Array) -> float:
            x = self.motion(genes)
            if x is None:
                lack = -self.problem.inequalities.smallest_margin(self.still(genes))
                return NOTHING + min(max(lack, 0.0), NOTHING)
            value = min(self.problem.objective.value(x, SHARPNESS), NOTHING)
            if value < best[0]:
                best[0] = value
                watch(x)
            return value

        return lambda many: np.array([cost(genes) for genes in many])


NOTHING = 50.0
"""Cost of a motion that shows too little, that of a condition number of 5e21; more if not free."""


@dataclass(frozen=True)
class GeneticSearch:
    """A genetic algorithm over postures and amplitudes, shrunk until feasible.

    Attributes:
        population: Individuals of a generation.
        generations: How many.
    """

    population: int = 100
    generations: int = 400

    def search(self, problem: Problem, random: np.random.Generator, watch: Watch) -> Array:
        """See `Method`."""
        from steelyard.excitation.search.genetic import evolved

        genes = _Genes.of(problem)
        last = _Last(random_starts(problem.inequalities, random, 1)[0], watch)
        evolved(
            genes.costs(last, last.x),
            -np.ones(genes.count),
            np.ones(genes.count),
            population=self.population,
            generations=self.generations,
            seed=int(random.integers(2**31)),
            progress=last.progress,
        )
        return last.x


@dataclass(frozen=True)
class CmaEsSearch:
    """CMA-ES over postures and amplitudes, shrunk until feasible.

    Attributes:
        evaluations: Most evaluations of the criterion.
    """

    evaluations: int = 40_000

    def search(self, problem: Problem, random: np.random.Generator, watch: Watch) -> Array:
        """See `Method`."""
        from steelyard.excitation.search.cma_es import adapted

        genes = _Genes.of(problem)
        last = _Last(random_starts(problem.inequalities, random, 1)[0], watch)
        adapted(
            genes.costs(last, last.x),
            -np.ones(genes.count),
            np.ones(genes.count),
            evaluations=self.evaluations,
            random=random,
            progress=last.progress,
        )
        return last.x


class _Last:
    """The best motion so far, reported to the watcher again at every generation."""

    def __init__(self, x: Array, watch: Watch) -> None:
        self.x, self._watch = x, watch

    def __call__(self, x: Array) -> None:
        self.x = x
        self._watch(x)

    def progress(self, event: Event) -> bool:
        """Heard at every generation."""
        self._watch(self.x)
        return True
