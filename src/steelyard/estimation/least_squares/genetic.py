"""A genetic algorithm over base parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.box import Box
from steelyard.estimation.least_squares.whitened import whitened
from steelyard.progress import Progress, silent
from steelyard.regression.information import Information
from steelyard.search.genetic import evolved


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
