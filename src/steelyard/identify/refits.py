"""The fit repeated: of each log alone, with other cut-offs, of resampled windows of time."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from steelyard.base.arguments import checked
from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.estimate_scatter import (
    FACTORS,
    RepeatedEstimates,
    Sensitivity,
    Variation,
    bootstrap,
)
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.identified import IdentifiedModel, load_model
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.nonlinear.fields import information_from
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.fit import Fit
from steelyard.identify.page.content import ReportContent
from steelyard.identify.page.scatter_of_estimates import repeated_table
from steelyard.identify.page.score_words import relative_errors
from steelyard.identify.scores import processing_of, scored
from steelyard.report.result import frame
from steelyard.report.tables import text_table
from steelyard.robot.file.signals import Signals
from steelyard.runs.defaults import MATCHED_HIGHEST, NYQUIST_SHARE, rounded
from steelyard.runs.named_logs import LogArgument, recording_of
from steelyard.runs.prepare import prepare
from steelyard.runs.processing import Processing
from steelyard.runs.run import Run

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, eq=False)
class Repeated:
    """Mean and scatter of repeated estimations; `print` it.

    Attributes:
        estimates: The estimates.
    """

    estimates: RepeatedEstimates

    @property
    def table(self) -> "DataFrame":
        """One row per parameter: mean, standard deviation, and one column per estimation."""
        return frame(flat_rows(self.estimates), "table")

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return self.estimates.to_dict()

    def csv(self) -> str:
        """The table as CSV."""
        return repeated_csv(self.estimates)

    def __str__(self) -> str:
        text = io.StringIO()
        shown = text_table(repeated_table(self.estimates), "Repeated estimations")
        Console(file=text, width=120).print(shown)
        return text.getvalue()


@checked()
def repeated(
    models: Sequence[str | Path | IdentifiedModel], *, population: bool = False
) -> Repeated:
    """Mean and relative standard deviation of the parameters of models identified one by one.

    Args:
        models: Two or more models of one robot: each a model, its `model.json`, or the folder that
            contains it.
        population: Whether standard deviations are those of the population (1/N) instead of the
            sample (1/(N - 1)).

    Raises:
        SteelyardError: A model cannot be read, there are fewer than two, or a parameter of the same
            name is another combination in one of them.

    Example:
        >>> found = repeated(["arm-model", "arm-model"])
        >>> found.table["std"].max()
        0.0
    """
    known = [load_model(model) for model in models]
    _refuse_other_groups(known)
    estimates = {str(number): model.estimate for number, model in enumerate(known, start=1)}
    return Repeated(RepeatedEstimates.of(estimates, population=population))


def _refuse_other_groups(models: Sequence[IdentifiedModel]) -> None:
    """A base parameter of one name is the same combination in all models.

    Raises:
        DataError: It is not.
    """
    groups: dict[str, str] = {}
    for number, model in enumerate(models, start=1):
        for k, name in enumerate(model.base.base_names):
            group = groups.setdefault(name, model.base.grouping(k))
            if group != model.base.grouping(k):
                raise DataError(
                    f"the base parameter '{name}' of model {number} is the combination "
                    f"{model.base.grouping(k)}, that of another one {group}",
                    where="repeated estimations",
                    fix="identify all models of the same robot with the same terms",
                )


def of_each_log(content: ReportContent, fit: Fit, progress: Progress) -> ReportContent:
    """What the report shows, with estimates from each log alone; notes on logs without one.

    Args:
        content: The report so far.
        fit: The result; laws, their fields and gains stay what they are.
        progress: Told about every log.
    """
    estimates, notes = dict[str, Estimate](), list[str]()
    for number, run in enumerate(fit.runs):
        report_progress(progress, "estimating from each log", number, len(fit.runs))
        own = [k for k, window in enumerate(fit.information.windows) if window.run == run.name]
        information = fit.information.of(own)
        try:
            estimates[run.name] = fit.estimating((run,), information)(information)
        except DataError as error:
            notes.append(f"no estimate from {run.name} alone: {error.wrong}")
    try:
        found = RepeatedEstimates.of(estimates)
    except DataError as error:
        notes.append(f"no scatter over logs: {error.wrong}")
        return replace(content, notes=(*content.notes, *notes))
    return replace(content, repeated=found, notes=(*content.notes, *notes))


def flat_rows(found: RepeatedEstimates) -> list[dict[str, Any]]:
    """One row per parameter, one column per estimation."""
    return [
        {key: value for key, value in row.items() if key != "values"}
        | dict(zip(found.labels, row["values"], strict=True))
        for row in found.rows()
    ]


def repeated_csv(found: RepeatedEstimates) -> str:
    """The rows as CSV."""
    text = io.StringIO()
    rows = flat_rows(found)
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


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
        runs, rests=has_memory(model.terms), threads=threads, progress=progress
    )
    information = information_of(base_regressor(model))
    estimate = fit.estimating(runs, information)(information)
    again = replace(identified, estimate=estimate)
    return replace(fit, identified=again, runs=tuple(runs), information=information)


def _error(scores: Sequence[RunScore]) -> float | None:
    """The error that the verdict's headline gives, of these runs [%]."""
    return relative_errors(scores)[0].value if scores else None


def with_bootstrap(
    content: ReportContent, fit: Fit, draws: int, progress: Progress
) -> ReportContent:
    """What the report shows, with the draws beside it; a note where the data are too few for it.

    Args:
        content: The report so far.
        fit: The result.
        draws: How often windows are drawn.
        progress: Told about every draw.
    """
    if fit.method.needs != "information":
        of = "samples" if fit.method.needs == "samples" else "whole runs"
        why = f"{fit.method.name} needs {of}, which cannot be resampled"
        return replace(content, notes=(*content.notes, f"no bootstrap: {why}"))
    try:
        found = bootstrap(fit.estimator, fit.information, draws=draws, progress=progress)
    except DataError as error:
        return replace(content, notes=(*content.notes, f"no bootstrap: {error.wrong}"))
    return replace(content, bootstrap=found)
