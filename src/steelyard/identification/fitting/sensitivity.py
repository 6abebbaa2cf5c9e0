"""`steelyard identify --sensitivity`: the same model fitted with other cut-offs."""

from collections.abc import Sequence
from dataclasses import replace

from steelyard.errors import LogError
from steelyard.estimation.fields.fields import information_from
from steelyard.identification.fitting.fitting import Fit
from steelyard.identification.logs import processing_of, scored
from steelyard.identification.named_logs import LogArgument, recording_of
from steelyard.measurement import Processing, Run, prepare
from steelyard.measurement.defaults import MATCHED_HIGHEST, NYQUIST_SHARE, rounded
from steelyard.progress import Progress
from steelyard.regression.regressor import base_regressor
from steelyard.report import ReportContent
from steelyard.report.text.score_words import relative_errors
from steelyard.robot_file.signals import Signals
from steelyard.validation.friction.mixes import remembers
from steelyard.validation.score import RunScore
from steelyard.validation.sensitivity import FACTORS, Sensitivity, Variation


def varied(
    content: ReportContent,
    fit: Fit,
    logs: tuple[Sequence[LogArgument], Sequence[LogArgument]],
    threads: int,
    progress: Progress,
    *,
    commanded: bool = False,
) -> ReportContent:
    """What the report shows, with the fits beside it; `logs` are those fitted and those not.

    The latter are predicted from their commanded motion if `commanded`.
    """
    scores, signals = (content.fitted, content.scores), fit.identified.signals
    unseen = signals.of_commanded() if commanded else signals
    return replace(content, sensitivity=sensitivity(fit, *logs, unseen, scores, threads, progress))


def sensitivity(
    fit: Fit,
    fitted: Sequence[LogArgument],
    unseen: Sequence[LogArgument],
    signals: Signals,
    scores: tuple[Sequence[RunScore], Sequence[RunScore]],
    threads: int,
    progress: Progress,
) -> Sensitivity:
    """Fit again with cut-offs lower and higher than those of the result.

    Laws, their fields, gains and the cut-off of scores stay what they are.

    Args:
        fit: The result.
        fitted: Logs that were fitted.
        unseen: Logs that were not.
        signals: Columns of the latter.
        scores: The result's, on both.
        threads: Native threads.
        progress: Told about every pass.
    """
    known, new = (_error(some) for some in scores)
    identified = fit.identified
    now = identified.cutoffs
    estimate = identified.estimate
    result = Variation(1.0, now.motion, now.matched, estimate.parameters.values, known, new)
    rate = min(run.rate for run in fit.runs)
    variations = []
    for factor in FACTORS:
        motion = rounded(min(factor * now.motion, NYQUIST_SHARE * rate))
        matched = rounded(min(factor * now.matched, MATCHED_HIGHEST * rate, motion))
        other = replace(processing_of(identified), motion_cutoff=motion, matched_cutoff=matched)
        try:
            same = replace(other, repetitions=identified.processing.repetitions)
            again = _refitted(fit, fitted, same, threads, progress)
            runs = [
                *again.runs,
                *(prepare(recording_of(log, signals), other) for log in unseen),
            ]
            of_runs = scored(again.identified, runs, progress)
        except LogError as error:
            variations.append(Variation(factor, motion, matched, None, failed=error.wrong))
            continue
        values = again.identified.estimate.parameters.values
        known, new = _error(of_runs[: len(fitted)]), _error(of_runs[len(fitted) :])
        variations.append(Variation(factor, motion, matched, values, known, new))
    return Sensitivity(estimate.parameters, estimate.std, result, tuple(variations))


def _refitted(
    fit: Fit,
    logs: Sequence[LogArgument],
    processing: Processing,
    threads: int,
    progress: Progress,
) -> Fit:
    """The fit with the same model and other cut-offs."""
    identified = fit.identified
    model, signals = identified.model, identified.signals
    runs: list[Run] = []
    for log, before in zip(logs, fit.runs, strict=True):
        runs.append(replace(prepare(recording_of(log, signals), processing), name=before.name))
    information_of = information_from(
        runs, rests=remembers(model.terms), threads=threads, progress=progress
    )
    information = information_of(base_regressor(model))
    estimate = fit.estimating(runs, information)(information)
    again = replace(identified, estimate=estimate)
    return replace(fit, identified=again, runs=tuple(runs), information=information)


def _error(scores: Sequence[RunScore]) -> float | None:
    """The error that the verdict's headline gives, of these runs [%]."""
    return relative_errors(scores)[0].value if scores else None
