r"""Residuals beside the measurement noise, behind a low-pass, and thresholds of contact.

The residuals of a fit went through the parallel filter. What the motion demands ends at its band;
above it, the spectrum of measured minus predicted effort holds noise: that of the effort, and of
the measured motion as far as its own filter lets it through. Noise that is white keeps
$\sum_k h_k^2$ of its variance behind the filter, with $h$ its taps. Taken from the loudest octave
above the band, resonances and the tails of model errors included, it is an upper bound: residuals
are at least that many times the noise.

Measured minus predicted effort goes through $\dot r = 2\pi f\,(\tau - \hat\tau - r)$, the filter of
a momentum observer [DeLuca2005]: no sample waits for later efforts. Motion comes from the log's
processing. Where a joint rests, its friction lies anywhere in a dead zone: laws without memory then
predict none, instead of one of either sign by the noise of the velocity.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, by_key, frozen
from steelyard.base.errors import DataError, LogError
from steelyard.base.motion import Motion
from steelyard.estimate.external.contact_thresholds import (
    FEWEST,
    HOLD,
    SETTLED,
    ContactThresholds,
    ResidualPeaks,
    changes_at_rest,
    low_passed,
    peaks_of,
    ranges_of,
)
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.gather import blocks_with_channels
from steelyard.estimate.scores.parts_and_bands_along_run import PARTS, TorqueSplit
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
        blocks = residual_blocks(valued, run, gains)
        stretches = by_key((block.segment, rest) for block, _, rest in blocks)
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


MOST_KEPT = 5000  # samples of a run that are kept at most
LEAST_RATE = 10.0  # least sampling rate over the cut-off of the residual's low-pass

GRAVITY, FRICTION = PARTS.index("gravity"), PARTS.index("friction")

FORGOTTEN = 5.0  # time constants of the low-pass after which it has forgotten its start; as much is
# left out at the end, where derivatives are those of a signal that stops


@dataclass(frozen=True, eq=False)
class ResidualTrace:
    """Residuals of a run; of a fast log every k-th sample, at `LEAST_RATE` cut-offs or more.

    What friction with memory is at rest depends on motion before the log: it is not in `parts`.
    """

    run: str
    t: Array  # time, shape `(N,)` [s]; steps of more than twice `step` are gaps
    step: float  # time between samples [s]
    residual: Array  # measured minus predicted effort, low-passed, shape `(n, N)` [Nm; N]
    slowest: Array  # least speed in the last `HOLD` seconds, `(n, N)` [rad/s; m/s]
    fastest: Array  # greatest speed in the last `SETTLED` seconds, likewise
    measured: Array  # measured effort, low-passed likewise, shape `(n, N)` [Nm; N]
    parts: Array  # predicted gravity, friction of moving joints, likewise `(2, n, N)` [Nm; N]

    @property
    def duration(self) -> float:
        """Time without gaps [s]."""
        return len(self.t) * self.step

    def of(self, chosen: NDArray[np.bool_] | slice) -> "ResidualTrace":
        """Some of the samples."""
        names = ("t", "residual", "slowest", "fastest", "measured", "parts")
        return replace(self, **{name: getattr(self, name)[..., chosen] for name in names})

    def without(self, joints: Sequence[int]) -> "ResidualTrace":
        """The same with NaN as the residual of some joints."""
        residual = self.residual.copy()
        residual[list(joints)] = np.nan
        return replace(self, residual=residual)

    def peaks(self, edges: Array, cutoff: float) -> ResidualPeaks:
        """Its largest residuals per visit to a range of speed; see `peaks_of`."""
        return peaks_of(self.t, self.residual, self.ranges(edges), self.step, edges, cutoff)

    def ranges(self, edges: Array) -> NDArray[np.intp]:
        """Range of speed of every joint, shape `(n, N)`; see `ranges_of`."""
        return ranges_of(self.slowest, self.fastest, edges)

    def changes(self, edges: Array) -> Array:
        """Change of the residual where all joints rest, shape `(n, N)`; see `changes_at_rest`."""
        return changes_at_rest(self.t, self.residual, self.ranges(edges), self.step)


def residual_cutoff(identified: IdentifiedModel, runs: Sequence[Run]) -> float:
    """Low-pass of the residual that all runs are sampled fast enough for [Hz]."""
    return min(identified.cutoffs.score, *(run.rate / LEAST_RATE for run in runs))


def residual_trace(
    identified: IdentifiedModel, run: Run, cutoff: float, *, at_rest: bool = True
) -> ResidualTrace:
    """The residual of a run behind a low-pass [Hz].

    With `at_rest` the rests before the first and after the last motion are looked at too.
    """
    if run.rate < LEAST_RATE * cutoff * (1.0 - 1e-6):
        raise LogError(
            f"the log is sampled with {run.rate:.3g} Hz, less than {LEAST_RATE:g} times the "
            f"residual's low-pass of {cutoff:.3g} Hz",
            where=run.name,
            fix=f"log with {LEAST_RATE * cutoff:.0f} Hz or more",
        )
    whole = replace(run, span=(-np.inf, np.inf)) if at_rest else run
    every = max(1, int(run.rate / (LEAST_RATE * cutoff)))
    split, gains = TorqueSplit(identified.valued), identified.signals.gains[:, None]
    found = []
    for _, blocks in groupby(
        blocks_with_channels(whole.blocks(), identified.model), key=lambda b: b.segment
    ):
        parts = []
        for block in blocks:
            predicted = split.block(block)
            predicted[FRICTION] *= block.moving | identified.model.has_memory
            measured = gains * block.effort
            residual = measured - predicted.sum(axis=0)
            sliding = predicted[FRICTION] * block.moving
            kept = np.stack([residual, measured, predicted[GRAVITY], sliding])
            parts.append((block.t, kept, block.dq))
        t, signals, dq = (np.concatenate(some, axis=-1) for some in zip(*parts, strict=True))
        first = int(FORGOTTEN / (2.0 * np.pi * cutoff) * run.rate)
        at = slice(first, len(t) - first, every)
        slowest = -greatest(-np.abs(dq), round(HOLD * run.rate) + 1)[:, at]
        fastest = greatest(np.abs(dq), round(SETTLED * run.rate) + 1)[:, at]
        low = low_passed(signals, cutoff, run.rate)[..., at]
        found.append((t[at], low, slowest, fastest))
    if not sum(len(one[0]) for one in found):
        raise LogError(
            "no segment of the log is long enough for the residual's low-pass",
            where=run.name,
            fix="log for longer, or give a higher cut-off",
        )
    t, low, slowest, fastest = (np.concatenate(some, axis=-1) for some in zip(*found, strict=True))
    return ResidualTrace(run.name, t, every / run.rate, low[0], slowest, fastest, low[1], low[2:])


def greatest(values: Array, samples: int) -> Array:
    """Greatest of this and the samples before it, `samples` in all."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(values, samples, axis=1, origin=(samples - 1) // 2))


SLID = 0.1  # travel after which friction with memory slides, at least [rad; m]


def sliding_friction(identified: IdentifiedModel, speed: Array) -> Array:
    """Largest predicted friction of each joint at a low speed, shape `(n,)` each [Nm; N]."""
    t = np.linspace(0.0, SLID / float(np.min(speed)), 400)
    there = np.concatenate([t, t[::-1]])[:, None] * speed
    dq = np.repeat([1.0, -1.0], len(t))[:, None] * speed
    along = Motion(np.arange(len(there)) * t[1], there, dq, np.zeros_like(there))
    return np.asarray(np.abs(identified.friction(along)).max(axis=0))


ROUNDED = 0.95  # of the least rate that is refused: the least is printed with two digits


def supported_rate(peaks: ResidualPeaks, wanted: float | None) -> float:
    """False alarms per hour to use: those wanted, or the usual, or the least that is supported."""
    least = peaks.lowest_rate
    if not (peaks.visits >= FEWEST).any():
        raise DataError(
            f"{peaks.duration:.3g} s of free motion are too short to calibrate thresholds with",
            where="calibration of contact thresholds",
            fix="give longer logs of motion without contact with --calibrate",
        )
    if wanted is None:
        return max(1.0, least)
    if wanted < ROUNDED * least:
        minutes = peaks.duration / 60.0
        raise DataError(
            f"{wanted:.3g} false alarms per hour cannot be claimed from {minutes:.1f} min of free "
            f"motion: it supports {least:.2g} per hour or more",
            where="--rate",
            fix=f"ask for {least:.2g} or more, or calibrate with "
            f"{minutes * least / wanted:.0f} min of free motion",
        )
    return wanted


def thresholds_of(
    identified: IdentifiedModel, peaks: ResidualPeaks, rate: float | None
) -> ContactThresholds:
    """Thresholds for a rate of false alarms per hour, or for the usual one."""
    friction = sliding_friction(identified, peaks.edges[:, 1])
    return peaks.thresholds(supported_rate(peaks, rate), friction)
