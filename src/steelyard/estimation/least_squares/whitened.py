r"""Information as a small least-squares problem, $\chi^2 = \|R\phi - z\|^2 + \mathrm{rest}$.

Rows are weighted by the variance of their residuals in weighted least squares, widened where
residuals are alike for longer than the filter; parameters of single runs are eliminated, and what
is left is compressed to as many rows as the data have rank.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.beside_rests import moved
from steelyard.estimation.least_squares.least_squares import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimation.least_squares.normal_equations import Fit, refuse_few, scores_of
from steelyard.estimation.least_squares.sandwich import inflations, scatter
from steelyard.estimation.per_run import Eliminated
from steelyard.regression.information import Information

RANK = 1e-11
"""Eigenvalue of the normal matrix, columns of unit length, below which it is rounding."""

FREEDOM = 2.0
"""Independent samples per parameter that a fit needs at least."""


@dataclass(frozen=True, eq=False)
class Whitened:
    """A least-squares problem in base parameters.

    Attributes:
        fit: Weighted least squares of the same data.
        eliminated: Per run its own parameters, as functions of the others.
        names: Base parameters, `c` of them; those of single runs are not among them.
        matrix: `R`, shape `(rank, c)`.
        vector: `z`, shape `(rank,)`.
        noise: Covariance of `z` from windows of time and samples beside rests, shape
            `(rank, rank)`.
        lengths: Root of the sum of squares of each whitened column, shape `(c,)`.
        effort: Root of the sum of squares of the whitened efforts.
    """

    fit: Fit
    eliminated: tuple[Eliminated, ...]
    names: tuple[str, ...]
    matrix: Array
    vector: Array
    noise: Array
    lengths: Array
    effort: float

    @property
    def rank(self) -> int:
        """Rows of `matrix`."""
        return len(self.vector)


def whitened(
    information: Information, per_run: Sequence[str] = (), *, equal: bool = False
) -> Whitened:
    """Compress information.

    Args:
        information: What the data say.
        per_run: Columns whose parameters every run has for itself.
        equal: Whether all rows weigh the same, by their mean variance.

    Raises:
        DataError: There are too few samples to distinguish noise from motion.
    """
    refuse_few(information, len(information.layout.columns), FREEDOM)
    fit = WeightedLeastSquares(per_run=tuple(per_run)).fit(information)
    variances = fit.variances * inflations(fit)
    if equal:
        counts = information.n_samples
        variances = np.full(len(counts), variances @ counts / counts.sum())
    normal, right, eliminated, squares = fit.data.normal(1.0 / variances)
    columns = [k for k in range(len(right)) if k not in fit.data.local]
    normal, right = normal[np.ix_(columns, columns)], right[columns]
    lengths = np.sqrt(np.maximum(np.diag(normal), 0.0))
    scale = np.where(lengths > 1e-12 * lengths.max(initial=1e-300), lengths, np.inf)
    values, vectors = np.linalg.eigh(normal / scale[:, None] / scale)
    kept = values > RANK * values[-1]
    roots, vectors = np.sqrt(values[kept]), vectors[:, kept]
    finite = np.where(np.isfinite(scale), scale, 0.0)
    effort = information.effort_squares() @ (1.0 / variances)
    names, matrix = (
        tuple(information.layout.columns[k] for k in columns),
        (vectors * roots).T * finite,
    )
    if equal:
        noise = _noise(names, matrix, OrdinaryLeastSquares(tuple(per_run))(information))
    else:
        root = (vectors / scale[:, None]).T / roots[:, None]
        squared = fit.variances * scatter(fit) / np.square(variances)
        noise = root @ scores_of(fit.data, eliminated, columns, squared) @ root.T
        shift = moved(fit, 1.0 / variances, root, columns, noise)
        noise += np.outer(shift, shift)
    return Whitened(
        fit,
        eliminated,
        names,
        matrix,
        (vectors.T @ (right / scale)) / roots,
        noise,
        np.sqrt(np.maximum(squares[columns], 0.0)),
        float(np.sqrt(effort)),
    )


def _noise(names: Sequence[str], matrix: Array, plain: Estimate) -> Array:
    """Covariance of `z` where rows weigh the same: of what ordinary least squares makes of it."""
    place = {name: k for k, name in enumerate(plain.parameters.names)}
    shared = [name for name in names if name in place]
    mine, theirs = [names.index(name) for name in shared], [place[name] for name in shared]
    covariance = plain.covariance[np.ix_(theirs, theirs)]
    return np.asarray(matrix[:, mine] @ covariance @ matrix[:, mine].T)
