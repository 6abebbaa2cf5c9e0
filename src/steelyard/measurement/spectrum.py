"""Spectra of motion: the band it lives in, and the noise below it."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array

WINDOW = 20.0
"""Length of the spectrum's windows [s]: two lines below a 0.1 Hz motion."""
SHORTEST = 16
"""The same in samples, at least, however slow the clock seems to be."""
SHARE = 0.99
"""Share of a joint's velocity power that its band holds. The last percent is spread over corners
of point-to-point moves and over noise."""
AUDIBLE = 10.0
"""Power density over the noise's at which the motion ends."""
STILL = 0.02
"""A joint with a smaller share of the fastest joint's rms speed does not count for the band."""


@dataclass(frozen=True, eq=False)
class Band:
    """What the spectrum of the positions says.

    Attributes:
        frequency: Frequency below which the motion lives, the median over moving joints [Hz].
        noise: Noise density of each position, shape `(n,)` [rad²/Hz; m²/Hz].
        floor: Frequency at which the positions' spectrum meets its noise, the median likewise [Hz].
    """

    frequency: float
    noise: Array
    floor: float = 0.0


def welch(
    x: Array, rate: float, window: float = WINDOW, *, detrend: bool = True
) -> tuple[Array, Array]:
    """Power density by Welch's method: Hann windows, half overlapping, one at a time.

    It is `scipy.signal.welch` but for the first and the last line, which are doubled like the
    others. That one holds all windows at once: 430 MiB for 2e6 samples of 7 channels.

    Args:
        x: Shape `(C, N)`.
        rate: [Hz].
        window: Length of the windows [s].
        detrend: Whether mean and trend of each window are removed.

    Returns:
        Frequencies `(F,)` [Hz] and one-sided densities `(C, F)`.
    """
    length = min(x.shape[1], max(round(window * rate), SHORTEST))
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
    frequency = np.arange(length // 2 + 1) * (rate / length)
    return frequency, density


def motion_band(q: Array, rate: float, dq: Array | None = None) -> Band:
    """Band of the motion and noise of the positions.

    The noise is the median density of the upper half of the spectrum. Velocities are differences
    of positions, or those that are logged, their mean included: a trapezoidal move is little else.
    From the peak of a joint's velocity density upwards, its motion ends where the position's (or
    the logged velocity's) density sinks to `AUDIBLE` times the noise, and its band holds `SHARE` of
    the velocity power up to there.

    Args:
        q: Positions, shape `(n, N)`, uniformly sampled.
        rate: [Hz].
        dq: Logged velocities, whose spectrum and noise then count instead of the positions'.
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
        audible = smooth > AUDIBLE * level[joint]
        peak = int(np.argmax(np.where(audible, velocity[joint], 0.0)))
        quiet = np.flatnonzero(~audible[peak:])
        end = peak + int(quiet[0]) if len(quiet) else len(frequency)
        power = np.cumsum(velocity[joint, :end])
        floors.append(frequency[min(end, len(frequency) - 1)])
        total = float(power[-1]) if len(power) else 0.0
        powers.append(total)
        bands.append(frequency[np.searchsorted(power, SHARE * total)] if total else 0.0)
    fast = np.sqrt(powers) >= STILL * np.sqrt(max(powers))
    band, floor = (float(np.median(np.array(f)[fast])) for f in (bands, floors))
    return Band(band, noise, max(band, floor))
