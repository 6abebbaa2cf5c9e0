"""Regressor and torque of whole runs behind the parallel filter: for small experiments."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.closed_loop.experiment import Experiment, Measured
from steelyard.regression.accumulate import MOVING
from steelyard.regression.parallel_filter import ParallelFilter


@dataclass(frozen=True, eq=False)
class Rows:
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


def rows_of(experiment: Experiment, values: Sequence[Array]) -> Rows:
    """All runs, one behind the other.

    Args:
        experiment: The runs.
        values: Per run shape `(n, N, ...)`.
    """
    parts = [_rows(run, of_run) for run, of_run in zip(experiment.runs, values, strict=True)]
    return Rows(
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


def as_column(rows: Rows) -> Rows:
    """One number per sample as a matrix of one column."""
    return Rows(rows.values[..., None], rows.counts, rows.share)


def normal(left: Rows, right: Rows, sigma: Array) -> Array:
    r"""$\sum_r Z_r^T W_r / \sigma_r^2$, every independent sample counted once."""
    total = 0.0
    for row, spread in enumerate(sigma):
        weighted = left.values[row] * left.share[:, None] / spread**2
        total = total + weighted.T @ right.values[row]
    return np.asarray(total)


def deviations(residuals: Rows, used: int) -> Array:
    """Standard deviation of each row's residuals, shape `(n,)`; rows share `used` parameters."""
    squares = np.einsum("rk,k,rk->r", residuals.values, residuals.share, residuals.values)
    left = np.maximum(residuals.counts - used / len(residuals.counts), 1.0)
    return np.asarray(np.sqrt(squares / left))


def _rows(run: Measured, values: Array) -> Rows:
    matched = run.matched
    kept = (filtered(run.counts_after_transient, matched) > MOVING).astype(np.float64)
    found = np.stack([filtered(row, matched) for row in values])
    mask = kept.T.reshape(found.shape[:2] + (1,) * (found.ndim - 2))
    share = np.full(len(kept), 1.0 / matched.inflation)
    return Rows(found * mask, kept.sum(axis=0) / matched.inflation, share)
