r"""Smoothing splines; the methods `fir`, `moving_average` and `savitzky_golay`.

The natural cubic smoothing spline minimises
$\sum_k (y_k - f(t_k))^2 + \lambda \int \ddot f^2\,\mathrm{d}t$. Its second derivatives $\gamma$ at
the samples solve $(R + \lambda Q^T Q)\,\gamma = Q^T y$, five bands wide, and
$f = y - \lambda Q \gamma$ [Reinsch1967]. Seen from the middle of a long log with even steps it is
the zero-phase low-pass $1 / (1 + (\omega / \omega_c)^4)$ with $\omega_c^4 = 1 / (\lambda T)$ and
step $T$. Generalised cross-validation chooses $\lambda$ [Craven1978].

$\dot q_k = (q_{k+1} - q_{k-1}) / (2 \Delta t)$, likewise for $\ddot q_k$ (p1, eq 10), which a
moving average then smooths; positions and velocities stay as they are. At the ends of a series the
average is taken over as many samples as there are on both sides, as MATLAB's `smooth` does it.

Fitting a polynomial of degree $d$ to the $2m + 1$ samples around each sample is a convolution, and
so are its derivatives in the middle [Savitzky1964].
"""

from dataclasses import dataclass
from functools import cache
from math import ceil
from typing import ClassVar, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, ModelError
from steelyard.runs.smoothing.kalman_smoother import least_on_grid, likelihood_stretches
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Bank,
    Designed,
    check_passes,
    convolved,
    derived_jointly,
    differentiating,
    kaiser_lowpass,
    repeated_smoother,
)

LEAST_SPLINE_SAMPLES = 6  # least number of samples
CORNERS = (-3.5, 0.4)
"""Decades of the corner $\\omega_c$ per sample among which cross-validation chooses."""
CORNER_GRID = 14  # corners that are tried before the best is refined


def smoothing_spline(values: Array, rate: float, weight: float | None = None) -> Array:
    r"""The smoothing spline of one channel `(N,)` and two derivatives, `(3, N)`; bent at no end.

    The samples are at a rate [Hz]. The weight $\lambda$ [s³] is by default that of
    generalised cross-validation.
    """
    if len(values) < LEAST_SPLINE_SAMPLES:
        raise LogError(
            f"{len(values)} samples cannot be fitted by a spline",
            where="smoothing spline",
            fix=f"give {LEAST_SPLINE_SAMPLES} samples or more",
        )
    chosen = cross_validated(values) if weight is None else weight * rate**3
    curvature, change = _solved(values, chosen)
    value = values - change
    bent = np.pad(curvature, 1)
    secant, slope = np.diff(value), np.empty(len(values))
    slope[:-1] = secant - (2.0 * bent[:-1] + bent[1:]) / 6.0
    slope[-1] = secant[-1] + (bent[-2] + 2.0 * bent[-1]) / 6.0
    return np.stack((value, slope * rate, bent * rate**2))


def cross_validated(values: Array) -> float:
    r"""The $\lambda$ with the least mean square of errors of prediction left out one by one.

    That is $\overline{(y - f)^2} / (1 - \operatorname{tr} A / N)^2$ with the smoother $f = A y$,
    whose eigenvalues are $1 / (1 + \lambda (\pi (k - 3/2) / N)^4)$, two of them 1, for steps of 1.
    """
    parts = likelihood_stretches(len(values))

    def loss(decade: float) -> float:
        weight = 10.0 ** (-4.0 * decade)
        squares = count = trace = 0.0
        for y in (values[p] for p in parts):
            change = _solved(y, weight)[1]
            waves = np.pi * (np.arange(3, len(y) + 1) - 1.5) / len(y)
            squares, count = squares + float(change @ change), count + len(y)
            trace += 2.0 + float(np.sum(1.0 / (1.0 + weight * waves**4)))
        return float(np.log(max(squares, 1e-300)) - 2.0 * np.log(1.0 - trace / count))

    best = least_on_grid(loss, np.linspace(*CORNERS, CORNER_GRID), 2e-3)
    return float(10.0 ** (-4.0 * best))


def _solved(values: Array, weight: float) -> tuple[Array, Array]:
    """Second derivatives inside, `(N - 2,)`, and what smoothing takes from the values, `(N,)`."""
    from scipy.linalg import solveh_banded

    inside = np.ones(len(values) - 2)
    bands = np.outer([weight, 1.0 / 6.0 - 4.0 * weight, 2.0 / 3.0 + 6.0 * weight], inside)
    bent = solveh_banded(bands, np.diff(values, n=2), check_finite=False)
    return bent, weight * np.diff(np.pad(bent, 2), n=2)


@dataclass(frozen=True)
class SmoothingSpline:
    """Motion by smoothing splines: of positions, and of logged velocities if there are any."""

    name: ClassVar[str] = "spline"
    # whether the smoothness is found by cross-`"validation"`, joint by joint, or is that of the
    # motion's `"cutoff"`
    choose: Literal["validation", "cutoff"] = "validation"

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The spline for a cut-off [Hz] and a rate [Hz]."""
        weight = rate / (2.0 * np.pi * cutoff) ** 4 if self.choose == "cutoff" else None

        def states(x: Array, order: int) -> Array:
            return np.stack([smoothing_spline(channel, rate, weight) for channel in x], axis=1)

        return derived_jointly(states)


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
            return np.where(omega < np.pi * (1.0 - 1e-12), gain, 0.0) ** self.passes

        halo = RINGING_TIME * middle * self.passes
        return differentiating(Bank.derivatives(response, halo, rate, 2).taps)

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
                fix=f"choose a lower cut-off, or a transition below {rate / cutoff - 2:.2g}",
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
            wrong = "has no middle" if self.span % 2 == 0 else "is not valid"
            raise ModelError(
                f"a moving average over {self.span} samples {wrong}",
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
        rows = taps(self.window_for(cutoff, rate), self.degree, rate)
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
                fix="choose a higher cut-off, or a lower rate",
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
    fit = np.linalg.pinv(np.polynomial.legendre.legvander(at, degree))
    rows = []
    for times in range(3):
        derived = np.polynomial.legendre.legder(np.eye(degree + 1), times)
        rows.append(np.polynomial.legendre.legval(0.0, derived) @ fit * (rate / half) ** times)
    return np.array(rows)[:, ::-1]
