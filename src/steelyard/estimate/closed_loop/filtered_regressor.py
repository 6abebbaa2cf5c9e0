"""Filtered regressors and torques of whole runs; when simulating estimators have converged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, Parameters, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.closed_loop.experiment import Experiment, Measured
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.accumulate import MOVING
from steelyard.estimate.information.regressor import ParallelFilter


@dataclass(frozen=True, eq=False)
class FilteredRows:
    """Filtered samples of every effort row; those that do not count are zero.

    Attributes:
        values: Shape `(n, K, ...)`: columns, or one torque.
        counts: How many independent samples each row has, shape `(n,)`.
        share: Per filtered sample how many independent ones it stands for, shape `(K,)`.
    """

    values: Array
    counts: Array
    share: Array


def filtered(values: Array, matched: ParallelFilter) -> Array:
    """Samples `(N, ...)` through the parallel filter, shape `(K, ...)`."""
    from scipy.signal import upfirdn

    missing = -(len(matched.taps) - 1) % matched.decimation
    padded = np.concatenate((np.zeros((missing, *values.shape[1:])), values))
    first = (len(matched.taps) - 1 + missing) // matched.decimation
    count = max(0, (len(values) - len(matched.taps)) // matched.decimation + 1)
    return np.asarray(upfirdn(matched.taps, padded, 1, matched.decimation, 0)[first:][:count])


def rows_of(experiment: Experiment, values: Sequence[Array]) -> FilteredRows:
    """All runs, one behind the other.

    Args:
        experiment: The runs.
        values: Per run shape `(n, N, ...)`.
    """
    parts = [_rows(run, of_run) for run, of_run in zip(experiment.runs, values, strict=True)]
    return FilteredRows(
        np.concatenate([part.values for part in parts], axis=1),
        np.sum([part.counts for part in parts], axis=0),
        np.concatenate([part.share for part in parts]),
    )


def regressors(
    experiment: Experiment, motions: Sequence[tuple[Array, Array, Array]]
) -> list[Array]:
    """Columns that the data see, along motions of `(N, n)` samples, each `(n, N, p)`."""
    return [
        experiment.regressor.dense(*(np.ascontiguousarray(x.T) for x in motion))[
            :, :, experiment.kept
        ]
        for motion in motions
    ]


def torques(experiment: Experiment) -> list[Array]:
    """Measured torques of all runs, each `(n, N)`."""
    return [run.tau.T for run in experiment.runs]


def as_column(rows: FilteredRows) -> FilteredRows:
    """One number per sample as a matrix of one column."""
    return FilteredRows(rows.values[..., None], rows.counts, rows.share)


def normal(left: FilteredRows, right: FilteredRows, sigma: Array) -> Array:
    r"""$\sum_r Z_r^T W_r / \sigma_r^2$, every independent sample counted once."""
    total = 0.0
    for row, spread in enumerate(sigma):
        weighted = left.values[row] * left.share[:, None] / spread**2
        total = total + weighted.T @ right.values[row]
    return np.asarray(total)


def deviations(residuals: FilteredRows, used: int) -> Array:
    """Standard deviation of each row's residuals, shape `(n,)`; rows share `used` parameters."""
    squares = np.einsum("rk,k,rk->r", residuals.values, residuals.share, residuals.values)
    left = np.maximum(residuals.counts - used / len(residuals.counts), 1.0)
    return np.asarray(np.sqrt(squares / left))


def _rows(run: Measured, values: Array) -> FilteredRows:
    matched = run.matched
    kept = (filtered(run.counts_after_transient, matched) > MOVING).astype(np.float64)
    found = np.stack([filtered(row, matched) for row in values])
    mask = kept.T.reshape(found.shape[:2] + (1,) * (found.ndim - 2))
    share = np.full(len(kept), 1.0 / matched.inflation)
    return FilteredRows(found * mask, kept.sum(axis=0) / matched.inflation, share)


QUIET = 0.03
"""Change of the values over their standard deviations, root mean square, that is none."""

EXACT = 1e-7
"""Change of the torque, over the torque, that is none."""


def floored(sigma: Array, torque: FilteredRows) -> Array:
    """Standard deviations that exact data do not make zero, shape `(n,)`."""
    size = np.sqrt(np.mean(np.square(torque.values), axis=1))
    return np.maximum(sigma, 1e-10 * max(float(size.max()), 1e-300))


def converged(change: Array, matrix: Array, torque: FilteredRows, sigma: Array) -> bool:
    """Whether a change of the values says nothing.

    Args:
        change: Shape `(p,)`.
        matrix: Inverse covariance of the values, shape `(p, p)`.
        torque: Measured torque.
        sigma: Its deviations, shape `(n,)`.
    """
    size = float(change @ matrix @ change)
    whole = np.einsum("rk,k,r->", np.square(torque.values), torque.share, 1.0 / sigma**2)
    return size <= QUIET**2 * len(change) or size <= EXACT**2 * float(whole)


def result(
    name: str,
    experiment: Experiment,
    values: Array,
    covariance: Array,
    sigma: Array,
    counts: Array,
    notes: tuple[str, ...],
) -> Estimate:
    """The estimate with the start's names and blind parameters."""
    start = experiment.start
    if not (np.isfinite(values).all() and np.isfinite(covariance).all()):
        raise DataError(
            f"{name} ended with values that are not finite",
            where=experiment.where,
            fix="log a motion that excites the joints more",
        )
    return replace(
        start,
        estimator=name,
        parameters=Parameters(start.parameters.names, start.parameters.units, values),
        covariance=frozen((covariance + covariance.T) / 2.0),
        sigma=frozen(sigma),
        n_samples=frozen(counts),
        notes=(*experiment.notes, *experiment.start_values.notes, *notes),
    )


def not_converged_error(name: str, experiment: Experiment, rounds: int) -> DataError:
    """What to say of a search that does not come to an end."""
    return DataError(
        f"{name} did not converge within {rounds} rounds",
        where=experiment.where,
        fix="filter the motion more, or log one that excites the joints more",
    )
