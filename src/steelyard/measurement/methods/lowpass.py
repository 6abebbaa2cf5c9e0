r"""Zero-phase Butterworth low-pass: forward and backward, as one symmetric convolution.

Forward and backward filtering with the digital Butterworth filter of order k (bilinear transform),
which is what `scipy.signal.sosfiltfilt` does, has the response
$|H|^2 = 1 / (1 + (\tan(\omega/2) / \tan(\omega_c/2))^{2 k})$. It is one half at the cut-off. Its
impulse response dies out exponentially, so a finite halo gives it to rounding.
"""

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.measurement.chunks import apply
from steelyard.measurement.convolve import Bank, Response

ORDER = 4
TAIL = 1e-12
"""What is left of the impulse response where it is cut off."""
FINE = 40.0
"""Sampling rate over cut-off at which the noise bandwidth is taken."""
FREQUENCIES = 4096
"""Frequencies that it is summed over."""


def butterworth(cutoff: float, rate: float, order: int = ORDER) -> Response:
    """Response of the zero-phase Butterworth low-pass.

    Args:
        cutoff: [Hz], below half the rate.
        rate: Sampling rate [Hz].
        order: Order of the filter that is run forward and backward.
    """
    edge = np.tan(np.pi * cutoff / rate)

    def response(omega: Array) -> Array:
        with np.errstate(over="ignore"):
            ratio = (np.tan(np.minimum(omega, np.pi * (1.0 - 1e-12)) / 2.0) / edge) ** (2 * order)
            gain: Array = 1.0 / (1.0 + ratio)
        return gain

    return response


def settling(cutoff: float, rate: float, order: int = ORDER, tail: float = TAIL) -> int:
    """Samples after which the impulse response of `butterworth` has died out to `tail`."""
    k = np.arange(order)
    poles = np.tan(np.pi * cutoff / rate) * np.exp(0.5j * np.pi * (2 * k + order + 1) / order)
    slowest = np.abs((1.0 + poles) / (1.0 - poles)).max()
    return int(np.ceil(np.log(tail) / np.log(slowest))) + 1


def noise_bandwidth(cutoff: float) -> float:
    """Bandwidth of an ideal low-pass that leaves as much of white noise as `butterworth` [Hz]."""
    omega = (np.arange(FREQUENCIES) + 0.5) * np.pi / FREQUENCIES
    gain = butterworth(cutoff, FINE * cutoff)(omega)
    return float(0.5 * FINE * cutoff * np.mean(np.square(gain)))


def low_pass(cutoff: float, rate: float, order: int = ORDER, tail: float = TAIL) -> Bank:
    """The zero-phase low-pass as an operation with a halo, its response cut off at `tail`."""
    return Bank([butterworth(cutoff, rate, order)], settling(cutoff, rate, order, tail))


def require_fitting(cutoff: float, rate: float) -> None:
    """Check that a low-pass can be made.

    Raises:
        LogError: The cut-off does not fit the rate.
    """
    if not 0.0 < cutoff < 0.5 * rate:
        raise LogError(
            f"a low-pass of {cutoff:g} Hz does not fit samples at {rate:g} Hz",
            where="zero-phase low-pass",
            fix=f"choose a cut-off above 0 and below {0.5 * rate:g} Hz",
        )


def zero_phase(values: Array, cutoff: float, rate: float, order: int = ORDER) -> Array:
    """A whole segment through the zero-phase low-pass.

    Args:
        values: Shape `(N,)` or `(N, C)`, uniformly sampled.
        cutoff: [Hz].
        rate: [Hz].
        order: Order of the filter that is run forward and backward.

    Returns:
        The shape of `values`.

    Raises:
        LogError: The cut-off does not fit the rate.
    """
    require_fitting(cutoff, rate)
    if len(values) == 0:
        return values.copy()
    channels = values.reshape(len(values), -1).T
    filtered = [part[0] for part in apply(low_pass(cutoff, rate, order), [channels])]
    return np.concatenate(filtered, axis=-1).T.reshape(values.shape)
