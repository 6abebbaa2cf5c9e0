r"""Kalman filter and smoother with constant acceleration, noise found by maximum likelihood.

The acceleration of a channel wanders: its rate, the jerk, is white noise of intensity $s$ (p5,
eqs 15 and 16; the covariance of a step is that of the integrated jerk, right at any step). The
measurement adds white noise of variance $r$. Seen from the middle of a long log with even steps,
the smoother is the zero-phase low-pass $1 / (1 + (\omega / \omega_c)^6)$ with
$\omega_c^6 = s / (r T)$ and step $T$. The likelihood of the innovations depends on $r$ in closed
form, so only the ratio is searched.

The filter alone gives what a controller could know of the motion at every time: its estimates are
late, where those of the smoother are not. Positions are estimated through

$$\frac{2 \omega_c p^2 + 2 \omega_c^2 p + \omega_c^3}{p^3 + 2 \omega_c p^2 + 2 \omega_c^2 p +
\omega_c^3}$$

for steps that are short against $1/\omega_c$, velocities without its first term and accelerations
without its first two: slow accelerations are $2/\omega_c$ late, of logged velocities
$\sqrt 2/\omega_c$.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Designed,
    derived_jointly,
)
from steelyard.symbolic.native import kalman_loops as loops

VAGUE_START = 1e6
"""What the first sample may be off, over what the first three samples say of it (variances)."""
RATIO_DECADES = (-18.0, 9.0)
"""Decades of the jerk's intensity over the measurement's variance, time counted in steps."""
RATIO_GRID = 19  # ratios at which the likelihood is looked at before it is refined
LIKELIHOOD_SAMPLES = 30_000
"""Samples of which the likelihood is, in `LIKELIHOOD_STRETCHES` stretches of longer channels."""
LIKELIHOOD_STRETCHES = 10
HIGHEST_CUTOFF = 0.25  # highest likeliest cut-off, per sampling rate
LEAST_KALMAN_SAMPLES = 6  # least number of samples


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Channels and their first two derivatives, smoothed, shape `(N, C)` each.

    `std` are the standard deviations of the three if the model holds, `(3, N, C)`; `noise` is that
    of a measurement, `jerk` the root of the jerk's intensity [1/s^2.5], `(C,)`.
    """

    value: Array
    rate: Array
    acceleration: Array
    std: Array
    noise: Array
    jerk: Array


def kalman_smoothed(
    t: Array, values: Array, cutoff: float | None = None, order: int = 3
) -> Smoothed:
    """Any channels `(N, C)` at increasing times `(N,)` [s] through the smoother.

    Args:
        t: Time; steps may differ.
        values: Positions, efforts, wrenches.
        cutoff: Half-amplitude frequency that fixes the ratio of the noises [Hz]; by default every
            channel's ratio is the most likely one.
        order: Derivative of the channels that is white noise: 3 for positions; 2 for velocities,
            whose acceleration then wanders and whose second derivative is not known, thus zero.
    """
    steps = np.diff(t, prepend=t[:1])
    if len(t) < LEAST_KALMAN_SAMPLES or not (steps[1:] > 0.0).all():
        raise LogError(
            f"{len(t)} samples, or a time that does not increase, cannot be smoothed",
            where="Kalman smoother",
            fix=f"give {LEAST_KALMAN_SAMPLES} samples or more, in order of time",
        )
    unit = float(np.median(steps[1:]))
    result = np.empty((6, *values.shape))
    noise, jerk = np.empty(values.shape[1]), np.empty(values.shape[1])
    for c, y in enumerate(np.ascontiguousarray(values.T, dtype=np.float64)):
        if cutoff is None:
            ratio = likeliest_ratio(y, steps / unit, order)
        else:
            ratio = float((2.0 * np.pi * cutoff * unit) ** (2 * order))
        kept = filtered(y, steps / unit, ratio, order)
        states, variances = loops.smoothed(kept, steps / unit)
        noise[c] = np.sqrt(likeliest_variance(kept))
        jerk[c] = noise[c] * np.sqrt(ratio) / unit ** (order - 0.5)
        per_step = unit ** -np.arange(3.0)
        result[:3, :, c] = (states * per_step).T
        result[3:, :, c] = (noise[c] * np.sqrt(np.maximum(variances, 0.0)) * per_step).T
    return Smoothed(result[0], result[1], result[2], result[3:], noise, jerk)


def likeliest_ratio(values: Array, steps: Array, order: int = 3) -> float:
    r"""Jerk's intensity over the measurement's variance that makes the innovations likeliest.

    With innovations $e_k$ of variance $r S_k$ it minimises
    $N \log \overline{e^2 / S} + \sum \log S$; the mean is the likeliest $r$. One channel, `(N,)`;
    `steps` since the sample before in units of choice; `order` as of `kalman_smoothed`.
    """
    parts = likelihood_stretches(len(values))

    def loss(decade: float) -> float:
        kept = [filtered(values[p], steps[p], 10.0**decade, order)[3:, 9:] for p in parts]
        innovation, variance = np.concatenate(kept).T
        scale = np.mean(innovation**2 / variance)
        return float(np.log(max(scale, 1e-300)) + np.log(variance).mean())

    return float(10.0 ** least_on_grid(loss, np.linspace(*RATIO_DECADES, RATIO_GRID), 0.01))


def least_on_grid(loss: Callable[[float], float], grid: Array, tolerance: float) -> float:
    """Where a loss is least: beside the best point of a grid, to a tolerance."""
    from scipy.optimize import minimize_scalar

    best = int(np.argmin([loss(x) for x in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = minimize_scalar(loss, bounds=around, method="bounded", options={"xatol": tolerance})
    return float(found.x)


def cutoff_of_ratio(ratio: float, order: int, rate: float, lowest: float) -> float:
    """Cut-off of the smoother with a ratio of the noises, from `lowest` on, in 3 digits [Hz]."""
    cutoff = ratio ** (0.5 / order) * rate / (2.0 * np.pi)
    return float(f"{min(max(cutoff, lowest), HIGHEST_CUTOFF * rate):.3g}")


def likelihood_stretches(count: int) -> list[slice]:
    """The samples that a likelihood looks at: all, or stretches of a long channel."""
    if count <= LIKELIHOOD_SAMPLES:
        return [slice(0, count)]
    length = LIKELIHOOD_SAMPLES // LIKELIHOOD_STRETCHES
    starts = np.linspace(0, count - length, LIKELIHOOD_STRETCHES).astype(int).tolist()
    return [slice(start, start + length) for start in starts]


def filtered(values: Array, steps: Array, ratio: float, order: int = 3) -> Array:
    """What `kalman_loops.filtered` keeps of each sample, begun with a vague state of the first.

    The arguments are those of `likeliest_ratio` and the ratio.
    """
    first = np.concatenate(([0.0], steps[1:]))
    later = np.cumsum(first[:order])
    factorial = np.array([1.0, 1.0, 2.0])[:order]
    short, long = np.minimum.outer(later, later), np.maximum.outer(later, later)
    more = long - short
    wander = short**3 / 3.0 + more * short**2 / 2.0
    if order == 3:
        wander = short**5 / 20.0 + more * short**4 / 8.0 + more**2 * short**3 / 12.0
    inverse = np.linalg.inv(later[:, None] ** np.arange(float(order)) / factorial)
    start, spread = np.zeros(3), np.zeros((3, 3))
    start[:order] = inverse @ values[:order]
    spread[:order, :order] = VAGUE_START * inverse @ (np.eye(order) + ratio * wander) @ inverse.T
    return loops.filtered(values, first, ratio, start, spread, order)


def likeliest_variance(kept: Array) -> float:
    """The likeliest variance of a measurement, from what `filtered` kept."""
    return float(np.mean(kept[3:, 9] ** 2 / kept[3:, 10]))


@dataclass(frozen=True)
class Kalman:
    """Motion by the Kalman smoother: of positions, and of logged velocities if there are any."""

    name: ClassVar[str] = "kalman"
    # whether the noises are found by maximum `"likelihood"`, joint by joint, or their ratio by the
    # `"cutoff"` of the motion
    choose: Literal["likelihood", "cutoff"] = "likelihood"

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The smoother for a cut-off [Hz] and a rate [Hz]."""
        given = cutoff if self.choose == "cutoff" else None

        def states(x: Array, order: int) -> Array:
            found = kalman_smoothed(np.arange(x.shape[1]) / rate, x.T, given, order)
            return np.stack((found.value.T, found.rate.T, found.acceleration.T))

        return derived_jointly(states)


JointCutoffs = tuple[float, ...]


@dataclass(frozen=True)
class CausalKalman:
    """Motion by the Kalman filter: of positions, and of logged velocities if there are any."""

    name: ClassVar[str] = "kalman_filter"
    # whether the cut-offs are found by maximum `"likelihood"`, joint by joint, or are the
    # `"cutoff"` of the motion
    choose: Literal["likelihood", "cutoff"] = "likelihood"
    # cut-off of each position [Hz]; found in the log if not given
    cutoffs: JointCutoffs | None = None
    velocity_cutoffs: JointCutoffs | None = None  # of each logged velocity [Hz], likewise

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The filter for a cut-off [Hz], where none is found, and a rate [Hz]."""

        def states(x: Array, order: int) -> Array:
            own = self.cutoffs if order == 3 else self.velocity_cutoffs
            return _states(x, own or (cutoff,) * len(x), order, rate)

        return derived_jointly(states)

    def chosen(
        self, q: Array, dq: Array | None, rate: float, band: float, *, whole: bool
    ) -> "CausalKalman":
        """The same with the likeliest cut-offs of a log, no lower than its motion."""
        if self.choose == "cutoff":
            return self

        def likeliest(x: Array, order: int) -> JointCutoffs:
            ratios = [likeliest_ratio(channel, np.ones(x.shape[1]), order) for channel in x]
            return tuple(cutoff_of_ratio(ratio, order, rate, band) for ratio in ratios)

        velocity = self.velocity_cutoffs
        if dq is not None and not velocity:
            velocity = likeliest(dq, 2)
        return replace(self, cutoffs=self.cutoffs or likeliest(q, 3), velocity_cutoffs=velocity)

    def lateness(self, cutoff: float) -> float:
        """How late slow accelerations are [s]: those of the joint with the lowest cut-off."""
        if self.velocity_cutoffs:
            return float(np.sqrt(2.0) / (2.0 * np.pi * min(self.velocity_cutoffs)))
        return 1.0 / (np.pi * min(self.cutoffs or (cutoff,)))


def check_cutoffs(cutoffs: Sequence[float], x: Array, method: str) -> None:
    """There is a cut-off for each of the channels `(n, N)`."""
    if len(cutoffs) != len(x):
        raise LogError(
            f"there are {len(cutoffs)} cut-offs for {len(x)} joints",
            where=f"method '{method}' of [processing]",
            fix="give one per joint, or leave them out",
        )


def _states(x: Array, cutoffs: JointCutoffs, order: int, rate: float) -> Array:
    """Channels `(n, N)` and their derivatives as the filter knows them, `(3, n, N)`."""
    check_cutoffs(cutoffs, x, CausalKalman.name)
    steps, result = np.ones(x.shape[1]), np.empty((3, *x.shape))
    for j, (channel, own) in enumerate(zip(x, cutoffs, strict=True)):
        ratio = (2.0 * np.pi * own / rate) ** (2 * order)
        kept = filtered(np.ascontiguousarray(channel), steps, ratio, order)
        gains = kept[:, 3:6] / kept[:, 10:]
        result[:, j] = (kept[:, :3] + gains * kept[:, 9:10]).T
    return result * (rate ** np.arange(3.0))[:, None, None]


@dataclass(frozen=True)
class KalmanSmoother:
    """Efforts by the Kalman smoother."""

    name: ClassVar[str] = "kalman"
    # whether the noises are found by maximum `"likelihood"`, joint by joint, or their ratio by the
    # `"cutoff"`
    choose: Literal["likelihood", "cutoff"] = "likelihood"
    # derivative of the effort that is white noise: 2, for the low-pass of fourth order that is
    # nearer to the steps of dry friction, or 3
    order: Literal[2, 3] = 2

    def smooth(self, cutoff: float, rate: float) -> Designed:
        """The smoother for a cut-off [Hz] and a rate [Hz]."""
        given = cutoff if self.choose == "cutoff" else None

        def smoothed(efforts: Array) -> Array:
            t = np.arange(efforts.shape[1]) / rate
            return kalman_smoothed(t, efforts.T, given, self.order).value.T

        return Designed(smoothed)


@dataclass(frozen=True)
class CausalKalmanSmoother(KalmanSmoother):
    """Efforts by the Kalman filter alone, which looks at no later sample and is late."""

    name: ClassVar[str] = "kalman_filter"

    def smooth(self, cutoff: float, rate: float) -> Designed:
        """The filter for a cut-off [Hz] and a rate [Hz]."""

        def states(efforts: Array) -> Array:
            cutoffs, steps = (cutoff,) * len(efforts), np.ones(efforts.shape[1])
            if self.choose == "likelihood":
                ratios = (likeliest_ratio(x, steps, self.order) for x in efforts)
                cutoffs = tuple(cutoff_of_ratio(x, self.order, rate, 0.0) for x in ratios)
            return np.asarray(_states(efforts, cutoffs, self.order, rate)[0])

        return Designed(states)
