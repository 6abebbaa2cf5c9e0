r"""Delay between two channels, from the phase between their spectra.

A channel that comes a time $\tau$ late has its cross-spectrum with the other turned by
$-2 \pi f \tau$. The turn is a straight line over frequency; where the coherence $\gamma^2$ is high
the phase is sharp, its variance $(1 - \gamma^2) / (2 K \gamma^2)$ for $K$ averages
[BendatPiersol2010]. A weighted line through the origin gives $\tau$ to a fraction of a sample; the
scatter of the phases around it, if it is larger than that, widens the error.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.errors import LogError

ComplexArray = NDArray[np.complex128]
SEGMENTS = 8
"""Windows, half overlapping, that the spectra are averaged over."""
LEAST = 64
"""Least number of samples of a window."""
OVERLAP_GAIN = 0.55
"""Independent averages per window: neighbours share half their samples (Hann windows)."""
COHERENT = 0.5
"""Coherence from which on a frequency counts."""
MOVED = 1e-3
"""Power over its largest from which on a frequency counts."""
ROUNDS = 3
"""Rounds in which what is known of the delay is taken out before the windows are cut."""


@dataclass(frozen=True)
class Delay:
    """How late one channel comes after another.

    Attributes:
        seconds: Positive: the second channel is late [s].
        std: Standard error [s].
        coherence: Mean coherence of the frequencies that counted, in [0, 1].
    """

    seconds: float
    std: float
    coherence: float


def estimated_delay(a: Array, b: Array, rate: float) -> Delay:
    """How late `b` comes after `a`.

    Both must show the same motion up to a factor; `-a` for an opposite sign.

    Args:
        a: Shape `(N,)`, uniformly sampled.
        b: Shape `(N,)`.
        rate: [Hz].

    Raises:
        LogError: There are too few samples, or the channels have nothing in common.
    """
    if len(a) != len(b) or len(a) < 2 * LEAST:
        raise LogError(
            f"{min(len(a), len(b))} samples are too few for a delay",
            where="delay between channels",
            mend=f"give {2 * LEAST} samples or more of both",
        )
    whole = _coarse(a, b)
    best = Delay(whole / rate, np.inf, 0.0)
    for _ in range(ROUNDS):
        shift = round(best.seconds * rate)
        first, second = a[max(0, -shift) : len(a) - max(0, shift)], b[max(0, shift) :]
        length = min(len(first), len(second))
        if length < 2 * LEAST:
            break
        rest = _rest(first[:length], second[:length], rate)
        best = Delay(shift / rate + rest.seconds, rest.std, rest.coherence)
        if round(best.seconds * rate) == shift:
            break
    return best


def _coarse(a: Array, b: Array) -> int:
    """Samples at which both correlate most, in the band that both move in."""
    length = 2 * len(a)
    hann: Array = np.sin(np.pi * (np.arange(len(a)) + 0.5) / len(a)) ** 2
    x, y = (np.fft.rfft(_level(c) * hann, length) for c in (a, b))
    common = np.abs(x * y)
    cross = np.conj(x) * y * (common > MOVED * common.max())
    correlation = np.fft.irfft(cross, length)
    best = int(np.argmax(correlation))
    return best - length if best > length // 2 else best


def _rest(a: Array, b: Array, rate: float) -> Delay:
    """The delay of two channels that are less than a window apart."""
    first, second = (_windowed(c) for c in (a, b))
    size = 2 * (first.shape[1] - 1)
    each = np.conj(first) * second
    power = (np.abs(first) ** 2).mean(axis=0), (np.abs(second) ** 2).mean(axis=0)
    cross = each.mean(axis=0)
    coherence = np.abs(cross) ** 2 / np.maximum(power[0] * power[1], 1e-300)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, 1.0 / rate)
    common = np.sqrt(power[0] * power[1]) * (omega > 0.0)
    counted = (coherence > COHERENT) & (common > MOVED * common.max())
    if not counted.any():
        raise LogError(
            "the two channels have no frequency in common",
            where="delay between channels",
            mend="compare channels of the same joint while it moves",
        )
    averages = max(1.0, OVERLAP_GAIN * len(each))
    c, w = np.minimum(coherence[counted], 1.0 - 1e-9), omega[counted]
    weight = 2.0 * averages * c / (1.0 - c)
    known = float(weight @ w**2)
    phase = -np.angle(cross[counted])
    seconds = float(weight @ (w * phase)) / known
    turned = each[:, counted] * np.exp(1j * w * seconds)
    apart = -np.angle(turned) @ (weight * w) / known
    scatter = float(apart.std(ddof=1)) / np.sqrt(averages) if len(each) > 1 else 0.0
    misfit = float(weight @ (phase - w * seconds) ** 2) / max(1, len(w) - 1)
    std = max(np.sqrt(max(1.0, misfit) / known), scatter)
    return Delay(seconds, float(std), float(c.mean()))


def _windowed(x: Array) -> ComplexArray:
    """Spectra of windows, half overlapping, shape `(K, size // 2 + 1)`."""
    size = max(LEAST, 2 * len(x) // (SEGMENTS + 1)) // 2 * 2
    hann: Array = np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2
    starts = range(0, len(x) - size + 1, size // 2)
    return np.array([np.fft.rfft(_level(x[s : s + size]) * hann) for s in starts])


def _level(x: Array) -> Array:
    """A window without its mean and trend."""
    ramp: Array = np.linspace(-1.0, 1.0, len(x))
    level: Array = x - x.mean()
    return level - ramp * float(ramp @ level / (ramp @ ramp))
