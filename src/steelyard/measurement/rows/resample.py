"""From rows at uneven times to a uniform clock, by parts, within the clock's band.

Channels that were logged late are read later in the log: what was logged at `t + lag` belongs to
time `t`. A clock slower than the log's gets no more than it can carry: rows are first brought to a
multiple of its rate that is not below theirs, then low-passed, then thinned out.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from steelyard.arrays import Array
from steelyard.measurement.chunks import apply
from steelyard.measurement.convolve import Bank
from steelyard.measurement.methods.kaiser import kaiser_lowpass
from steelyard.measurement.rows.interpolation import CUBIC, Interpolation

SUPPRESSION = 80.0
"""How far a low-pass before thinning out is down from half the clock's rate on [dB]."""
PASSED = 0.4
"""Highest frequency that passes it, per rate of the clock."""


@dataclass(frozen=True)
class Lane:
    """Channels that are read alike.

    Attributes:
        channels: Which ones.
        kind: The interpolation.
        lag: How late they were logged [s].
    """

    channels: slice
    kind: Interpolation
    lag: float = 0.0


EVERY = (Lane(slice(None), CUBIC),)


def sample_count(start: float, stop: float, rate: float) -> int:
    """Samples of the uniform clock from time `start` to time `stop` [s]."""
    return floor((stop - start) * rate + 1e-6) + 1


def uniform(
    rows: Iterable[tuple[Array, Array]], rate: float, lanes: Sequence[Lane] = EVERY
) -> Iterator[Array]:
    """One segment's channels at times `t[0] + k / rate`.

    Beyond the segment's ends, where lags make it end early, its last values stay.

    Args:
        rows: Time, shape `(N,)` [s], increasing, and channels, shape `(N, C)`; any parts.
        rate: [Hz].
        lanes: All channels, in their order.

    Yields:
        Channels, shape `(C, any)`; `sample_count` samples in all.
    """
    lags = [lane.lag for lane in lanes]
    margin = max(lane.kind.margin for lane in lanes)
    t, x = np.zeros(0), np.zeros((0, 0))
    start, done, begun = 0.0, 0, False
    for new_t, new_x in rows:
        if not begun:
            if len(new_t) == 0:
                continue
            start, begun = float(new_t[0]), True
            t, x = new_t, np.ascontiguousarray(new_x.T)
        else:
            t, x = np.concatenate((t, new_t)), np.concatenate((x, new_x.T), axis=1)
        high = len(t) - 1 - margin
        if high < margin + 2:
            continue
        upto = max(done, ceil((float(t[high]) - max(lags) - start) * rate))
        if upto > done:
            yield _at(t, x, start + np.arange(done, upto) / rate, lanes)
            done = upto
        low = int(np.searchsorted(t, start + done / rate + min(lags), side="right")) - 1
        first = max(0, low - margin - 1)
        t, x = t[first:], x[:, first:]
    if len(t):
        upto = sample_count(start, float(t[-1]), rate)
        yield _at(t, x, start + np.arange(done, upto) / rate, lanes)


def _at(t: Array, x: Array, at: Array, lanes: Sequence[Lane]) -> Array:
    values = [lane.kind(t, x[lane.channels], np.clip(at + lane.lag, t[0], t[-1])) for lane in lanes]
    return values[0] if len(values) == 1 else np.concatenate(values)


@dataclass(frozen=True, eq=False)
class Thinning:
    """A low-pass after which every `factor`-th sample says it all; an operation with a halo.

    Attributes:
        factor: Samples before over samples after.
        bank: The low-pass.
        flags: Number of last channels that are flags: of those near a sample the largest stays.
    """

    factor: int
    bank: Bank
    flags: int = 0

    @classmethod
    def design(cls, factor: int, flags: int = 0) -> "Thinning":
        """Kaiser-windowed low-pass for a clock `factor` times slower."""
        middle = 0.5 * (PASSED + 0.5)
        width = 2.0 * (0.5 - PASSED) / factor
        taps = kaiser_lowpass(SUPPRESSION, width, 2.0 * middle / factor)
        return cls(factor, Bank.of(taps[None]), flags)

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return self.bank.halo

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)` to channels `(C, N)`."""
        signals = len(extended) - self.flags
        low: Array = self.bank(extended[:signals])[0]
        if not self.flags:
            return low
        flags = np.abs(extended[signals:])
        near = [
            flags[:, self.halo + shift : extended.shape[1] - self.halo + shift]
            for shift in range(-self.factor, self.factor + 1)
        ]
        return np.concatenate((low, np.max(near, axis=0)))

    def thinned(self, parts: Iterable[Array]) -> Iterator[Array]:
        """Every `factor`-th sample of a segment after the low-pass."""
        at = 0
        for part in apply(self, parts):
            yield part[:, -at % self.factor :: self.factor]
            at += part.shape[1]
