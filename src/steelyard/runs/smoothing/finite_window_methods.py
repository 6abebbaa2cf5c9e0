r"""The methods with finite windows: `fir`, `moving_average` and `savitzky_golay`.

$\dot q_k = (q_{k+1} - q_{k-1}) / (2 \Delta t)$, likewise for $\ddot q_k$ (p1, eq 10), which a
moving average then smooths; positions and velocities stay as they are. At the ends of a series the
average is taken over as many samples as there are on both sides, as MATLAB's `smooth` does it.

Fitting a polynomial of degree $d$ to the $2m + 1$ samples around each sample is a convolution, and
so are its derivatives in the middle [Savitzky1964].
"""

from dataclasses import dataclass
from functools import cache
from math import ceil
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, ModelError
from steelyard.runs.smoothing.method_and_butterworth import Designed, differentiating
from steelyard.runs.smoothing.zero_phase_filters import (
    Bank,
    check_passes,
    convolved,
    kaiser_lowpass,
    repeated_response,
    repeated_smoother,
)

RINGING_TIME = 2
"""Halo over that of the filter itself: its derivatives ring on at the level of its suppression."""
SUPPRESSIONS = 20.0, 120.0  # least and most suppression that can be requested [dB]


@dataclass(frozen=True)
class FIR:
    """Zero-phase FIR low-pass of positions, and of logged velocities [Kaiser1974]."""

    name: ClassVar[str] = "fir"
    suppression: float = 80.0  # how far down the filter is behind its transition [dB]
    # width of the transition from passing to stopping, around the cut-off at which half of an
    # amplitude passes, over the cut-off
    transition: float = 1.0
    passes: int = 1  # how often the filter is applied

    def __post_init__(self) -> None:
        check_passes(self.passes, self.name)
        low, high = SUPPRESSIONS
        if not low <= self.suppression <= high:
            raise ModelError(
                f"a suppression of {self.suppression:g} dB is not available",
                where="fir",
                fix=f"choose {low:g} to {high:g} dB",
            )
        if not 0.0 < self.transition <= 2.0:
            raise ModelError(
                f"a transition of {self.transition:g} times the cut-off is not valid",
                where="fir",
                fix="choose a number above 0 and up to 2",
            )

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The filter and its derivatives for a cut-off [Hz] and a rate [Hz]."""
        from scipy.signal import freqz

        taps = self.taps(cutoff, rate)
        middle = len(taps) // 2

        def response(omega: Array) -> Array:
            gain: Array = (freqz(taps, worN=omega)[1] * np.exp(1j * omega * middle)).real
            return np.where(omega < np.pi * (1.0 - 1e-12), gain, 0.0)

        every = repeated_response(response, self.passes)
        halo = RINGING_TIME * middle * self.passes
        return differentiating(Bank.derivatives(every, halo, rate, 2).taps)

    def smooth(self, cutoff: float, rate: float) -> Bank:
        """The filter alone, for efforts."""
        return repeated_smoother(self.taps(cutoff, rate), self.passes)

    def taps(self, cutoff: float, rate: float) -> Array:
        """The filter's coefficients, odd in number, their sum 1."""
        width = self.transition * cutoff
        if cutoff + 0.5 * width >= 0.5 * rate:
            raise LogError(
                f"an FIR low-pass of {cutoff:g} Hz that stops at {cutoff + 0.5 * width:g} Hz does "
                f"not fit samples at {rate:g} Hz",
                where="method 'fir' of [processing]",
                fix=f"choose a lower motion_cutoff, or a transition below {rate / cutoff - 2:.2g}",
            )
        return kaiser_lowpass(self.suppression, 2.0 * width / rate, 2.0 * cutoff / rate)


LONGEST_SPAN = 20_001  # samples


@dataclass(frozen=True)
class MovingAverage:
    """Central differences, and the mean over some samples of accelerations, or of efforts."""

    name: ClassVar[str] = "moving_average"
    span: int = 5  # number of samples, odd
    passes: int = 1  # how often the mean is taken, of means from the second pass on

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

    def designed(self, cutoff: float, rate: float) -> Designed:
        """Positions as they are and central differences (p1, eq 10); the cut-off says nothing."""
        halo = 2 + self.passes * (self.span // 2)

        def motion(q: Array, dq: Array | None) -> Array:
            velocity = _difference(q, rate) if dq is None else dq[:, 1:-1]
            acceleration = _difference(velocity, rate)
            for _ in range(self.passes):
                windows = np.lib.stride_tricks.sliding_window_view(acceleration, self.span, axis=1)
                acceleration = windows.mean(axis=2)
            middle = velocity[:, halo - 1 : velocity.shape[1] - halo + 1]
            return np.stack((q[:, halo : q.shape[1] - halo], middle, acceleration))

        return Designed(motion, halo)

    def smooth(self, cutoff: float, rate: float) -> Bank:
        """The average alone, for efforts."""
        return repeated_smoother(np.full(self.span, 1.0 / self.span), self.passes)


def _difference(x: Array, rate: float) -> Array:
    return np.asarray((x[:, 2:] - x[:, :-2]) * (0.5 * rate))


HIGHEST_DEGREE = 10  # beyond it the fit is as bad as its conditioning
LONGEST_WINDOW = 20_001  # samples


@dataclass(frozen=True)
class SavitzkyGolay:
    """Local polynomials."""

    name: ClassVar[str] = "savitzky_golay"
    window: int | None = None  # number of samples, odd; chosen for the cut-off if not given
    degree: int = 4  # of the polynomial
    passes: int = 1  # how often the samples are smoothed; derivatives are those of the last pass

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

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The filters for a cut-off [Hz], which chooses the window if it is not given."""
        window = self.window_for(cutoff, rate)
        rows = taps(window, self.degree, rate)
        return differentiating(convolved(rows, rows[0], self.passes - 1))

    def smooth(self, cutoff: float, rate: float) -> Bank:
        """The smoothing alone, for efforts."""
        window = self.window_for(cutoff, rate)
        return repeated_smoother(taps(window, self.degree, rate)[0], self.passes)

    def window_for(self, cutoff: float, rate: float) -> int:
        """The window, or the one that passes half of an amplitude at the cut-off."""
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


def taps(window: int, degree: int, rate: float) -> Array:
    """Coefficients of value, first and second derivative in the middle, shape `(3, window)`."""
    half = window // 2
    at = np.arange(-half, half + 1) / half
    basis = np.polynomial.legendre.legvander(at, degree)
    fit = np.linalg.pinv(basis)
    rows = []
    for times in range(3):
        derived = np.polynomial.legendre.legder(np.eye(degree + 1), times)
        row = np.polynomial.legendre.legval(0.0, derived)
        rows.append(row @ fit * (rate / half) ** times)
    return np.array(rows)[:, ::-1]
