"""Symmetric convolution filters, defined by their frequency response and applied by FFT."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen

Response = Callable[[Array], Array]
"""Angular frequency per sample, in [0, pi], to the complex response of a filter."""


@dataclass(frozen=True, eq=False)
class Bank:
    """Several convolutions of the same channels at once; an operation with a halo.

    Attributes:
        taps: One row per filter, shape `(k, 2 halo + 1)`; the middle tap is the sample itself.
    """

    taps: Array

    def __init__(self, responses: list[Response], halo: int) -> None:
        omega = np.linspace(0.0, np.pi, fast_length(4 * halo + 2) // 2 + 1)
        rows = [np.fft.irfft(response(omega)) for response in responses]
        middle = np.roll(np.array(rows), halo, axis=-1)[:, : 2 * halo + 1]
        object.__setattr__(self, "taps", frozen(middle))

    @classmethod
    def of(cls, taps: Array) -> "Bank":
        """The filters with these taps, shape `(k, 2 halo + 1)`."""
        bank = object.__new__(cls)
        object.__setattr__(bank, "taps", frozen(taps))
        return bank

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return int(self.taps.shape[1] // 2)

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)` to results `(k, C, N)`."""
        width = extended.shape[-1]
        length = fast_length(width)
        spectrum = np.fft.rfft(extended, length)
        filters = np.fft.rfft(self.taps, length)
        results = np.empty((len(self.taps), *extended.shape[:-1], width - 2 * self.halo))
        for result, response in zip(results, filters, strict=True):
            full = np.fft.irfft(spectrum * response, length)
            result[...] = full[..., 2 * self.halo : width]
        return results


@dataclass(frozen=True, eq=False)
class Single:
    """One convolution of channels; an operation with a halo.

    Attributes:
        bank: A bank of one filter.
    """

    bank: Bank

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return self.bank.halo

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)` to channels `(C, N)`."""
        result: Array = self.bank(extended)[0]
        return result


def fast_length(least: int) -> int:
    """The smallest even number from `least` on without prime factors above 5."""
    best = 1 << max(1, (least - 1).bit_length())
    five = 1
    while five < best:
        three = five
        while three < best:
            twos = max(1, (-(-least // three) - 1).bit_length())
            best = min(best, three << twos)
            three *= 3
        five *= 5
    return best
