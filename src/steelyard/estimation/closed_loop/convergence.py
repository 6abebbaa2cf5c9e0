"""What estimators that simulate have in common: when they are done, and what they return."""

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.closed_loop.experiment import Experiment
from steelyard.estimation.closed_loop.filtered_regressor import Rows
from steelyard.estimation.estimate import Estimate
from steelyard.parameters import Parameters

QUIET = 0.03
"""Change of the values over their standard deviations, root mean square, that is none."""

EXACT = 1e-7
"""Change of the torque, over the torque, that is none."""


def floored(sigma: Array, torque: Rows) -> Array:
    """Standard deviations that exact data do not make zero, shape `(n,)`."""
    size = np.sqrt(np.mean(np.square(torque.values), axis=1))
    return np.maximum(sigma, 1e-10 * max(float(size.max()), 1e-300))


def converged(change: Array, matrix: Array, torque: Rows, sigma: Array) -> bool:
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
