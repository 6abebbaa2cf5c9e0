r"""Bands of predicted efforts, calibrated on motion that the fit did not see.

Every run is left out in turn, the others are fitted, and the left-out run is predicted: its errors
$e$ in the standard deviations $s$ of the prediction hold noise, model error, drift from run to run
and extrapolation alike. Where all runs are of one motion, stretches of it are left out instead.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError, LogError
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
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.scores.cross_validation import (
    FOLDS,
    LeftOut,
    runs_left_out,
    stretches_left_out,
)
from steelyard.estimate.scores.parts_and_bands_along_run import Bands
from steelyard.estimate.scores.residual_noise_and_traces import (
    ResidualTrace,
    residual_cutoff,
    residual_trace,
)
from steelyard.estimate.scores.score import score
from steelyard.runs.prepare import rest_speed_of_runs
from steelyard.runs.run import Run

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
    chosen = runs_left_out(runs, information)[:MOST_RUNS_LEFT_OUT]
    if len(chosen) < FEWEST_STRETCHES:
        kind, model = "stretches", identified.model
        longest = max(run.duration for run in runs) / (PER_STRETCH * FOLDS)
        if any(window.stop - window.start > longest for window in information.windows):
            rests, regressor = model.has_memory, base_regressor(model)
            information = information_from(
                runs, rests=rests, longest=longest, threads=threads, progress=progress
            )(regressor)
        chosen = stretches_left_out(runs, information)
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
    one: LeftOut,
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
