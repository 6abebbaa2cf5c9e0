"""Residuals far above the measurement noise: the model is incomplete, and what most likely."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from steelyard.diagnosis.causes import Cause, causes, wide_model
from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.diagnosis.zero_offset import correction, estimated_offsets, far_offsets, numbers
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.least_squares.sandwich import inflations
from steelyard.estimation.per_run import own_columns
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.regression.base import base_parameters
from steelyard.regression.regressor import base_regressor
from steelyard.validation.friction.mixes import remembers
from steelyard.validation.residuals import ResidualNoise, residual_noise

FAR = 2.0
"""Residual over the noise's upper bound from which on the model is incomplete."""

ABOVE = 1.5
"""Residual over noise from which on a joint is counted among those that are above it."""

LARGE = 10.0
"""Error of the fitted runs [%] from which on the noise is reported as unknown."""

SHARE = 0.2
"""Share of what noise does not explain from which on a cause is named."""

NAMED = 3
"""Most causes that are named."""

CLEAR = 1.5
"""How many times more than a lack of friction an error of the geometry or of an effort must
explain to be blamed: on five real robots friction explains more than any such error."""

LEAST, EACH = 25.0, 3.0
"""Chi square that it must explain, and more per column, over the factor by which the estimate
scatters more than by white residuals: a single column reaches 25 by noise once in a million."""

ALIKE = 0.8
"""Rank over the first's from which on another error is named beside it."""

MOST_RUNS, MOST_SAMPLES = 20, 200_000
"""Runs and samples that are looked at: more make no cause clearer, but take time."""

ADVICE = {
    "gain": "Check the gain and unit of this effort",
    "saturation": "Check the gain of this effort at large currents",
    "compliance": "Positions may be measured before an elastic gear",
}
"""What to do about a cause, by its kind; of the geometry otherwise."""

TRIED = "Try it, and keep it if the error on unseen motion falls"
"""What to do about a term that a model may lack."""

GEOMETRY = "Check the lengths and axes in the model file against the robot"


@dataclass(frozen=True, eq=False)
class Ranked:
    """Residuals of a fit, and what may explain them.

    Attributes:
        beside: Residuals and measurement noise.
        found: All causes, the most likely first.
        blamed: Errors of geometry or efforts that explain much more than a lack of friction.
        total: Chi square of the fit.
    """

    beside: ResidualNoise
    found: tuple[Cause, ...]
    blamed: tuple[Cause, ...]
    total: float


class ModelError:
    """Residuals over noise, and the causes in order."""

    name: ClassVar[str] = "model error"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding for all fitted runs: doubtful if an error of geometry or efforts stands out.

        None where residuals are noise, in `validate`, and for closed chains.
        """
        identified = case.identified
        if not case.fitted or not can_be_ranked(identified.model):
            return ()
        runs = beginnings(case.fitted)
        ranked = ranked_causes(identified.model, identified.estimate, runs)
        if ranked.blamed:
            return (_doubtful(identified.model, runs, ranked),)
        ratios = ranked.beside.ratios
        if not np.isfinite(ratios).any():
            return _not_looked_at(case, runs)
        return (_remark(ranked),) if float(np.nanmax(ratios)) >= FAR else ()


def can_be_ranked(model: Model) -> bool:
    """Whether causes have columns: an open chain with bodies."""
    return not model.robot.passive and model.has_bodies


def beginnings(runs: Sequence[Run]) -> tuple[Run, ...]:
    """At most `MOST_RUNS` runs, spread over all, and of each no more than makes `MOST_SAMPLES`."""
    step = -(-len(runs) // MOST_RUNS)
    chosen = runs[::step]
    most = MOST_SAMPLES / len(chosen)
    return tuple(
        replace(run, span=(run.span[0], min(run.span[1], run.span[0] + most / run.rate)))
        for run in chosen
    )


def ranked_causes(model: Model, estimate: Estimate, runs: Sequence[Run]) -> Ranked:
    """The causes of what a fit of runs leaves, and which of them stand out."""
    gains = runs[0].recording.signals.gains
    beside = residual_noise(model.at(estimate.values), runs, estimate.sigma, gains)
    wide = base_regressor(wide_model(model, estimate))
    information = information_from(runs, rests=remembers(model.terms))(wide)
    found = causes(model, information, estimate.sigma, beside.ratios)
    own = information.select(base_parameters(model).base_names)
    fit = WeightedLeastSquares(per_run=own_columns(model)).fit(own)
    blamed = _blamed(found, float(inflations(fit).max()))
    return Ranked(beside, found, blamed, float(information.n_samples.sum()))


def _blamed(found: Sequence[Cause], inflation: float) -> tuple[Cause, ...]:
    """Errors of geometry or efforts that explain much more than a lack of friction, best first."""
    terms = max((cause.rank for cause in found if cause.of_friction), default=0.0)
    others = [cause for cause in found if not cause.of_friction]
    if not others:
        return ()
    first = others[0]
    enough = LEAST + EACH * first.columns
    if first.chi2 / inflation < enough or first.rank < CLEAR * terms:
        return ()
    return tuple(cause for cause in others if cause.rank >= ALIKE * first.rank)[:NAMED]


def _remark(ranked: Ranked) -> Finding:
    """What stands beside the headline where no single error is to blame."""
    likely = _likely(ranked.found)
    says = f"{residuals(ranked.beside)}: the model is incomplete"
    if not likely:
        says += ", which the intervals do not cover, or the noise varies slowly"
    else:
        says += ", which the intervals do not cover"
        named = (
            f"{cause.says} {100.0 * cause.share:.0f} % by {cause.columns} parameter"
            + "s" * (cause.columns != 1)
            for cause in likely
        )
        says += f"; share explained by each candidate alone (not additive): {', '.join(named)}"
    brief = f"model incomplete, or the noise varies slowly: residuals {_worst(ranked.beside)}"
    if likely:
        first = likely[0]
        tried = TRIED if first.of_friction else ADVICE.get(first.kind, GEOMETRY)
        brief = (
            f"model incomplete: residuals {_worst(ranked.beside)}. Of single causes {first.says} "
            f"would explain most, {100.0 * first.share:.0f} %. {tried}"
        )
    return Finding(ModelError.name, "", Severity.OK, says, "", headline=True, brief=brief)


def _likely(found: Sequence[Cause]) -> tuple[Cause, ...]:
    """Causes that are named, the most likely first; the whole geometry only if no other is."""
    large = [cause for cause in found if cause.share >= SHARE]
    single = [cause for cause in large if cause.kind != "geometry"]
    return tuple(single or large)[:NAMED]


def _not_looked_at(case: FittedCase, runs: Sequence[Run]) -> tuple[Finding, ...]:
    """That residuals could not be compared with noise, where they are large."""
    errors = [score.pooled_percent or score.mean_percent for score in case.fitted_scores]
    error = max(errors, default=0.0)
    if not error > LARGE:
        return ()
    run = runs[0]
    says = (
        "residuals could not be compared with noise: the regression cut-off of "
        f"{run.matched_cutoff:g} Hz leaves no band above it at {run.rate:g} Hz, and the fitted "
        f"runs have errors up to {error:.0f} %"
    )
    return (Finding(ModelError.name, "", Severity.OK, says, "", headline=True),)


def _doubtful(model: Model, runs: Sequence[Run], ranked: Ranked) -> Finding:
    """An error that stands out; zero offsets with their values."""
    first = ranked.blamed[0]
    words = " or ".join(cause.says for cause in ranked.blamed)
    fix = Fix(ADVICE.get(first.kind, GEOMETRY))
    if first.kind == "zero_offset":
        offsets = estimated_offsets(model, runs)
        found = None if offsets is None else far_offsets(offsets)
        if offsets is not None and found is not None and found.any():
            words, fix = numbers(offsets, found), correction(offsets, found)
    says = "a model error that the intervals do not cover"
    return Finding(
        ModelError.name,
        "",
        Severity.DOUBTFUL,
        f"{residuals(ranked.beside)}: {says}, {words}",
        f"{100.0 * first.chi2 / ranked.total:.2g} % of chi²",
        joints=tuple(j for j in ranked.beside.joints if j == first.joint),
        fix=fix,
        brief=f"{words}: residuals {_worst(ranked.beside)}. {fix.says}",
    )


def residuals(beside: ResidualNoise) -> str:
    """The worst joint's residual in measurement noise."""
    if not np.isfinite(beside.ratios).any():
        return "residuals are not noise"
    worst = int(np.nanargmax(beside.ratios))
    above, known = (int(np.sum(test)) for test in (beside.ratios > ABOVE, beside.ratios > 0.0))
    return (
        f"residuals are up to {_times(beside)} x the measurement noise (worst joint: "
        f"{beside.joints[worst]}; {above} of {known} joints above {ABOVE:g} x)"
    )


def _times(beside: ResidualNoise) -> str:
    """The largest residual in measurement noise."""
    ratio = float(np.nanmax(beside.ratios))
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.1f}"


def _worst(beside: ResidualNoise) -> str:
    """The largest residual and its joint in a few words."""
    if not np.isfinite(beside.ratios).any():
        return "are not noise"
    joint = beside.joints[int(np.nanargmax(beside.ratios))]
    return f"up to {_times(beside)} x noise (largest: {joint})"
