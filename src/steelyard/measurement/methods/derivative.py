r"""Derivatives of a low-passed signal: exact in the filter's band.

The derivative of a band-limited signal has the response $i \omega$, in the low-pass's pass band
as well as in its transition. Central differences only approach it (with seven points they are 6.6 %
short at a quarter of the rate), so the low-pass and the derivative are designed as one filter.
"""

import numpy as np

from steelyard.arrays import Array
from steelyard.measurement.chunks import apply
from steelyard.measurement.convolve import Bank, Response
from steelyard.measurement.methods.lowpass import ORDER, butterworth, settling


def differentiated(response: Response, rate: float, times: int) -> Response:
    """A filter followed by so many derivatives.

    Args:
        response: The filter; it must vanish at half the rate.
        rate: Sampling rate [Hz].
        times: Number of derivatives with respect to time.
    """

    def derivative(omega: Array) -> Array:
        return response(omega) * (1j * omega * rate) ** times

    return derivative


def smooth_derivatives(cutoff: float, rate: float, highest: int, order: int = ORDER) -> Bank:
    """Zero-phase low-pass and derivatives in one operation.

    Args:
        cutoff: Of the Butterworth low-pass [Hz].
        rate: [Hz].
        highest: Results are the low-passed signal and its derivatives up to this one.
        order: Order of the filter that is run forward and backward.
    """
    smooth = butterworth(cutoff, rate, order)
    responses = [differentiated(smooth, rate, times) for times in range(highest + 1)]
    return Bank(responses, settling(cutoff, rate, order))


def derivatives(values: Array, cutoff: float, rate: float, highest: int = 2) -> Array:
    """Low-passed signal and its derivatives of a whole segment.

    Args:
        values: Shape `(N, C)`, uniformly sampled.
        cutoff: [Hz].
        rate: [Hz].
        highest: Number of derivatives.

    Returns:
        Shape `(highest + 1, N, C)`.
    """
    bank = smooth_derivatives(cutoff, rate, highest)
    parts = list(apply(bank, [np.ascontiguousarray(values.T)]))
    return np.concatenate(parts, axis=-1).transpose(0, 2, 1)
