"""The low-pass on both sides of a regression, which keeps every k-th sample.

Filtering both sides of `effort = columns · parameters` alike leaves the parameters what they are
and removes the noise above the motion's band.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.runs.smoothing.zero_phase_filters import kaiser_lowpass

SUPPRESSION = 60.0  # attenuation above twice the cut-off [dB]
FINE = 40.0  # sampling rate over cut-off at which the noise bandwidth is taken


@dataclass(frozen=True, eq=False)
class ParallelFilter:
    """A symmetric FIR low-pass that keeps every `decimation`-th sample."""

    cutoff: float  # half-amplitude frequency [Hz]
    rate: float  # sampling rate it was made for [Hz]
    taps: Array  # odd number of coefficients, sum 1
    # samples per kept sample; kept samples come at four times the cut-off or faster
    decimation: int

    @classmethod
    def design(cls, cutoff: float, rate: float) -> "ParallelFilter":
        """Kaiser-windowed low-pass, `SUPPRESSION` dB down from twice the cut-off on.

        The cut-off [Hz] is below a quarter of the rate [Hz].
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


def noise_bandwidth(cutoff: float) -> float:
    """Bandwidth of an ideal low-pass that leaves as much of white noise as the filter [Hz]."""
    filter_ = ParallelFilter.design(cutoff, FINE * cutoff)
    return float(0.5 * FINE * cutoff * np.sum(np.square(filter_.taps)))
