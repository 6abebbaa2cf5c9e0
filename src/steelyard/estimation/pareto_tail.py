"""The tail of a distribution: a generalised Pareto law whose shape and scale are uncertain."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.arrays import Array

SHAPE = (0.1, 0.2)
"""Mean and standard deviation of the tail's shape before the data."""

_SHAPES = np.linspace(-0.5, 0.9, 36)[:, None] + 1e-9
"""Shapes of Pareto laws that are compared."""

LOG_PRIOR = -0.5 * np.square((_SHAPES[:, 0] - SHAPE[0]) / SHAPE[1])
"""Logarithm of what is known of the shape before the data."""


@dataclass(frozen=True, eq=False)
class Tail:
    """Maxima above a base: a generalised Pareto law whose shape and scale are uncertain.

    Attributes:
        base: [Nm; N].
        excesses: What the maxima exceed it by, positive, shape `(k,)` [Nm; N].
    """

    base: float
    excesses: Array

    @cached_property
    def _scales(self) -> Array:
        return np.asarray(np.mean(self.excesses) * np.geomspace(0.1, 10.0, 60)[None])

    @cached_property
    def _log_likelihood(self) -> Array:
        """Of shapes and scales."""
        inside = 1.0 + _SHAPES[..., None] * self.excesses / self._scales[..., None]
        logs = np.log(np.maximum(inside, 1e-300)).sum(axis=-1)
        found = -len(self.excesses) * np.log(self._scales) - (1.0 / _SHAPES + 1.0) * logs
        return np.where((inside > 0.0).all(axis=-1), found, -np.inf)

    @cached_property
    def log_shape(self) -> Array:
        """Logarithm of the likelihood of every shape, over all scales."""
        highest = self._log_likelihood.max()
        return np.asarray(np.log(np.exp(self._log_likelihood - highest).sum(axis=1) + 1e-300))

    def size(self, probability: float, log_shape: Array) -> float:
        """The size that a maximum above the base exceeds with a probability.

        Args:
            probability: Wanted; the base is returned from 1 on.
            log_shape: Logarithm of what is known otherwise of every shape.
        """
        if probability >= 1.0:
            return self.base
        logs = self._log_likelihood + log_shape[:, None]
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()

        def exceeded(excess: float) -> float:
            inside = np.maximum(1.0 + _SHAPES * excess / self._scales, 1e-300)
            return float(np.sum(weights * np.exp(-np.log(inside) / _SHAPES)))

        low, high = 0.0, float(self.excesses.max())
        while exceeded(high) > probability:
            low, high = high, 2.0 * high
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if exceeded(middle) > probability else (low, middle)
        return self.base + high
