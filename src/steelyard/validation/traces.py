"""Filtered efforts along a run, for people to look at, with the bands that go with them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.measurement.chunks import apply
from steelyard.measurement.run import Block
from steelyard.regression.gather import Mask
from steelyard.validation.bands import Bands

MOST_DRAWN = 100_000
"""Samples of a run that its traces keep at most."""

Signal = NDArray[np.float64 | np.bool_]
Signals = tuple[Any, ...]
"""Several of them, equally long."""


@dataclass(frozen=True, eq=False)
class Traces:
    """Filtered effort along a run, in its logged unit: `t` is `(N,)`, the others `(N, n)`.

    Of a run longer than `MOST_DRAWN` samples, evenly spaced ones.

    Attributes:
        t: Time [s].
        measured: As logged.
        predicted: By the model.
        moving: Whether each joint moves.
        model_std: Standard deviation of the prediction, by what is open of the parameters; `None`
            without bands.
        speed: Size of each joint's velocity [rad/s; m/s]; `None` without bands.
        sigma: Standard deviation of a measurement around the model, shape `(n,)`; NaN of a joint
            that had no samples to be fitted to.
        band: Half-width of the band that holds 95 % of new measurements; NaN of a joint whose
            `sigma` is: it has no band.
    """

    t: Array
    measured: Array
    predicted: Array
    moving: Mask
    model_std: Array | None = None
    speed: Array | None = None
    sigma: Array | None = None
    band: Array | None = None

    @property
    def coverage(self) -> Array | None:
        """Share of the measurements in the band per joint, shape `(n,)`; NaN without a band."""
        if self.band is None:
            return None
        inside = np.abs(self.measured - self.predicted) <= self.band
        known = np.isfinite(self.band).all(axis=0)
        return np.where(known, inside.mean(axis=0), np.nan)


class Sure:
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
        for part in apply(bands.std_behind(cutoff, rate), columns()):
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
    """Traces from time, where joints move, measured and predicted efforts, and `Sure`.

    Args:
        thinned: What was kept of these five.
        sigma: See `Traces`; `None` without bands.
    """
    t, moving, measured, predicted, known = thinned.joined()
    std, speed, band = (None, None, None) if sigma is None else (x.T for x in known)
    seen = moving.T.astype(bool)
    return Traces(t, measured.T, predicted.T, seen, std, speed, sigma, band)
