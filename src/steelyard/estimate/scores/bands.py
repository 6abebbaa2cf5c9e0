r"""95 % bands of predicted efforts, and filtered efforts along a run with their bands.

The low-passed prediction of row $j$ is $\bar y_j^T \hat\phi$ with the row's regressor entries
behind the same filter, $\bar y_j$: its variance is $\bar y_j^T C \bar y_j$. Entries as they are
have the noise of accelerations and the jumps of friction where a joint turns round, which the
filter takes out of the prediction.

The predicted effort of row $j$ is $y_j^T \hat\phi$ with the row's regressor entries $y_j$, behind
the score's low-pass as the effort is; what is left open of the parameters makes its standard
deviation $\sqrt{y_j^T C y_j}$: the band of the model. A new measurement scatters around that by its
residual too: $\sqrt{y_j^T C y_j + s_j^2}$.

The residuals behind an estimate have gone through the parallel filter, scores go through another
low-pass. White residuals have variances in the ratio of the filters' noise bandwidths, which $s_j$
follows where a score looks at more; where it looks at less, it is not credited with that, for what
a model lacks is slow.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.effort_uncertainty import Calibration, covariance_root
from steelyard.estimate.estimate import Z95
from steelyard.estimate.identified import IdentifiedModel
from steelyard.estimate.information.gather import Mask
from steelyard.estimate.information.regressor import Layout, Regressor, base_regressor
from steelyard.runs.run import Block
from steelyard.runs.smoothing.filters import apply, low_pass
from steelyard.runs.smoothing.filters import noise_bandwidth as low_pass_bandwidth

TAIL = 1e-6  # what is left of the low-pass's impulse response where it is cut off here


@dataclass(frozen=True, eq=False)
class ModelStd:
    """Outputs of a regressor to standard deviations; an operation with a halo."""

    layout: Layout
    factor: Array  # `F`, with `F @ F.T` the covariance of the columns, shape `(p, k)`
    taps: Array  # the low-pass, an odd number of taps
    step: int  # samples from one that is computed to the next; between them it is interpolated

    @classmethod
    def behind(cls, cutoff: float, rate: float, layout: Layout, factor: Array) -> "ModelStd":
        """Behind the zero-phase low-pass of scores [Hz], four samples per period of the cut-off."""
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


@dataclass(frozen=True, eq=False)
class Bands:
    """What bands are made from.

    Attributes:
        sigma: Standard deviation of the residuals per row behind the score's low-pass, in the unit
            of the joint's effort, shape `(n,)`; NaN of a joint without samples.
    """

    regressor: Regressor
    factor: Array  # `F`, with `F @ F.T` the covariance of the base parameters, shape `(p, k)`
    sigma: Array
    calibration: Calibration | None = None  # those of noise alone if `None`

    @classmethod
    def of(cls, identified: IdentifiedModel) -> "Bands":
        """The bands of an identified model, for scores with its own cut-off."""
        cutoffs = identified.cutoffs
        return cls(
            base_regressor(identified.model),
            frozen(covariance_root(identified.base_covariance)),
            frozen(identified.residual_std(low_pass_bandwidth(cutoffs.score))),
            identified.calibration,
        )

    def half_width(self, block: Block, model_std: Array) -> Array:
        """Half-width of the band that holds 95 % of new measurements, in the effort's unit.

        Shape `(n, B)`; NaN of a joint whose `sigma` is. A calibration below 1.96 says that
        residuals are smaller than their standard deviation; it does not make parameters surer,
        whose errors show in motions unlike those left out.
        """
        noise = np.broadcast_to(self.sigma[:, None], model_std.shape)
        if self.calibration is None:
            return np.asarray(Z95 * np.hypot(model_std, noise))
        n = len(self.sigma)
        factor = self.calibration.factor(block.dq[:n], block.moving[:n])
        return np.asarray(np.hypot(np.maximum(factor, Z95) * model_std, factor * noise))

    def columns(self, block: Block) -> Array:
        """The regressor's outputs, which `ModelStd` takes, shape `(C, B)`."""
        channels = np.empty((0, len(block.t))) if block.channels is None else block.channels
        inputs = (block.q, block.dq, block.ddq, channels, np.zeros_like(block.q))
        return self.regressor.code([np.ascontiguousarray(x) for x in inputs])


MOST_DRAWN = 100_000  # samples of a run that its traces keep at most

Signal = NDArray[np.float64 | np.bool_]
Signals = tuple[Any, ...]  # several of them, equally long


@dataclass(frozen=True, eq=False)
class Traces:
    """Filtered effort along a run, in its logged unit: `t` is `(N,)`, the others `(N, n)`.

    Of a run longer than `MOST_DRAWN` samples, evenly spaced ones.

    Attributes:
        band: Half-width of the band that holds 95 % of new measurements; NaN of a joint whose
            `sigma` is: it has no band.
    """

    t: Array
    measured: Array
    predicted: Array
    moving: Mask
    model_std: Array | None = None  # of the prediction, by what is open of the parameters
    speed: Array | None = None  # size of each joint's velocity [rad/s; m/s]; `None` without bands
    sigma: Array | None = None  # of a measurement around the model, `(n,)`; NaN without samples
    band: Array | None = None

    @property
    def coverage(self) -> Array | None:
        """Share of the measurements in the band per joint, shape `(n,)`; NaN without a band."""
        if self.band is None:
            return None
        inside = np.abs(self.measured - self.predicted) <= self.band
        known = np.isfinite(self.band).all(axis=0)
        return np.where(known, inside.mean(axis=0), np.nan)


class BandChannels:
    """What goes with the samples of a segment: deviation of the prediction, speed, half-width."""

    def __init__(
        self, blocks: Iterable[Block], bands: Bands, gains: Array, cutoff: float, rate: float
    ) -> None:
        self._parts = self._known(blocks, bands, np.abs(gains)[:, None], cutoff, rate)
        self._kept = np.empty((3, len(gains), 0))

    @staticmethod
    def _known(
        blocks: Iterable[Block], bands: Bands, gains: Array, cutoff: float, rate: float
    ) -> Iterator[Array]:
        """Shapes `(3, n, any)`, in the logged units."""
        waiting: list[Block] = []

        def columns() -> Iterator[Array]:
            for block in blocks:
                waiting.append(block)
                yield bands.columns(block)

        n = len(gains)
        left = np.empty((n, 0))
        std_of = ModelStd.behind(cutoff, rate, bands.regressor.layout, bands.factor)
        for part in apply(std_of, columns()):
            left = np.concatenate((left, part), axis=1)
            while waiting and len(waiting[0].t) <= left.shape[1]:
                block = waiting.pop(0)
                std, left = left[:, : len(block.t)], left[:, len(block.t) :]
                half = bands.half_width(block, std)
                yield np.stack([std / gains, np.abs(block.dq[:n]), half / gains])

    def next(self, count: int) -> Array:
        """Of the next `count` samples, shape `(3, n, count)`."""
        while self._kept.shape[-1] < count:
            self._kept = np.concatenate((self._kept, next(self._parts)), axis=-1)
        known, self._kept = self._kept[..., :count], self._kept[..., count:]
        return known


class Thinned:
    """Signals of a run of any length: every sample of a short one, every 2nd, 4th, ... of others.

    Args:
        most: Samples that are kept at most.
    """

    def __init__(self, most: int) -> None:
        self._parts: list[Signals] = []
        self._most, self._step, self._seen = most, 1, 0

    def add(self, *signals: Signal) -> None:
        """Take in the next samples, along the last axis; kept are the multiples of the step."""
        at = slice(-self._seen % self._step, None, self._step)
        self._seen += signals[0].shape[-1]
        self._parts.append(tuple(x[..., at].copy() for x in signals))
        while self._seen > self._step * self._most:
            self._parts = [tuple(x[..., ::2].copy() for x in self.joined())]
            self._step *= 2

    def joined(self) -> Signals:
        """What was kept of each signal."""
        return tuple(np.concatenate(parts, axis=-1) for parts in zip(*self._parts, strict=True))


def traces_of(thinned: Thinned, sigma: Array | None) -> Traces:
    """Traces from time, where joints move, measured and predicted efforts, and `BandChannels`."""
    t, moving, measured, predicted, known = thinned.joined()
    std, speed, band = (None, None, None) if sigma is None else (x.T for x in known)
    seen = moving.T.astype(bool)
    return Traces(t, measured.T, predicted.T, seen, std, speed, sigma, band)
