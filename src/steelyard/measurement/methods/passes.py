"""Filters that are applied several times, one pass after the other."""

from functools import reduce

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.measurement.convolve import Bank, Response, Single

MOST_PASSES = 20
"""The more passes, the nearer a moving average is to a Gaussian: more are another filter's work."""


def check_passes(passes: int, method: str) -> None:
    """Refuse a number of passes that is not available.

    Raises:
        ModelError: It is not from 1 to `MOST_PASSES`.
    """
    if not 1 <= passes <= MOST_PASSES:
        raise ModelError(
            f"a filter cannot be applied {passes} times",
            where=method,
            fix=f"choose a number of passes from 1 to {MOST_PASSES}",
        )


def repeated_smoother(bank: Bank, passes: int) -> Single:
    """A symmetric low-pass applied several times, as one convolution.

    Its halo is that of all passes together. At the ends of a segment, which is continued by odd
    reflection, it gives what a pass after the other gives: symmetric filters of gain 1 keep the
    reflection.

    Args:
        bank: One filter, shape `(1, 2 halo + 1)`.
        passes: How often it is applied.
    """
    return Single(Bank.of(convolved(bank.taps, bank.taps[0], passes - 1)))


def convolved(rows: Array, taps: Array, times: int) -> Array:
    """Filters behind further passes of another one, shape `(k, N + times (M - 1))`.

    Args:
        rows: Their coefficients, shape `(k, N)`.
        taps: Those of the other filter, shape `(M,)`.
        times: Number of its passes.
    """
    return np.array([reduce(np.convolve, [taps] * times, row) for row in rows])


def repeated_response(response: Response, passes: int) -> Response:
    """The frequency response of several passes."""
    return lambda omega: response(omega) ** passes
