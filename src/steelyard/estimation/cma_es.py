"""Evolution of a normal distribution that learns the criterion's shape, over base parameters."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.box import Box
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.whitened import whitened
from steelyard.progress import Progress, silent, tell
from steelyard.regression.information import Information

SHARE = 0.3
"""First standard deviation, over the width of the box."""

ATTEMPTS = "maxfevals"
"""How cma says that its budget is spent."""


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
        strategy, lengths = self._strategy(box)
        best = np.inf
        values = strategy.mean / lengths
        while not strategy.stop():
            points = strategy.ask()
            tried = np.clip(np.array(points) / lengths, box.lower, box.upper)
            costs = box.costs(tried)
            if costs.min() < best:
                values, best = tried[costs.argmin()], float(costs.min())
            strategy.tell(points, costs.tolist())
            tell(self.progress, "CMA-ES", strategy.countevals, self.evaluations)
        spent = ATTEMPTS in strategy.stop()
        why = f"the budget of {self.evaluations} was spent" if spent else "stood still"
        return box.searched("CMA-ES", values, int(strategy.countevals), why)

    def _strategy(self, box: Box) -> tuple[Any, Array]:
        """The search, and the length that each parameter is counted in."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                import cma
            except ImportError as error:
                raise DataError(
                    f"CMA-ES needs the package cma ({error})",
                    where="estimator 'CMA-ES'",
                    mend='pip install "steelyard[population]"',
                ) from error
            lengths = np.linalg.norm(box.root, axis=0)
            spans = (box.upper - box.lower) * lengths
            middle = 0.5 * (box.lower + box.upper) * lengths
            random = np.random.default_rng(self.seed)
            options = {
                "bounds": [(box.lower * lengths).tolist(), (box.upper * lengths).tolist()],
                "CMA_stds": (spans / spans.max()).tolist(),
                "maxfevals": self.evaluations,
                "randn": lambda *shape: random.standard_normal(shape),
                "seed": np.nan,
                "verbose": -9,
                "tolfun": 1e-9 * max(box.rest, 1e-300),
            }
            return cma.CMAEvolutionStrategy(middle, SHARE * spans.max(), options), lengths
