"""The method `fir`: a Kaiser-windowed linear-phase low-pass, derivatives exact in its band."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError, ModelError
from steelyard.measurement.convolve import Bank, Single
from steelyard.measurement.methods.butterworth import Differentiating
from steelyard.measurement.methods.kaiser import kaiser_lowpass
from steelyard.measurement.methods.passes import (
    check_passes,
    repeated_response,
    repeated_smoother,
)

RINGING = 2
"""Halo over that of the filter itself: its derivatives ring on at the level of its suppression."""
SUPPRESSIONS = 20.0, 120.0
"""Least and most suppression that can be requested [dB]."""


@dataclass(frozen=True)
class FIR:
    """Zero-phase FIR low-pass of positions, and of logged velocities [Kaiser1974].

    Attributes:
        suppression: How far down the filter is behind its transition [dB].
        transition: Width of the transition from passing to stopping, around the cut-off at which
            half of an amplitude passes, over the cut-off.
        passes: How often the filter is applied.
    """

    name: ClassVar[str] = "fir"
    suppression: float = 80.0
    transition: float = 1.0
    passes: int = 1

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

    def designed(self, cutoff: float, rate: float) -> Differentiating:
        """The filter and its derivatives for a cut-off [Hz] and a rate [Hz]."""
        from scipy.signal import freqz

        taps = self.taps(cutoff, rate)
        middle = len(taps) // 2

        def response(omega: Array) -> Array:
            gain: Array = (freqz(taps, worN=omega)[1] * np.exp(1j * omega * middle)).real
            return np.where(omega < np.pi * (1.0 - 1e-12), gain, 0.0)

        every = repeated_response(response, self.passes)
        return Differentiating(every, RINGING * middle * self.passes, rate)

    def smooth(self, cutoff: float, rate: float) -> Single:
        """The filter alone, for efforts."""
        return repeated_smoother(Bank.of(self.taps(cutoff, rate)[None]), self.passes)

    def taps(self, cutoff: float, rate: float) -> Array:
        """The filter's coefficients, odd in number, their sum 1.

        Raises:
            LogError: The transition ends above half the rate.
        """
        width = self.transition * cutoff
        if cutoff + 0.5 * width >= 0.5 * rate:
            raise LogError(
                f"an FIR low-pass of {cutoff:g} Hz that stops at {cutoff + 0.5 * width:g} Hz does "
                f"not fit samples at {rate:g} Hz",
                where="method 'fir' of [processing]",
                fix=f"choose a lower motion_cutoff, or a transition below {rate / cutoff - 2:.2g}",
            )
        return kaiser_lowpass(self.suppression, 2.0 * width / rate, 2.0 * cutoff / rate)
