r"""Recursive least squares: estimates window by window, of parameters that may drift.

What was learned fades as $\lambda^{\Delta t}$ with the time of the windows after it, so parameters
that drift are followed [Ljung1999]. Kept are the faded sums of products, not an inverse: nothing
has to be guessed before the first window.
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.normal_equations import inverse_of_gram
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares

MOST_WINDOWS_APART = 48  # windows that are kept apart, for the correlation of residuals


@dataclass(frozen=True)
class Recursive:
    """Weighted least squares window by window; constant in size however long it goes on."""

    # weight, after a second of further data, of what was learned before, above 0 and up to 1; with
    # 1 nothing fades, and the estimate is that of weighted least squares of all windows
    forgetting: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.forgetting <= 1.0:
            raise DataError(
                f"a forgetting factor of {self.forgetting:g} per second is not valid",
                where="recursive least squares",
                fix="give a weight above 0 and up to 1, such as 0.98",
            )

    def __call__(self, information: Information) -> Estimate:
        """The estimate after all windows, in their order."""
        faded = squared = information.of(())
        for number, window in enumerate(information.windows):
            keep = self.forgetting ** max(window.stop - window.start, 0.0)
            part = information.of([number])
            faded, squared = after(faded, keep, part), after(squared, keep**2, part)
        found = WeightedLeastSquares()(faded)
        name = f"recursive {found.estimator}"
        if self.forgetting == 1.0:
            return replace(found, estimator=name)
        memory = -1.0 / np.log(self.forgetting)
        return replace(
            found,
            estimator=name,
            covariance=_covariance(found, faded, squared),
            notes=(*found.notes, f"data {memory:.3g} s old have weight 1/e"),
        )


def _covariance(found: Estimate, faded: Information, squared: Information) -> Array:
    """What noise does where samples are weighted by their age: its weights enter squared."""
    variances, names = np.square(np.maximum(found.sigma, 1e-300)), found.parameters.names
    weights = 1.0 / variances
    normal = faded.select(names).normal(weights)[0]
    noise = squared.select(names).normal(np.square(weights) * variances)[0]
    inverse = inverse_of_gram(normal)
    covariance = inverse @ noise @ inverse
    return frozen(0.5 * (covariance + covariance.T))


def after(before: Information, keep: float, new: Information) -> Information:
    """Sums that have faded, and new ones; neighbours merge when there get too many."""
    both = before.with_effective_samples(1.0 / keep) + new
    count = len(both.windows)
    if count <= MOST_WINDOWS_APART:
        return both
    return both.grouped([range(k, min(k + 2, count)) for k in range(0, count, 2)])
