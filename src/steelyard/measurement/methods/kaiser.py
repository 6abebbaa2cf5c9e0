"""Low-pass filters by Kaiser's window [Kaiser1974]; importing SciPy's takes half a second."""

import numpy as np

from steelyard.arrays import Array


def kaiser_lowpass(suppression: float, width: float, cutoff: float) -> Array:
    r"""Coefficients of a linear-phase low-pass, odd in number, their sum 1.

    As `scipy.signal.firwin` of the length and shape that `scipy.signal.kaiserord` gives.

    Args:
        suppression: Of the stop band [dB], 8 or more.
        width: Of the transition, relative to half the sampling rate.
        cutoff: Half-amplitude frequency, likewise.

    Raises:
        ValueError: The cut-off is not between 0 and 1.
    """
    if not 0.0 < cutoff < 1.0:
        raise ValueError(f"cut-off {cutoff:g} is not between 0 and 1")
    length = int(np.ceil((suppression - 7.95) / (2.285 * np.pi * width) + 1.0))
    length += 1 - length % 2
    if suppression > 50.0:
        beta = 0.1102 * (suppression - 8.7)
    else:
        above = max(suppression - 21.0, 0.0)
        beta = 0.5842 * above**0.4 + 0.07886 * above
    middle = np.arange(length) - 0.5 * (length - 1)
    taps = cutoff * np.sinc(cutoff * middle) * np.kaiser(length, beta)
    return np.asarray(taps / taps.sum())
