"""All estimators, under the names that commands and tables know them by."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from steelyard.estimation.estimate import Estimator
from steelyard.estimation.knowledge import Knowledge
from steelyard.estimation.least_squares import OrdinaryLeastSquares, WeightedLeastSquares
from steelyard.regression.regressor import Regressor

Needs = Literal["information", "samples", "experiment"]
"""What an estimator looks at; see `estimate.Estimator`."""


@dataclass(frozen=True, eq=False)
class Context:
    """What estimators are made from.

    Attributes:
        regressor: Model and columns.
        knowledge: What is known before the data.
        per_run: Columns whose parameters every run has for itself.
    """

    regressor: Regressor
    knowledge: Knowledge
    per_run: tuple[str, ...] = ()


@dataclass(frozen=True)
class Offer:
    """One estimator to choose.

    Attributes:
        name: Short name, as tables show it.
        about: What it is, in a few words.
        needs: What it looks at.
        make: The estimator for a model and what is known of it.
    """

    name: str
    about: str
    needs: Needs
    make: Callable[[Context], Estimator[Any]]


ESTIMATORS: tuple[Offer, ...] = (
    Offer(
        "OLS",
        "ordinary least squares",
        "information",
        lambda c: OrdinaryLeastSquares(per_run=c.per_run),
    ),
    Offer(
        "WLS",
        "least squares, joints weighted by their noise",
        "information",
        lambda c: WeightedLeastSquares(per_run=c.per_run),
    ),
)
