"""Ways to search for a motion, behind one protocol."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil
from typing import Protocol

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.limbs import composed
from steelyard.excitation.problem import Problem
from steelyard.excitation.search.newton import STAGES, minimised
from steelyard.excitation.search.starts import each_start

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
        for start in composed(problem.objective, problem.inequalities, problem.limbs, starts):
            if np.isfinite(problem.objective.value(start, STAGES[0][0])):
                watch(start)
        return minimised(problem.objective, problem.inequalities, start, watch=watch)


def seeded(seed: int, number: int) -> np.random.Generator:
    """The source of random choices of search `number`, the same on every machine."""
    return np.random.default_rng([seed, number])


def searches(
    method: Method, problem: Problem, seed: int, numbers: Iterator[int], watch: Watch
) -> Iterator[tuple[int, Array]]:
    """Searches one after another, each with its number."""
    for number in numbers:
        yield number, method.search(problem, seeded(seed, number), watch)
