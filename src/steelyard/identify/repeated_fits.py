"""The fit repeated: of each log, of windows drawn again, with other cut-offs; scatter of models."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, LogError
from steelyard.base.files import csv_text
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate import parameter_status_bootstrap_and_sensitivity as repeating
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.fit import EstimatorOf, Fit
from steelyard.identify.page.conditioning_correlations_and_repeats import repeated_table
from steelyard.identify.page.report_content_and_error_words import relative_errors
from steelyard.identify.runs_and_notes_of_logs import processing_of
from steelyard.identify.scores_and_model_report import ModelReport, scored
from steelyard.report.result import DataFrame, frame
from steelyard.report.tables import text_table
from steelyard.report.terminal import terminal
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import MATCHED_HIGHEST, NYQUIST_SHARE, rounded
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import LogArgument, recording_of


@dataclass(frozen=True, eq=False)
class Repeated:
    """Mean and scatter of repeated estimations; `print` it."""

    estimates: repeating.RepeatedEstimates

    @property
    def table(self) -> DataFrame:
        """One row per parameter: mean, standard deviation, and one column per estimation."""
        return frame(self._rows(), "table")

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return self.estimates.to_dict()

    def csv(self) -> str:
        """The table as CSV."""
        rows = self._rows()
        return csv_text([rows[0], *(row.values() for row in rows)])

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {key: value for key, value in row.items() if key != "values"}
            | dict(zip(self.estimates.labels, row["values"], strict=True))
            for row in self.estimates.rows()
        ]

    def __str__(self) -> str:
        text = io.StringIO()
        shown = text_table(repeated_table(self.estimates), "Repeated estimations")
        terminal(file=text, width=120).print(shown)
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
    estimates: dict[str, Estimate] = {}
    groups: dict[str, str] = {}
    for number, identified in enumerate(map(load_model, models), start=1):
        estimates[str(number)] = identified.estimate
        for k, name in enumerate(identified.base.base_names):
            group, own = groups.get(name), identified.base.grouping(k)
            if groups.setdefault(name, own) != own:
                raise DataError(
                    f"the base parameter '{name}' of model {number} is the combination {own}, that "
                    f"of another one {group}",
                    where="repeated estimations",
                    fix="identify all models of the same robot with the same terms",
                )
    return Repeated(repeating.RepeatedEstimates.of(estimates, population=population))


class ReportOfLogs(ModelReport):
    """A model with its scores, and the estimates from each log alone if they were asked for."""

    @property
    def repeated(self) -> Repeated | None:
        """Mean and scatter of the estimates from each log alone, if they were asked for."""
        found = self.content.repeated
        return None if found is None else Repeated(found)

    def write(self, folder: Path) -> None:
        """Write `model.json`, `parameters.csv`, `report.html`; with `each` also `repeated.csv`."""
        super().write(folder)
        if self.repeated is not None:
            (folder / "repeated.csv").write_text(self.repeated.csv(), encoding="utf-8")


def of_each_log(
    runs: Sequence[Run], data: Information, estimating: EstimatorOf, progress: Progress
) -> tuple[repeating.RepeatedEstimates | None, tuple[str, ...]]:
    """Estimates from each log alone, with all else as for the runs together; notes on failures."""
    estimates, notes = dict[str, Estimate](), list[str]()
    for number, run in enumerate(runs):
        report_progress(progress, "estimating from each log", number, len(runs))
        information = data.of(data.windows_of_runs[run.name])
        try:
            estimates[run.name] = estimating((run,), information)(information)
        except DataError as error:
            notes.append(f"no estimate from {run.name} alone: {error.wrong}")
    try:
        return repeating.RepeatedEstimates.of(estimates), tuple(notes)
    except DataError as error:
        return None, (*notes, f"no scatter over logs: {error.wrong}")


def fits_with_other_cutoffs(
    fit: Fit,
    fitted: Sequence[LogArgument],
    unseen: Sequence[LogArgument],
    signals: Signals,
    scores: tuple[Sequence[RunScore], Sequence[RunScore]],
) -> repeating.Sensitivity:
    """Fit again with cut-offs lower and higher than those of the result.

    Laws, their fields, gains and the cut-off of scores stay what they are. The `signals` are the
    columns of the unseen logs, the `scores` the result's on the fitted logs and on the unseen ones.
    """
    identified, model, now = fit.identified, fit.identified.model, fit.identified.cutoffs
    stated, (known, new) = identified.estimate, map(_error, scores)
    result = repeating.Variation(1.0, now.motion, now.matched, stated.parameters.values, known, new)
    rate = min(run.rate for run in fit.fitted.runs)
    variations = []
    for factor in repeating.FACTORS:
        motion = rounded(min(factor * now.motion, NYQUIST_SHARE * rate))
        matched = rounded(min(factor * now.matched, MATCHED_HIGHEST * rate, motion))
        if not identified.processing.parallel_filter:
            matched = now.matched
        other = replace(processing_of(identified), motion_cutoff=motion, matched_cutoff=matched)
        try:
            same = replace(other, repetitions=identified.processing.repetitions)
            runs = tuple(
                replace(prepare(recording_of(log, identified.signals), same), name=before.name)
                for log, before in zip(fitted, fit.fitted.runs, strict=True)
            )
            information = fit.task.information_of(model, runs)(base_regressor(model))
            estimate = fit.fitted.estimating(runs, information)(information)
            again = replace(identified, estimate=estimate)
            runs += tuple(prepare(recording_of(log, signals), other) for log in unseen)
            of_runs = scored(again, runs, fit.task.progress)
        except LogError as error:
            variations.append(
                repeating.Variation(factor, motion, matched, None, failed=error.wrong)
            )
            continue
        known, new = _error(of_runs[: len(fitted)]), _error(of_runs[len(fitted) :])
        values = estimate.parameters.values
        variations.append(repeating.Variation(factor, motion, matched, values, known, new))
    return repeating.Sensitivity(stated.parameters, stated.std, result, tuple(variations))


def _error(scores: Sequence[RunScore]) -> float | None:
    """The error that the verdict's headline gives, of these runs [%]."""
    return relative_errors(scores)[0].value if scores else None


def bootstrap_of(fit: Fit, draws: int | None) -> tuple[repeating.Bootstrap | None, tuple[str, ...]]:
    """Estimates of windows drawn again, or a note on why there are none; nothing without draws."""
    if draws is None:
        return None, ()
    if fit.method.needs != "information":
        of = "samples" if fit.method.needs == "samples" else "whole runs"
        return None, (f"no bootstrap: {fit.method.name} needs {of}, which cannot be resampled",)
    progress = fit.task.progress
    try:
        return repeating.bootstrap(
            fit.estimator, fit.fitted.information, draws=draws, progress=progress
        ), ()
    except DataError as error:
        return None, (f"no bootstrap: {error.wrong}",)
