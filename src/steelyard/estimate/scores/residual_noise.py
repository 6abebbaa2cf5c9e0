r"""Residuals beside the measurement noise, both behind the parallel filter.

The residuals of a fit went through the parallel filter. What the motion demands ends at its band;
above it, the spectrum of measured minus predicted effort holds noise: that of the effort, and of
the measured motion as far as its own filter lets it through. Noise that is white keeps
$\sum_k h_k^2$ of its variance behind the filter, with $h$ its taps. Taken from the loudest octave
above the band, resonances and the tails of model errors included, it is an upper bound: residuals
are at least that many times the noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.information.gather import blocks_with_channels
from steelyard.estimate.information.parallel_filter import ParallelFilter
from steelyard.model.model import ValuedModel
from steelyard.runs.run import Block, Run
from steelyard.runs.spectrum_and_period import welch

CLEAR = 2.0  # frequencies from that many regression cut-offs on hold none of what is fitted
TOP = 0.4  # share of the sampling rate up to which the spectrum is read: resampling bends it above
SPECTRUM = 4.0  # length of the spectrum's windows [s]
LINES = 4  # least number of frequencies of a band
LONGEST = 60.0  # time of each run that is looked at [s]


@dataclass(frozen=True, eq=False)
class ResidualNoise:
    """Residuals and measurement noise behind the parallel filter."""

    joints: tuple[str, ...]
    residual: Array  # standard deviation of the residuals, shape `(n,)` [Nm; N]
    noise: Array  # upper bound, shape `(n,)`; NaN where no band above the motion's tells it

    @property
    def ratios(self) -> Array:
        """Residual over noise, at least, shape `(n,)`; NaN where the noise is not known."""
        known = np.isfinite(self.noise) & (self.noise > 0.0)
        return np.where(known, self.residual / np.where(known, self.noise, 1.0), np.nan)


def residual_noise(
    valued: ValuedModel, runs: Sequence[Run], sigma: Array, gains: Array
) -> ResidualNoise:
    """Measurement noise of runs behind their parallel filter, beside the residuals of a fit."""
    variances, seconds = np.zeros(len(gains)), 0.0
    for run in runs:
        taps = ParallelFilter.design(run.matched_cutoff, run.rate).taps
        stretches: dict[int, list[Array]] = {}
        for block, _, rest in residual_blocks(valued, run, gains):
            stretches.setdefault(block.segment, []).append(rest)
        longest = max(stretches.values(), key=lambda parts: sum(p.shape[1] for p in parts))
        density = noise_floor(np.concatenate(longest, axis=1), run.rate, run.matched_cutoff)
        least = np.square(np.asarray(run.quality.effort_resolution) * gains) / 12.0
        own = np.fmax(0.5 * run.rate * density, np.where(np.isnan(density), np.nan, least))
        variances += own * np.sum(np.square(taps)) * run.duration
        seconds += run.duration
    noise = np.sqrt(variances / seconds)
    return ResidualNoise(valued.model.robot.joint_names, frozen(sigma), frozen(noise))


def residual_blocks(
    valued: ValuedModel, run: Run, gains: Array
) -> Iterator[tuple[Block, Array, Array]]:
    """Blocks of the first `LONGEST` seconds, with predicted efforts and residuals, `(n, B)`."""
    start: float | None = None
    for block in blocks_with_channels(run.blocks(), valued.model):
        start = float(block.t[0]) if start is None else start
        if block.t[0] - start > LONGEST:
            return
        predicted = valued.block(block.q, block.dq, block.ddq, block.channels)
        yield block, predicted, gains[:, None] * block.effort - predicted


def noise_floor(signals: Array, rate: float, cutoff: float) -> Array:
    """Largest noise density above a band, one-sided, shape `(n,)`; NaN where nothing is above.

    Of octaves from `CLEAR` times the cut-off to `TOP` times the rate [Hz], the median density of
    the loudest. Signals have the shape `(n, N)`.
    """
    frequency, density = welch(signals, rate, SPECTRUM)
    best, low = np.full(len(signals), np.nan), CLEAR * cutoff
    while low < TOP * rate:
        high = min(2.0 * low, TOP * rate)
        inside = (frequency >= low) & (frequency < high)
        if inside.sum() >= LINES:
            best = np.fmax(best, np.median(density[:, inside], axis=1))
        low = high
    return best
