"""What a motion shows of each parameter, and how well."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.criteria.criteria import KINDS, worst_value
from steelyard.excitation.objective import Case
from steelyard.excitation.problem import jumping
from steelyard.motion import Trajectory

_CHUNK = 20_000
_ROUNDING = 1e-13
"""Information along an axis, over the largest, that rounding alone may leave."""
_BLIND = 1e-6
"""Share of a parameter, squared, in axes without information from which on it is unknown."""


@dataclass(frozen=True, eq=False)
class PredictedAccuracy:
    """The information of a motion about base parameters.

    Attributes:
        names: Base parameters, `b` of them.
        units: Their units.
        gram: Information with the noise given, shape `(b, b)`.
        criterion_value: The requested criterion.
        raw: Condition number of the regressor, columns as they are.
        normalised: The same with columns of unit norm.
        singular: Singular values of the regressor with columns of unit norm, falling, `(b,)`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    gram: Array
    criterion_value: float
    raw: float
    normalised: float
    singular: Array

    def std(self, prior: Array | None = None) -> Array:
        """Standard deviations to be expected of the parameters, shape `(b,)`.

        Infinite for what neither the motion nor the `prior` information `(b, b)` shows.
        """
        gram = self.gram if prior is None else self.gram + prior
        return deviations(gram)


def deviations(gram: Array) -> Array:
    """Standard deviations from information; infinite for what it does not distinguish."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 0.0))
    result, seen = np.full(len(gram), np.inf), size > 0.0
    if not seen.any():
        return result
    size = size[seen]
    values, axes = np.linalg.eigh(gram[np.ix_(seen, seen)] / size[:, None] / size)
    resolved = values > _ROUNDING * values[-1]
    single = np.sum(axes[:, ~resolved] ** 2, axis=1) < _BLIND
    variance = np.sum(axes[:, resolved] ** 2 / values[resolved], axis=1)
    result[seen] = np.where(single, np.sqrt(variance) / size, np.inf)
    return result


def shown(
    trajectory: Trajectory, cases: Sequence[Case], noise_weights: Array, samples: int
) -> PredictedAccuracy:
    """What a motion shows.

    Args:
        trajectory: The motion.
        cases: What it is judged by.
        noise_weights: Independent samples a second over the variance of the noise, shape `(n,)`.
        samples: Samples over the motion, the end left out.
    """
    sharp = jumping(cases)
    pairs = [(case.criterion, information(case, trajectory, samples)) for case in sharp]
    first = sharp[0]
    even = replace(first, shows=replace(first.shows, weights=np.ones(len(noise_weights))))
    noisy = replace(first, shows=replace(first.shows, weights=noise_weights))
    plain = information(even, trajectory, samples)
    size = np.sqrt(np.maximum(np.diagonal(plain), 1e-300))
    spectrum = np.linalg.eigvalsh(plain / size[:, None] / size)[::-1]
    base = first.shows.base
    return PredictedAccuracy(
        base.base_names,
        base.base_units,
        information(noisy, trajectory, samples),
        worst_value(pairs),
        KINDS["condition"].value(plain),
        KINDS["normalised_condition"].value(plain),
        np.sqrt(np.maximum(spectrum, 0.0)),
    )


def information(case: Case, trajectory: Trajectory, samples: int) -> Array:
    """Information of a motion at even samples, each counting for its time, `(b, b)`."""
    step = trajectory.duration / samples
    total = np.zeros((len(case.shows.base),) * 2)
    for first in range(0, samples, _CHUNK):
        count = np.arange(first, min(first + _CHUNK, samples))
        motion = trajectory.sample(step * count)
        q, dq, ddq = (np.ascontiguousarray(x.T) for x in (motion.q, motion.dq, motion.ddq))
        total += case.shows.at(q, dq, ddq, step=step).gram
    return total
