"""Evolution of a normal distribution that learns the criterion's shape, over base parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.box import Box
from steelyard.estimation.least_squares.whitened import whitened
from steelyard.progress import Progress, silent
from steelyard.regression.information import Information
from steelyard.search.cma_es import adapted


@dataclass(frozen=True)
class CmaEs:
    r"""The weighted squares of the residuals, minimised by CMA-ES [Hansen2001].

    Every parameter counts in units of its column's length, so that they are alike for the first
    generation already; it starts in the middle of the box. As with `Genetic`, least squares knows
    the optimum beforehand, and the notes say how far from it the search ended.

    Attributes:
        bounds: Lower and upper bound by column, see `box.base_bounds`.
        evaluations: Most evaluations of the criterion.
        reach: Where no bounds are given, how far from zero a parameter is searched, in units of
            its size by weighted least squares (see `Box.closed`).
        seed: Of all random choices.
        per_run: Columns whose parameters every run has for itself.
        progress: Told about every generation.
    """

    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    evaluations: int = 100_000
    reach: float = 3.0
    seed: int = 0
    per_run: tuple[str, ...] = ()
    progress: Progress = silent

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see.

        Raises:
            DataError: cma is missing, the data show nothing, or a bound is unusable.
            Stopped: `progress` asked to stop.
        """
        box = Box.of(whitened(information, self.per_run), self.bounds).closed(self.reach)
        if self.evaluations < 1:
            raise DataError(
                f"a budget of {self.evaluations} evaluations",
                where="estimator 'CMA-ES'",
                mend="give some, such as 100 000",
            )
        found = adapted(
            box.costs,
            box.lower,
            box.upper,
            units=np.linalg.norm(box.root, axis=0),
            evaluations=self.evaluations,
            least=1e-9 * max(box.rest, 1e-300),
            random=np.random.default_rng(self.seed),
            progress=self.progress,
        )
        why = f"the budget of {self.evaluations} was spent" if found.spent else "stagnated"
        return box.searched("CMA-ES", found.values, found.evaluations, why)
