r"""The method `moving_average`: central differences, smoothed by means of neighbours.

$\dot q_k = (q_{k+1} - q_{k-1}) / (2 \Delta t)$, likewise for $\ddot q_k$ (p1, eq 10), which a
moving average then smooths; positions and velocities stay as they are. At the ends of a series the
average is taken over as many samples as there are on both sides, as MATLAB's `smooth` does it.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.measurement.convolve import Bank, Single
from steelyard.measurement.methods.passes import check_passes, repeated_smoother

LONGEST_SPAN = 20_001
"""Samples."""


@dataclass(frozen=True)
class MovingAverage:
    """Central differences, and the mean over some samples of accelerations, or of efforts.

    Attributes:
        span: Number of samples, odd.
        passes: How often the mean is taken, of means from the second pass on.
    """

    name: ClassVar[str] = "moving_average"
    span: int = 5
    passes: int = 1

    def __post_init__(self) -> None:
        check_passes(self.passes, self.name)
        if self.span % 2 == 0 or not 1 <= self.span <= LONGEST_SPAN:
            raise ModelError(
                f"a moving average over {self.span} samples has no middle"
                if self.span % 2 == 0
                else f"a moving average over {self.span} samples is not valid",
                where="moving_average",
                fix=f"choose an odd number from 1 to {LONGEST_SPAN}",
            )

    def designed(self, cutoff: float, rate: float) -> "CentralDifferences":
        """The differences at a rate [Hz]; the cut-off says nothing here."""
        return CentralDifferences(self.span, rate, self.passes)

    def smooth(self, cutoff: float, rate: float) -> Single:
        """The average alone, for efforts."""
        return repeated_smoother(Bank.of(np.full((1, self.span), 1.0 / self.span)), self.passes)


class CentralDifferences:
    """Positions as they are, velocities and accelerations by central differences.

    Args:
        span: Samples over which accelerations are averaged.
        rate: [Hz].
        passes: How often they are averaged.
    """

    def __init__(self, span: int, rate: float, passes: int = 1) -> None:
        self._span, self._passes, self._rate = span, passes, rate
        self.halo = 2 + passes * (span // 2)

    def __call__(self, q: Array, dq: Array | None) -> Array:
        """Positions, and velocities if logged, to motion; see `Designed`."""
        velocity = _difference(q, self._rate) if dq is None else dq[:, 1:-1]
        acceleration = _difference(velocity, self._rate)
        for _ in range(self._passes):
            acceleration = _mean(acceleration, self._span)
        middle = velocity[:, self.halo - 1 : velocity.shape[1] - self.halo + 1]
        return np.stack((q[:, self.halo : q.shape[1] - self.halo], middle, acceleration))


def central_differences(values: Array, rate: float) -> Array:
    """Derivative of uniform samples by central differences (p1, eq 10), shape `(N - 2, C)`.

    Args:
        values: Shape `(N, C)`; the first and the last have no derivative.
        rate: [Hz].
    """
    return _difference(values.T, rate).T


def moving_average(values: Array, span: int) -> Array:
    """The mean over `span` samples around each, over fewer at the ends: MATLAB's `smooth`.

    Args:
        values: Shape `(N,)` or `(N, C)`.
        span: Number of samples; an even one counts as one less.
    """
    half = min((span - 1) // 2, (len(values) - 1) // 2)
    sums = np.concatenate((np.zeros_like(values[:1]), np.cumsum(values, axis=0)))
    at = np.arange(len(values))
    reach = np.minimum(half, np.minimum(at, len(values) - 1 - at))
    counts = (2 * reach + 1).reshape(-1, *([1] * (values.ndim - 1)))
    mean: Array = (sums[at + reach + 1] - sums[at - reach]) / counts
    return mean


def _difference(x: Array, rate: float) -> Array:
    slope: Array = (x[:, 2:] - x[:, :-2]) * (0.5 * rate)
    return slope


def _mean(x: Array, span: int) -> Array:
    windows = np.lib.stride_tricks.sliding_window_view(x, span, axis=1)
    mean: Array = windows.mean(axis=2)
    return mean
