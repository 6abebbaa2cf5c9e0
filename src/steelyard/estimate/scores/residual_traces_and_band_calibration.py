r"""Residuals beside the noise, their traces and contact thresholds; bands by left-out motion.

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

For bands of predicted efforts, every run is left out in turn, the others are fitted, and the
left-out run is predicted: its errors $e$ in the standard deviations $s$ of the prediction hold
noise, model error, drift from run to run and extrapolation alike. Where all runs are of one motion,
stretches of it are left out instead.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from itertools import groupby
from operator import add

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array, by_key, frozen
from steelyard.base.errors import DataError, LogError
from steelyard.base.motion import Motion
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.covariance_and_band_widths import (
    BINS,
    EDGES,
    Calibration,
    Kind,
    bins,
    rest_speed_of,
)
from steelyard.estimate.estimate import Estimator
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
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.gather import blocks_with_channels
from steelyard.estimate.information.information import Information
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.scores import cross_validation
from steelyard.estimate.scores.parts_and_bands_along_run import PARTS, Bands, TorqueSplit
from steelyard.estimate.scores.score import score
from steelyard.model.model import ValuedModel
from steelyard.runs.prepare import rest_speed_of_runs
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
        explained = run.with_forces(block, predicted / gains[:, None])
        yield block, predicted, gains[:, None] * (block.effort - explained)


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
            explained = run.with_forces(block, predicted.sum(axis=0) / gains)
            residual = measured - gains * explained
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
        wrong = "no segment of the log is long enough for the residual's low-pass"
        fix = "log for longer, or give a higher cut-off"
        raise LogError(wrong, where=run.name, fix=fix)
    t, low, slowest, fastest = (np.concatenate(some, axis=-1) for some in zip(*found, strict=True))
    return ResidualTrace(run.name, t, every / run.rate, low[0], slowest, fastest, low[1], low[2:])


def greatest(values: Array, samples: int) -> Array:
    """Greatest of this and the samples before it, `samples` in all."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(values, samples, axis=1, origin=(samples - 1) // 2))


SLID = 0.1  # travel after which friction with memory slides, at least [rad; m]


ROUNDED = 0.95  # of the least rate that is refused: the least is printed with two digits


def supported_rate(peaks: ResidualPeaks, wanted: float | None) -> float:
    """False alarms per hour to use: those wanted, or the usual, or the least that is supported."""
    least = peaks.lowest_rate
    if not (peaks.visits >= FEWEST).any():
        wrong = f"{peaks.duration:.3g} s of free motion are too short to calibrate thresholds with"
        fix = "give longer logs of motion without contact with --calibrate"
        raise DataError(wrong, where="calibration of contact thresholds", fix=fix)
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
    """Thresholds for a rate of false alarms per hour, or for the usual one.

    Friction is the largest that the model predicts of each joint at a low speed.
    """
    speed = peaks.edges[:, 1]
    t = np.linspace(0.0, SLID / float(np.min(speed)), 400)
    there = np.concatenate([t, t[::-1]])[:, None] * speed
    dq = np.repeat([1.0, -1.0], len(t))[:, None] * speed
    along = Motion(np.arange(len(there)) * t[1], there, dq, np.zeros_like(there))
    friction = np.asarray(np.abs(identified.friction(along)).max(axis=0))
    return peaks.thresholds(supported_rate(peaks, rate), friction)


LEVEL = 0.95  # share of new measurements that a band holds
FEWEST_STRETCHES = 2  # stretches that must be left out
ENOUGH = 40.0  # independent samples that a range of speeds needs for a factor of its own
MOST_RUNS_LEFT_OUT = 20  # runs that are left out at most
LEAST_CORRELATION = 0.02  # least eigenvalue of the correlation of errors between joints
PER_STRETCH = 8.0  # windows per stretch


def calibrate(
    identified: IdentifiedModel,
    runs: Sequence[Run],
    information: Information,
    estimator: Estimator[Information],
    *,
    threads: int = 1,
    progress: Progress = silent,
) -> Calibration | None:
    """95 % bands from runs, or stretches, left out in turn; `None` where less than two can be."""
    kind: Kind = "runs"
    chosen = cross_validation.runs_left_out(runs, information)[:MOST_RUNS_LEFT_OUT]
    if len(chosen) < FEWEST_STRETCHES:
        kind, model = "stretches", identified.model
        longest = max(run.duration for run in runs) / (PER_STRETCH * cross_validation.FOLDS)
        if any(window.stop - window.start > longest for window in information.windows):
            rests, regressor = model.has_memory, base_regressor(model)
            information = information_from(
                runs, rests=rests, longest=longest, threads=threads, progress=progress
            )(regressor)
        chosen = cross_validation.stretches_left_out(runs, information)
    found, cutoff = [], residual_cutoff(identified, runs)
    for number, one in enumerate(chosen):
        report_progress(progress, "calibrating bands", number, len(chosen))
        if left_out := _errors(identified, runs, information, estimator, one):
            found.append(left_out)
    if len(found) < FEWEST_STRETCHES:
        return None
    *samples, traces = zip(*found, strict=True)
    errors, speed, moving, worth = (np.concatenate(some, axis=-1) for some in samples)
    edges = np.sqrt(np.mean(np.square(speed), axis=1))[:, None] * EDGES
    at = bins(speed, moving, edges)
    factors = [_factors(*row, worth) for row in zip(np.abs(errors), at, strict=True)]
    correlation = correlation_of(errors, worth)
    calibration = Calibration(kind, len(found), edges, np.array(factors), correlation=correlation)
    usual = rest_speed_of(identified.robot.n, calibration, identified.processing.rest_speed)
    rest_speed = rest_speed_of_runs([run.rest_speed for run in runs], usual)
    meet = np.maximum(np.column_stack([rest_speed, calibration.edges]), rest_speed[:, None])
    peaks = []
    for trace in traces:
        with suppress(DataError, LogError):  # too short for the low-pass, or a loop cannot close
            peaks.append(trace(rest_speed, cutoff).peaks(meet, cutoff))
    return replace(calibration, peaks=reduce(add, peaks)) if peaks else calibration


def _errors(
    identified: IdentifiedModel,
    runs: Sequence[Run],
    information: Information,
    estimator: Estimator[Information],
    one: cross_validation.LeftOut,
) -> tuple[Array, Array, NDArray[np.bool_], Array, Callable[[Array, float], ResidualTrace]] | None:
    """How a fit to all else predicts a stretch; `None` where it cannot.

    Errors in standard deviations, speeds, and whether joints move, `(n, N)`; how many independent
    samples each is worth, `(N,)`; residuals, from rest speeds and the cut-off of their low-pass.
    Errors and residuals are NaN of joints that cannot be predicted. Of a run that is left out as a
    whole, rests around the motion have residuals too.
    """
    run = runs[one.run]
    whole = one.span == run.span
    run = replace(run, span=one.span)
    try:
        estimate = estimator(information.of(one.fitted))
        other = replace(identified, estimate=estimate, calibration=None)
        gains, band = other.signals.gains, identified.cutoffs.score
        traces = score(other.valued, run, gains, band, bands=Bands.of(other)).traces
    except (DataError, LogError):
        return None
    if traces.band is None or traces.speed is None:
        return None
    errors = Z95 * (traces.measured - traces.predicted) / traces.band
    errors *= np.sign(identified.signals.gains)
    # rows with a parameter that all runs show and the fitted part does not
    absent = set(identified.estimate.parameters.names) - set(estimate.parameters.names)
    layout = information.layout
    blind = [
        row
        for row, seen in enumerate(layout.sees)
        if not absent.isdisjoint(layout.columns[k] for k in seen)
    ]
    errors[:, blind] = np.nan
    duration = one.span[1] - one.span[0]
    count = len(traces.t)
    worth = np.full(count, min(1.0, 2.0 * band * duration / max(count, 1)))

    def trace(rest_speed: Array, cutoff: float) -> ResidualTrace:
        known = residual_trace(other, replace(run, rest_speed=rest_speed), cutoff, at_rest=whole)
        return known.without(blind)

    return errors.T, traces.speed.T, traces.moving.T, worth, trace


def correlation_of(errors: Array, worth: Array) -> Array:
    """Correlation of errors between joints, `(n, n)`, towards none as samples are few."""
    n = len(errors)
    known = np.isfinite(errors)
    pairs = (known * worth) @ known.T
    sums = (np.where(known, errors, 0.0) * worth) @ np.where(known, errors, 0.0).T
    squares = np.where(known, np.square(errors), 0.0) * worth @ known.T
    scale = np.sqrt(squares * squares.T)
    found = np.divide(sums, scale, out=np.zeros((n, n)), where=scale > 0.0)
    found *= pairs / (pairs + n)
    np.fill_diagonal(found, 1.0)
    values, vectors = np.linalg.eigh(found)
    found = vectors * np.maximum(values, LEAST_CORRELATION) @ vectors.T
    scale = np.sqrt(np.diag(found))
    return np.asarray(found / np.outer(scale, scale))


def _factors(sizes: Array, at: NDArray[np.intp], worth: Array) -> Array:
    """Factors of one joint; at speeds with few samples that of all, at rest no less than slow."""
    known = np.isfinite(sizes)
    if not known.any():
        return np.full(BINS, Z95)
    factors = np.full(BINS, quantile(sizes[known], float(worth[known].sum())))
    for number in range(BINS):
        mine = known & (at == number)
        if worth[mine].sum() >= ENOUGH:
            factors[number] = quantile(sizes[mine], float(worth[mine].sum()))
    if worth[known & (at == 0)].sum() < ENOUGH:
        factors[0] = max(factors[0], factors[1])
    return factors


def quantile(sizes: Array, independent: float) -> float:
    """The size that a new one exceeds in 5 % of cases; of few independent sizes, a larger one."""
    level = min(1.0, LEVEL * (1.0 + 1.0 / max(independent, 1.0)))
    return max(float(np.quantile(sizes, level)), np.finfo(np.float64).tiny)
