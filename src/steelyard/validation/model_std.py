r"""Standard deviation of predicted efforts behind the low-pass that they are compared behind.

The low-passed prediction of row $j$ is $\bar y_j^T \hat\phi$ with the row's regressor entries
behind the same filter, $\bar y_j$: its variance is $\bar y_j^T C \bar y_j$. Entries as they are
have the noise of accelerations and the jumps of friction where a joint turns round, which the
filter takes out of the prediction.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import as_strided

from steelyard.arrays import Array, frozen
from steelyard.measurement.methods.lowpass import low_pass
from steelyard.regression.regressor import Layout

TAIL = 1e-6
"""What is left of the low-pass's impulse response where it is cut off here."""


@dataclass(frozen=True, eq=False)
class ModelStd:
    """Outputs of a regressor to standard deviations; an operation with a halo.

    Attributes:
        layout: What each row sees.
        factor: `F`, with `F @ F.T` the covariance of the columns, shape `(p, k)`.
        taps: The low-pass, an odd number of taps.
        step: Samples from one that is computed to the next; between them it is interpolated.
    """

    layout: Layout
    factor: Array
    taps: Array
    step: int

    @classmethod
    def behind(cls, cutoff: float, rate: float, layout: Layout, factor: Array) -> "ModelStd":
        """Behind the zero-phase low-pass of scores, at four samples per period of the cut-off.

        Args:
            cutoff: [Hz], below half the rate.
            rate: [Hz].
            layout: See the attributes.
            factor: See the attributes.
        """
        taps = low_pass(cutoff, rate, tail=TAIL).taps[0]
        return cls(layout, factor, frozen(taps), max(1, int(rate / (4.0 * cutoff))))

    @property
    def halo(self) -> int:
        """Samples of context on each side: of the filter, and to the next that is computed."""
        return len(self.taps) // 2 + self.step

    def __call__(self, extended: Array) -> Array:
        """Outputs `(C, N + 2 halo)` to standard deviations, shape `(n, N)`."""
        count = extended.shape[-1] - 2 * self.halo
        points = np.arange(-(-count // self.step) + 1) * self.step
        result = np.empty((len(self.layout.rows), count))
        for row, (start, seen) in enumerate(zip(self.layout.starts, self.layout.sees, strict=True)):
            columns = [self._filtered(x, len(points)) for x in extended[start : start + len(seen)]]
            spread = self.factor[list(seen)].T @ np.reshape(columns, (len(seen), len(points)))
            std = np.sqrt(np.sum(np.square(spread), axis=0))
            result[row] = np.interp(np.arange(count), points, std)
        return result

    def _filtered(self, channel: Array, count: int) -> Array:
        """Every `step`-th sample behind the filter, as products of matrices, shape `(count,)`."""
        pieces = -(-len(self.taps) // self.step)
        taps = np.zeros(pieces * self.step)
        taps[: len(self.taps)] = self.taps
        signal = np.zeros((count + pieces - 1) * self.step)
        known = channel[self.step :][: len(signal)]
        signal[: len(known)] = known
        products = signal.reshape(-1, self.step) @ taps.reshape(pieces, self.step).T
        across, along = products.strides
        diagonals = as_strided(products, (count, pieces), (across, across + along))
        return np.asarray(diagonals.sum(axis=1))
