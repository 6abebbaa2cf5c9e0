r"""The method `savitzky_golay`: a polynomial through every sample's window, and its derivatives.

Fitting a polynomial of degree $d$ to the $2m + 1$ samples around each sample is a convolution, and
so are its derivatives in the middle [Savitzky1964].
"""

from dataclasses import dataclass
from functools import cache
from math import ceil
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError, ModelError
from steelyard.measurement.convolve import Bank, Single
from steelyard.measurement.methods.passes import check_passes, convolved, repeated_smoother

HIGHEST_DEGREE = 10
"""Beyond it the fit is as bad as its conditioning."""
LONGEST_WINDOW = 20_001
"""Samples."""


@dataclass(frozen=True)
class SavitzkyGolay:
    """Local polynomials.

    Attributes:
        window: Number of samples, odd; chosen for the cut-off if not given.
        degree: Of the polynomial.
        passes: How often the samples are smoothed; derivatives are those of the last pass.
    """

    name: ClassVar[str] = "savitzky_golay"
    window: int | None = None
    degree: int = 4
    passes: int = 1

    def __post_init__(self) -> None:
        check_passes(self.passes, self.name)
        if not 2 <= self.degree <= HIGHEST_DEGREE:
            raise ModelError(
                f"a polynomial of degree {self.degree} cannot be used",
                where="savitzky_golay",
                fix=f"choose a degree from 2, which has an acceleration, to {HIGHEST_DEGREE}",
            )
        fits = self.window is None or (
            self.window % 2 == 1 and self.degree < self.window <= LONGEST_WINDOW
        )
        if not fits:
            raise ModelError(
                f"a window of {self.window} samples does not fit a polynomial of degree "
                f"{self.degree}",
                where="savitzky_golay",
                fix=f"choose an odd number above {self.degree} and up to {LONGEST_WINDOW}",
            )

    def designed(self, cutoff: float, rate: float) -> "DesignedSavitzkyGolay":
        """The filters for a cut-off [Hz], which chooses the window if it is not given."""
        window = self.window_for(cutoff, rate)
        rows = taps(window, self.degree, rate)
        return DesignedSavitzkyGolay(convolved(rows, rows[0], self.passes - 1))

    def smooth(self, cutoff: float, rate: float) -> Single:
        """The smoothing alone, for efforts."""
        window = self.window_for(cutoff, rate)
        return repeated_smoother(Bank.of(taps(window, self.degree, rate)[:1]), self.passes)

    def window_for(self, cutoff: float, rate: float) -> int:
        """The window, or the one that passes half of an amplitude at the cut-off.

        Raises:
            LogError: The window would be longer than any.
        """
        if self.window is not None:
            return self.window
        half = _corner(self.degree) * rate / (2.0 * np.pi * cutoff)
        window = 2 * max(ceil(half), self.degree // 2 + 1) + 1
        if window > LONGEST_WINDOW:
            raise LogError(
                f"a cut-off of {cutoff:g} Hz needs windows of {window} samples",
                where="method 'savitzky_golay' of [processing]",
                fix="choose a higher motion_cutoff, or a lower rate",
            )
        return window


@cache
def _corner(degree: int) -> float:
    """Angular frequency times half a window at which half of an amplitude passes."""
    half = 500
    row, at = taps(2 * half + 1, degree, 1.0)[0], np.arange(-half, half + 1)
    omega = np.linspace(0.0, 4.0 * (degree + 1), 4000) / half
    gain = np.cos(np.outer(omega, at)) @ row
    return float(omega[int(np.argmax(gain <= 0.5))] * half)


class DesignedSavitzkyGolay:
    """The three convolutions; logged velocities are smoothed and differentiated once.

    Args:
        rows: Coefficients of value, first and second derivative, shape `(3, odd)`.
    """

    def __init__(self, rows: Array) -> None:
        self._twice, self._once, self._smooth = Bank.of(rows), Bank.of(rows[:2]), Bank.of(rows[:1])
        self.halo = self._twice.halo

    def __call__(self, q: Array, dq: Array | None) -> Array:
        """Positions, and velocities if logged, to motion; see `Designed`."""
        if dq is None:
            return self._twice(q)
        return np.concatenate((self._smooth(q), self._once(dq)))


def taps(window: int, degree: int, rate: float) -> Array:
    """Coefficients of value, first and second derivative in the middle, shape `(3, window)`.

    Args:
        window: Number of samples, odd.
        degree: Of the polynomial, at least 2.
        rate: [Hz].
    """
    half = window // 2
    at = np.arange(-half, half + 1) / half
    basis = np.polynomial.legendre.legvander(at, degree)
    fit = np.linalg.pinv(basis)
    rows = []
    for times in range(3):
        derived = [
            np.polynomial.legendre.legval(
                0.0, np.polynomial.legendre.legder(np.eye(degree + 1)[k], times)
            )
            for k in range(degree + 1)
        ]
        rows.append(np.array(derived) @ fit * (rate / half) ** times)
    return np.array(rows)[:, ::-1]
