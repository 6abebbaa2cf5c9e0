r"""Smoothing splines: the smoothest curve near the samples, and its derivatives.

The natural cubic smoothing spline minimises
$\sum_k (y_k - f(t_k))^2 + \lambda \int \ddot f^2\,\mathrm{d}t$. Its second derivatives $\gamma$ at
the samples solve $(R + \lambda Q^T Q)\,\gamma = Q^T y$, five bands wide, and
$f = y - \lambda Q \gamma$ [Reinsch1967]. Seen from the middle of a long log with even steps it is
the zero-phase low-pass $1 / (1 + (\omega / \omega_c)^4)$ with $\omega_c^4 = 1 / (\lambda T)$ and
step $T$. Generalised cross-validation chooses $\lambda$ [Craven1978].
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.runs.smoothing.kalman_smoother import likelihood_stretches
from steelyard.runs.smoothing.method_and_butterworth import Designed, derived_jointly

LEAST_SPLINE_SAMPLES = 6  # least number of samples
CORNERS = (-3.5, 0.4)
"""Decades of the corner $\\omega_c$ per sample among which cross-validation chooses."""
CORNER_GRID = 14  # corners that are tried before the best is refined


@dataclass(frozen=True, eq=False)
class Spline:
    """A natural cubic spline at its knots: value and two derivatives, `(N,)`; bent at no end."""

    value: Array
    rate: Array
    acceleration: Array


def smoothing_spline(t: Array, values: Array, weight: float | None = None) -> Spline:
    r"""The smoothing spline of one channel `(N,)`, whose steps of time may differ.

    Its weight $\lambda$ [s³] is by default that of generalised cross-validation.
    """
    step = np.diff(t)
    if len(t) < LEAST_SPLINE_SAMPLES or not (step > 0.0).all():
        raise LogError(
            f"{len(t)} samples, or a time that does not increase, cannot be fitted by a spline",
            where="smoothing spline",
            fix=f"give {LEAST_SPLINE_SAMPLES} samples or more, in order of time",
        )
    unit = float(np.median(step))
    step = step / unit
    chosen = cross_validated(step, values) if weight is None else weight / unit**3
    curvature, change = _solved(step, values, chosen)
    value = values - change
    bent = np.concatenate(([0.0], curvature, [0.0]))
    secant = np.diff(value) / step
    rate = np.empty(len(t))
    rate[:-1] = secant - step * (2.0 * bent[:-1] + bent[1:]) / 6.0
    rate[-1] = secant[-1] + step[-1] * (bent[-2] + 2.0 * bent[-1]) / 6.0
    return Spline(value, rate / unit, bent / unit**2)


def cross_validated(step: Array, values: Array) -> float:
    r"""The $\lambda$ with the least mean square of errors of prediction left out one by one.

    That is $\overline{(y - f)^2} / (1 - \operatorname{tr} A / N)^2$ with the smoother $f = A y$,
    whose eigenvalues are $1 / (1 + \lambda (\pi (k - 3/2) / N)^4)$, two of them 1, for even steps
    of about 1.
    """
    from scipy.optimize import minimize_scalar

    parts = likelihood_stretches(len(values))

    def loss(decade: float) -> float:
        weight = 10.0 ** (-4.0 * decade)
        squares = count = trace = 0.0
        for p in parts:
            y, h = values[p], step[p.start : p.stop - 1]
            change = _solved(h, y, weight)[1]
            waves = np.pi * (np.arange(3, len(y) + 1) - 1.5) / (len(y) * h.mean())
            squares, count = squares + float(change @ change), count + len(y)
            trace += 2.0 + float(np.sum(1.0 / (1.0 + weight * waves**4)))
        return float(np.log(max(squares, 1e-300)) - 2.0 * np.log(1.0 - trace / count))

    grid = np.linspace(*CORNERS, CORNER_GRID)
    best = int(np.argmin([loss(decade) for decade in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, CORNER_GRID - 1)]
    found = minimize_scalar(loss, bounds=around, method="bounded", options={"xatol": 2e-3})
    return float(10.0 ** (-4.0 * found.x))


def _solved(step: Array, values: Array, weight: float) -> tuple[Array, Array]:
    """Second derivatives inside, `(N - 2,)`, and what smoothing takes from the values, `(N,)`."""
    from scipy.linalg import solveh_banded

    before, after = 1.0 / step[:-1], 1.0 / step[1:]
    middle = -before - after
    bands = np.zeros((3, len(middle)))
    bands[2] = (step[:-1] + step[1:]) / 3.0 + weight * (before**2 + middle**2 + after**2)
    bands[1, 1:] = step[1:-1] / 6.0
    bands[1, 1:] += weight * (middle[:-1] * before[1:] + after[:-1] * middle[1:])
    bands[0, 2:] = weight * after[:-2] * before[2:]
    bent = solveh_banded(bands, np.diff(np.diff(values) / step), check_finite=False)
    change = np.zeros(len(values))
    change[:-2] += before * bent
    change[1:-1] += middle * bent
    change[2:] += after * bent
    return bent, weight * change


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
            t = np.arange(x.shape[1]) / rate
            found = [smoothing_spline(t, channel, weight) for channel in x]
            each = [(s.value, s.rate, s.acceleration) for s in found]
            return np.ascontiguousarray(np.array(each).transpose(1, 0, 2))

        return derived_jointly(states)
