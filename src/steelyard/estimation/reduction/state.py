r"""A model with some of its base parameters: their values, covariance, errors and condition number.

All states of a path share the weights of the full model's rows, $1/\sigma_j^2$: with weights that
followed each removal, a row that lost a parameter would count less, and the next removal there
would seem cheaper than it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.estimation.estimate import Unidentifiable
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.least_squares.normal_equations import condition_of
from steelyard.estimation.least_squares.sandwich import scatter, score_covariance
from steelyard.regression.information import Information


@dataclass(frozen=True, eq=False)
class FullModel:
    r"""The data of a full model, and the weights that its least squares found.

    Attributes:
        information: The data, in the columns that they show, `p` of them.
        variances: Residual variance per effort row of the full model, shape `(rows,)`.
        factors: How many times more the estimate scatters than by white residuals, shape `(rows,)`.
        matrix: Normal matrix $A^T W A$, columns of unit length, shape `(p, p)`.
        vector: $A^T W b$ of the same columns, shape `(p,)`.
        scores: Covariance of that vector with the factors, shape `(p, p)`.
        lengths: Lengths of the weighted columns, shape `(p,)`.
        blind: Columns that the data do not show; they have no value.
    """

    information: Information
    variances: Array
    factors: Array
    matrix: Array
    vector: Array
    scores: Array
    lengths: Array
    blind: tuple[Unidentifiable, ...]

    @classmethod
    def of(cls, information: Information) -> "FullModel":
        """Weighted least squares of all columns that the data show.

        Raises:
            DataError: The data show no parameter, or are too few.
        """
        blind = WeightedLeastSquares().fit(information).solution.blind
        hidden = {one.name for one in blind}
        shown = [name for name in information.layout.columns if name not in hidden]
        seen = information.select(shown) if blind else information
        fit = WeightedLeastSquares().fit(seen)
        factors = scatter(fit)
        matrix, vector, _ = seen.normal(1.0 / fit.variances)
        lengths = np.sqrt(np.diag(matrix))
        return cls(
            seen,
            fit.variances,
            factors,
            frozen(matrix / lengths[:, None] / lengths),
            frozen(vector / lengths),
            frozen(score_covariance(fit, factors) / lengths[:, None] / lengths),
            frozen(lengths),
            blind,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns that the data show."""
        return self.information.layout.columns

    @cached_property
    def norms(self) -> Array:
        """Norms of the unweighted columns over all rows and samples, shape `(p,)`."""
        matrix, _, _ = self.information.normal()
        return np.sqrt(np.maximum(np.diag(matrix), 0.0))

    @cached_property
    def means(self) -> Array:
        """Means of |column| over all rows and samples, shape `(p,)`."""
        return np.asarray(self.information.absolute_sums() / self.information.n_samples.sum())

    def state(self, active: Sequence[int]) -> "State":
        """The model with some of the columns, refitted with the full model's weights."""
        return State(self, tuple(active))


@dataclass(frozen=True, eq=False)
class State:
    r"""A reduced model, all other columns being zero.

    Attributes:
        full: The full model.
        active: Indices of the columns that are left, ascending, `k` of them.
    """

    full: FullModel
    active: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that are left."""
        return tuple(self.full.names[k] for k in self.active)

    def without(self, column: int) -> "State":
        """The model without one more column."""
        return State(self.full, tuple(k for k in self.active if k != column))

    @cached_property
    def _inverse(self) -> Array:
        """Inverse normal matrix of columns of unit length, shape `(k, k)`."""
        return frozen(np.linalg.inv(self.full.matrix[np.ix_(self.active, self.active)]))

    @cached_property
    def _unit_values(self) -> Array:
        index = list(self.active)
        return np.asarray(self._inverse @ self.full.vector[index])

    @property
    def values(self) -> Array:
        """Values of the parameters that are left, shape `(k,)`."""
        return self._unit_values / self.full.lengths[list(self.active)]

    @property
    def all_values(self) -> Array:
        """Values of all columns, zero where removed, shape `(p,)`."""
        values = np.zeros(len(self.full.names))
        values[list(self.active)] = self.values
        return values

    @cached_property
    def ratios(self) -> Array:
        r"""$|\theta_i| / \sigma_i$ with white residuals, shape `(k,)`."""
        return np.abs(self._unit_values) / np.sqrt(np.diag(self._inverse))

    @cached_property
    def losses(self) -> Array:
        r"""Rise of $\chi^2$ by each removal, $\theta_i^2 / C_{ii}$, shape `(k,)`.

        All others are refitted; $C$ counts the correlation of residuals, so that a parameter that
        is zero in truth has a loss of one on average.
        """
        inverse = self._inverse
        scores = self.full.scores[np.ix_(self.active, self.active)]
        variances = np.einsum("ij,jk,ki->i", inverse, scores, inverse, optimize=True)
        return np.asarray(np.square(self._unit_values) / np.maximum(variances, 1e-300))

    @cached_property
    def squares(self) -> Array:
        """Sum of squared residuals per effort row, shape `(rows,)`."""
        return self.full.information.residual_squares(self.all_values)

    @property
    def rms(self) -> Array:
        """Root mean square of the residuals per effort row, shape `(rows,)` [Nm; N]."""
        return np.sqrt(self.squares / np.maximum(self.full.information.n_samples, 1.0))

    @cached_property
    def condition(self) -> float:
        """Condition number of the weighted columns at unit length."""
        some = self.full.matrix[np.ix_(self.active, self.active)]
        return condition_of(frozen(np.linalg.eigvalsh(some)))

    @property
    def chi_square(self) -> float:
        """Squared residuals in variances that count their correlation."""
        full = self.full
        return float(np.sum(self.squares / (full.variances * np.maximum(full.factors, 1.0))))
