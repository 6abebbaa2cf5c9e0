"""The parallel filter: one linear-phase low-pass on regressor columns and effort alike.

Filtering both sides of `effort = columns · parameters` alike leaves the parameters what they are
and removes the noise above the motion's band.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.measurement.methods.kaiser import kaiser_lowpass

SUPPRESSION = 60.0
"""Attenuation above twice the cut-off [dB]."""

FINE = 40.0
"""Sampling rate over cut-off at which the noise bandwidth is taken."""


@dataclass(frozen=True, eq=False)
class ParallelFilter:
    """A symmetric FIR low-pass that keeps every `decimation`-th sample.

    Attributes:
        cutoff: Half-amplitude frequency [Hz].
        rate: Sampling rate it was made for [Hz].
        taps: Odd number of coefficients, sum 1.
        decimation: Samples per kept sample; kept samples come at four times the cut-off or faster.
    """

    cutoff: float
    rate: float
    taps: Array
    decimation: int

    @classmethod
    def design(cls, cutoff: float, rate: float) -> "ParallelFilter":
        """Kaiser-windowed low-pass, `SUPPRESSION` dB down from twice the cut-off on.

        Args:
            cutoff: [Hz], below a quarter of the rate.
            rate: [Hz].
        """
        taps = kaiser_lowpass(SUPPRESSION, 2.0 * cutoff / rate, 2.0 * cutoff / rate)
        return cls(cutoff, rate, frozen(taps), max(1, int(rate / (4.0 * cutoff))))

    @property
    def inflation(self) -> float:
        r"""Variance of an estimate per variance if the filtered residuals were uncorrelated.

        White noise through the filter has autocorrelation $r$; a slowly varying column meets its
        sum over the kept samples, $\sum_k r(kD) / r(0)$.
        """
        full = np.correlate(self.taps, self.taps, mode="full")
        centre = len(self.taps) - 1
        kept = full[centre % self.decimation :: self.decimation]
        return float(kept.sum() / full[centre])

    @property
    def description(self) -> str:
        """For fingerprints and reports."""
        return f"FIR low-pass {self.cutoff:g} Hz, {len(self.taps)} taps at {self.rate:g} Hz"


def noise_bandwidth(cutoff: float) -> float:
    """Bandwidth of an ideal low-pass that leaves as much of white noise as the filter [Hz]."""
    filter_ = ParallelFilter.design(cutoff, FINE * cutoff)
    return float(0.5 * FINE * cutoff * np.sum(np.square(filter_.taps)))
