r"""Spectra of motion: its band and the noise below it; the period of a motion and its mean.

The distance of a motion from itself a time $\tau$ later,
$D(\tau) = \overline{\sum_j (q_j(t + \tau) - q_j(t))^2} / (2 \sum_j \sigma_j^2)$, is about 1 for
unrelated stretches and near 0 at the period. Only what the log holds twice is compared, so half a
period more than one is enough.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError

SPECTRUM_WINDOW = 20.0  # length of the spectrum's windows [s]: two lines below a 0.1 Hz motion
SHORTEST_WINDOW = 16  # the same in samples, at least, however slow the clock seems to be
BAND_POWER_SHARE = 0.99
"""Share of a joint's velocity power that its band holds. The last percent is spread over corners
of point-to-point moves and over noise."""
BAND_OVER_NOISE = 10.0  # power density over the noise's at which the motion ends
STILL_JOINT_SPEED = 0.02
"""A joint with a smaller share of the fastest joint's rms speed does not count for the band."""


@dataclass(frozen=True, eq=False)
class Band:
    """What the spectrum of the positions says."""

    frequency: float  # frequency below which the motion lives, the median over moving joints [Hz]
    noise: Array  # noise density of each position, shape `(n,)` [rad²/Hz; m²/Hz]
    # frequency at which the positions' spectrum meets its noise, the median likewise [Hz]
    floor: float = 0.0


def welch(
    x: Array, rate: float, window: float = SPECTRUM_WINDOW, *, detrend: bool = True
) -> tuple[Array, Array]:
    """Frequencies `(F,)` [Hz] and one-sided densities `(C, F)` by Welch's method, of `(C, N)`.

    Hann windows of so many seconds, half overlapping, are taken one at a time; `detrend` removes
    mean and trend of each. It is `scipy.signal.welch` but for the first and the last line, which
    are doubled like the others. That one holds all windows at once: 430 MiB for 2e6 samples of 7
    channels.
    """
    length = min(x.shape[1], max(round(window * rate), SHORTEST_WINDOW))
    hann: Array = np.sin(np.pi * np.arange(length) / length) ** 2
    ramp: Array = np.linspace(-1.0, 1.0, length)
    density = np.zeros((len(x), length // 2 + 1))
    starts = range(0, x.shape[1] - length + 1, max(1, length // 2))
    for start in starts:
        piece = x[:, start : start + length]
        if detrend:
            piece = piece - piece.mean(axis=1, keepdims=True)
            piece -= (piece @ ramp / (ramp @ ramp))[:, None] * ramp
        density += np.abs(np.fft.rfft(piece * hann)) ** 2
    density *= 2.0 / (rate * (hann @ hann) * len(starts))
    return np.arange(length // 2 + 1) * (rate / length), density


def motion_band(q: Array, rate: float, dq: Array | None = None) -> Band:
    """Band of the motion and noise of uniformly sampled positions `(n, N)`.

    The noise is the median density of the upper half of the spectrum. Velocities are differences
    of positions, or those that are logged, whose spectrum and noise then count, their mean
    included: a trapezoidal move is little else. From the peak of a joint's velocity density
    upwards, its motion ends where the position's (or the logged velocity's) density sinks to
    `BAND_OVER_NOISE` times the noise, and its band holds `BAND_POWER_SHARE` of the velocity power
    up to there.
    """
    frequency, position = welch(q, rate)
    noise = np.median(position[:, position.shape[1] // 2 :], axis=1)
    seen, level = position, noise
    if dq is None:
        beyond = 2.0 * q[:, -1:] - q[:, -2:-1]
        dq = rate * np.diff(q, axis=1, append=beyond)
        velocity = welch(dq, rate, detrend=False)[1]
    else:
        seen = velocity = welch(dq, rate, detrend=False)[1]
        level = np.median(velocity[:, velocity.shape[1] // 2 :], axis=1)
    bands, powers, floors = [], [], []
    for joint in range(len(q)):
        smooth = np.convolve(seen[joint], np.full(5, 0.2), mode="same")
        audible = smooth > BAND_OVER_NOISE * level[joint]
        peak = int(np.argmax(np.where(audible, velocity[joint], 0.0)))
        quiet = np.flatnonzero(~audible[peak:])
        end = peak + int(quiet[0]) if len(quiet) else len(frequency)
        power = np.cumsum(velocity[joint, :end])
        floors.append(frequency[min(end, len(frequency) - 1)])
        total = float(power[-1]) if len(power) else 0.0
        powers.append(total)
        bands.append(frequency[np.searchsorted(power, BAND_POWER_SHARE * total)] if total else 0.0)
    fast = np.sqrt(powers) >= STILL_JOINT_SPEED * np.sqrt(max(powers))
    band, floor = (float(np.median(np.array(f)[fast])) for f in (bands, floors))
    return Band(band, noise, max(band, floor))


COARSE_SAMPLES = 4000  # samples on which the period is looked for first
DEPARTURE_DISTANCE = 0.2  # distance that the motion must reach before it can come back
RETURN_DISTANCE = 2e-3  # distance at the period, at most: 6 % of the motion's size
SEEN_TWICE = 0.25  # share of the period that the log must hold twice
REST_RANGE_SHARE = 0.01
"""A joint has departed when it is this share of its range from where it started or ends."""
STANDING_RANGE_SHARE = 2e-3
"""The same as a share of the widest range of a joint, at least: others push joints that stand."""
REST_OVER_NOISE = 10.0  # the same over the standard deviation of its position's noise, at least
NOISE_WINDOW = 1000  # samples of the windows in whose spectra that noise is seen
WRAPPED_POINTS = 20  # points beyond a period by which it is closed before it is interpolated


@dataclass(frozen=True)
class Repetitions:
    """That a log repeats one motion: `repetitions = ...` under `[processing]`."""

    period: float | None = None  # time between repetitions [s]; found if not given
    drop_first: int = 1  # repetitions at the start that are left out
    drop_last: int = 1  # repetitions at the end that are left out

    def __post_init__(self) -> None:
        least = min(self.drop_first, self.drop_last)
        if (self.period is not None and self.period <= 0.0) or least < 0:
            raise ModelError(
                f"repetitions of {self.period} s, {self.drop_first} and {self.drop_last} of them "
                "dropped, are not valid",
                where="repetitions",
                fix="give period = ... above 0 s, drop_first and drop_last from 0 on",
            )


def moving_span(q: Array) -> tuple[int, int]:
    """First sample and the one after the last between the rests at both ends, of `(n, N)`.

    Joints that stand, but for noise and what the others push them, do not count; `(0, 0)` if all
    do.
    """
    span = np.maximum(np.ptp(q, axis=1, keepdims=True), 1e-12)
    density = welch(q, 1.0, NOISE_WINDOW)[1]
    noise = np.sqrt(0.5 * np.median(density[:, density.shape[1] // 2 :], axis=1, keepdims=True))
    far = np.maximum(REST_RANGE_SHARE * span, STANDING_RANGE_SHARE * span.max())
    far = np.maximum(far, REST_OVER_NOISE * noise)
    left = (np.abs(q - q[:, :1]) > far).any(axis=0)
    right = (np.abs(q - q[:, -1:]) > far).any(axis=0)
    if not left.any():
        return 0, 0
    stop = q.shape[1] - int(np.argmax(right[::-1])) + 1
    return max(int(np.argmax(left)) - 1, 0), min(stop, q.shape[1])


def find_period(q: Array, rate: float) -> float | None:
    """The period of a motion `(n, N)` [s], or `None` if it does not come back.

    Rests at the ends do not matter.
    """
    start, stop = moving_span(q)
    if stop - start < 20:
        return None
    q = q[:, start:stop] - q[:, start:stop].mean(axis=1, keepdims=True)
    every = max(1, q.shape[1] // COARSE_SAMPLES)
    coarse = distance(q[:, ::every])
    longest = int(coarse.shape[0] / (1.0 + SEEN_TWICE))
    away = np.flatnonzero(coarse[:longest] > DEPARTURE_DISTANCE)
    if not len(away):
        return None
    near = np.flatnonzero(coarse[away[0] : longest] < 4.0 * RETURN_DISTANCE) + away[0]
    while len(near):
        stretch = near[: int(np.argmax(np.diff(near, append=near[-1] + 2) > 1)) + 1]
        lag, depth = _refined(q, every * int(stretch[np.argmin(coarse[stretch])]), every)
        if depth < RETURN_DISTANCE:
            many = int(0.6 * q.shape[1] / lag)  # seen over as many as half the motion holds
            for times in (2**k for k in range(1, max(many, 1).bit_length())):
                lag = _refined(q, round(times * lag), 2)[0] / times
            return lag / rate
        near = near[len(stretch) :]
    return None


def distance(q: Array) -> Array:
    """Distance of a motion `(n, N)` without mean from itself at every lag; see the module."""
    count = q.shape[1]
    spectrum = np.fft.rfft(q, 2 * count)
    product = np.fft.irfft(np.abs(spectrum) ** 2, 2 * count)[:, :count].sum(axis=0)
    energy = np.concatenate(([0.0], np.cumsum(np.square(q).sum(axis=0))))
    both = energy[count:0:-1] + energy[count] - energy[:count]
    overlap = count - np.arange(count)
    size = max(2.0 * float(energy[count]) / count, 1e-300)
    return np.asarray(np.maximum(both - 2.0 * product, 0.0) / (overlap * size))


def _refined(q: Array, near: int, around: int) -> tuple[float, float]:
    """The lag between samples at which the distance is least, and the distance there."""
    size = 2.0 * np.square(q).sum() / q.shape[1]
    lags = np.arange(max(1, near - around - 1), near + around + 2)
    found = np.array([np.square(q[:, x:] - q[:, :-x]).sum() / (q.shape[1] - x) for x in lags])
    k = int(np.clip(np.argmin(found), 1, len(lags) - 2))
    left, middle, right = found[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    shift = float(np.clip(0.5 * (left - right) / bend, -1.0, 1.0)) if bend > 0.0 else 0.0
    depth = middle - 0.125 * (left - right) ** 2 / bend if bend > 0.0 else middle
    return float(lags[k]) + shift, float(max(depth, 0.0) / size)


def mean_period(x: Array, length: float, bent: int = 0) -> Array:
    """The mean of channels `(..., N)` over periods of `length` samples, `(..., round(length))`.

    `bent` samples at each end are left out where others are there.
    """
    from scipy.interpolate import make_interp_spline

    last, points = x.shape[-1] - 1, round(length)
    curve = make_interp_spline(np.arange(last + 1.0), x, k=5, axis=-1)
    total, count = np.zeros((*x.shape[:-1], points)), np.zeros(points)
    for margin in (bent, 0):
        missing = count == 0.0
        for start in np.arange(0.0, last + 1.0, length):
            at = start + np.arange(points) * (length / points)
            good = missing & (at >= margin) & (at <= last - margin)
            if good.any():
                total[..., good] += curve(at[good])
                count += good
    return np.asarray(total / np.maximum(count, 1.0))


def folded(x: Array, length: float, bent: int = 0) -> Array:
    """Channels of periodic motion `(..., N)`, each sample replaced by its mean over periods."""
    from scipy.interpolate import make_interp_spline

    table = mean_period(x, length, bent)
    points = table.shape[-1]
    around = np.arange(-WRAPPED_POINTS, points + WRAPPED_POINTS + 1)
    curve = make_interp_spline(around, table[..., around % points], k=5, axis=-1)
    return np.asarray(curve(np.mod(np.arange(x.shape[-1]) / length, 1.0) * points))
