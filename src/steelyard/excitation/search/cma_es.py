"""Evolution of a normal distribution that learns a criterion's shape, within a box."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.progress import Progress, report_progress, silent

SHARE = 0.3
"""First standard deviation, over the width of the box."""

ATTEMPTS = "maxfevals"
"""How cma says that its budget is spent."""


@dataclass(frozen=True, eq=False)
class Adapted:
    """The best point that was tried.

    Attributes:
        values: Shape `(k,)`.
        cost: Its criterion.
        evaluations: How often the criterion was evaluated.
        spent: Whether the budget of evaluations ended it.
    """

    values: Array
    cost: float
    evaluations: int
    spent: bool


def adapted(
    criterion: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    units: Array | None = None,
    evaluations: int = 100_000,
    least: float = 0.0,
    random: np.random.Generator,
    progress: Progress = silent,
) -> Adapted:
    """Minimise any criterion within a box by CMA-ES [Hansen2001], from its middle.

    Args:
        criterion: Costs `(B,)` of points `(B, k)`.
        lower: Shape `(k,)`.
        upper: Shape `(k,)`.
        units: Length of each variable for which all are alike, shape `(k,)`; ones if `None`.
        evaluations: Most evaluations.
        least: Difference of costs that counts as none.
        random: Source of all random choices.
        progress: Told about every generation.

    Raises:
        DataError: cma is missing.
        Stopped: `progress` requested a stop.
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
        strategy = cma.CMAEvolutionStrategy(middle, SHARE * spans.max(), options)
    values, best = middle / lengths, np.inf
    while not strategy.stop():
        points = strategy.ask()
        tried = np.clip(np.array(points) / lengths, lower, upper)
        costs = criterion(tried)
        if costs.min() < best:
            values, best = tried[costs.argmin()], float(costs.min())
        strategy.tell(points, costs.tolist())
        report_progress(progress, "CMA-ES", strategy.countevals, evaluations)
    spent = ATTEMPTS in strategy.stop()
    return Adapted(values, best, int(strategy.countevals), spent)
