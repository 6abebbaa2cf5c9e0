"""The fit repeated, and how well a model predicts other logs: what `steelyard validate` does."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from steelyard.base.arguments import checked
from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.check.finding import Finding
from steelyard.check.findings_text_and_page import finding_dict
from steelyard.check.fitted.fitted_case_and_binding_constraints import FittedCase
from steelyard.check.fitted.post_fit_checks import examine_fit, kept_doubts
from steelyard.estimate.bootstrap_and_sensitivity import (
    FACTORS,
    Bootstrap,
    RepeatedEstimates,
    Sensitivity,
    Variation,
    bootstrap,
)
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_regressor import base_regressor
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.fit import Fit
from steelyard.identify.logs_and_notes import (
    commanded_note,
    dropped,
    dropped_rows,
    first_dropped,
    holds_fitted_rows,
    marked_repeats,
    notes_of,
    settings,
)
from steelyard.identify.page.content_and_error_words import ReportContent, relative_errors
from steelyard.identify.page.gains_offsets_and_scatter import repeated_table
from steelyard.identify.page.verdict_and_next_steps import verdict
from steelyard.identify.scores_and_residuals import (
    ModelReport,
    fitted_before,
    processing_of,
    runs_for,
    scored,
    scored_from_commanded,
)
from steelyard.report.result import DataFrame, Result, frame
from steelyard.report.tables import text_table
from steelyard.report.terminal import terminal
from steelyard.robot.file.signals import Signals
from steelyard.runs.cutoffs import MATCHED_HIGHEST, NYQUIST_SHARE, rounded
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import LogArgument, log_files, paths_of, recording_of


@dataclass(frozen=True, eq=False)
class Repeated:
    """Mean and scatter of repeated estimations; `print` it."""

    estimates: RepeatedEstimates

    @property
    def table(self) -> DataFrame:
        """One row per parameter: mean, standard deviation, and one column per estimation."""
        return frame(self._rows(), "table")

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return self.estimates.to_dict()

    def csv(self) -> str:
        """The table as CSV."""
        text, rows = io.StringIO(), self._rows()
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return text.getvalue()

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
    known = [load_model(model) for model in models]
    _refuse_other_groups(known)
    estimates = {str(number): model.estimate for number, model in enumerate(known, start=1)}
    return Repeated(RepeatedEstimates.of(estimates, population=population))


def _refuse_other_groups(models: Sequence[IdentifiedModel]) -> None:
    """Refuse models in which base parameters of one name are different combinations."""
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


def of_each_log(fit: Fit) -> tuple[RepeatedEstimates | None, tuple[str, ...]]:
    """Estimates from each log alone with the laws, fields and gains of a fit; notes on failures."""
    estimates, notes = dict[str, Estimate](), list[str]()
    for number, run in enumerate(fit.runs):
        report_progress(fit.task.progress, "estimating from each log", number, len(fit.runs))
        information = fit.information.of(fit.information.windows_of_runs[run.name])
        try:
            estimates[run.name] = fit.fitted.estimating((run,), information)(information)
        except DataError as error:
            notes.append(f"no estimate from {run.name} alone: {error.wrong}")
    try:
        return RepeatedEstimates.of(estimates), tuple(notes)
    except DataError as error:
        return None, (*notes, f"no scatter over logs: {error.wrong}")


def fits_with_other_cutoffs(
    fit: Fit,
    fitted: Sequence[LogArgument],
    unseen: Sequence[LogArgument],
    signals: Signals,
    scores: tuple[Sequence[RunScore], Sequence[RunScore]],
) -> Sensitivity:
    """Fit again with cut-offs lower and higher than those of the result.

    Laws, their fields, gains and the cut-off of scores stay what they are. The `signals` are the
    columns of the unseen logs, the `scores` the result's on the fitted logs and on the unseen ones.
    """
    identified, now, estimate = fit.identified, fit.identified.cutoffs, fit.identified.estimate
    known, new = map(_error, scores)
    result = Variation(1.0, now.motion, now.matched, estimate.parameters.values, known, new)
    rate = min(run.rate for run in fit.runs)
    variations = []
    for factor in FACTORS:
        motion = rounded(min(factor * now.motion, NYQUIST_SHARE * rate))
        matched = rounded(min(factor * now.matched, MATCHED_HIGHEST * rate, motion))
        other = replace(processing_of(identified), motion_cutoff=motion, matched_cutoff=matched)
        try:
            same = replace(other, repetitions=identified.processing.repetitions)
            runs, again = _refitted(fit, fitted, same)
            runs += tuple(prepare(recording_of(log, signals), other) for log in unseen)
            of_runs = scored(again, runs, fit.task.progress)
        except LogError as error:
            variations.append(Variation(factor, motion, matched, None, failed=error.wrong))
            continue
        values, count = again.estimate.parameters.values, len(fitted)
        known, new = _error(of_runs[:count]), _error(of_runs[count:])
        variations.append(Variation(factor, motion, matched, values, known, new))
    return Sensitivity(estimate.parameters, estimate.std, result, tuple(variations))


def _refitted(
    fit: Fit, logs: Sequence[LogArgument], processing: Processing
) -> tuple[tuple[Run, ...], IdentifiedModel]:
    """The logs read with other cut-offs, and the same model fitted to them."""
    signals, model = fit.identified.signals, fit.identified.model
    runs = tuple(
        replace(prepare(recording_of(log, signals), processing), name=before.name)
        for log, before in zip(logs, fit.runs, strict=True)
    )
    information = fit.task.information_of(model, runs)(base_regressor(model))
    estimate = fit.fitted.estimating(runs, information)(information)
    return runs, replace(fit.identified, estimate=estimate)


def _error(scores: Sequence[RunScore]) -> float | None:
    """The error that the verdict's headline gives, of these runs [%]."""
    return relative_errors(scores)[0].value if scores else None


def bootstrap_of(fit: Fit, draws: int | None) -> tuple[Bootstrap | None, tuple[str, ...]]:
    """Estimates of windows drawn again, or a note on why there are none; nothing without draws."""
    if draws is None:
        return None, ()
    if fit.method.needs != "information":
        of = "samples" if fit.method.needs == "samples" else "whole runs"
        return None, (f"no bootstrap: {fit.method.name} needs {of}, which cannot be resampled",)
    progress = fit.task.progress
    try:
        return bootstrap(fit.estimator, fit.information, draws=draws, progress=progress), ()
    except DataError as error:
        return None, (f"no bootstrap: {error.wrong}",)


@dataclass(frozen=True, eq=False, repr=False)
class Validation(ModelReport):
    """Errors of a model on logs."""

    write = Result.write

    def to_dict(self) -> dict[str, Any]:
        """The verdict, and under `logs` the scores of each log, in the order of the logs."""
        order = [name for name, _ in self.content.qualities]
        found = [self._result(score, fitted=False) for score in self.content.scores]
        found += [self._result(score, fitted=True) for score in self.content.fitted]
        found.sort(key=lambda one: order.index(one["run"]))
        return {"verdict": self.verdict.to_dict(), "logs": found}

    def _result(self, score: RunScore, *, fitted: bool) -> dict[str, Any]:
        order = [name for name, _ in self.content.qualities]
        own = replace(
            self.content,
            scores=() if fitted else (score,),
            fitted=(score,) if fitted else (),
            limitations=tuple(
                one
                for one in self.content.limitations
                if one.log in ("", score.run) or one.log not in order
            ),
        )
        return {
            **score.to_dict(),
            "fitted": fitted,
            "verdict": verdict(own).to_dict(),
            "limitations": [finding_dict(finding) for finding in own.limitations],
        }


@checked()
def validate(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    *,
    commanded: bool = False,
    progress: Progress = silent,
) -> Validation:
    """Score an identified model on logs that it was not fitted to.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        commanded: Predict the efforts from the commanded motion (`commanded_position` in the robot
            file), as feedforward would.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used.

    Example:
        >>> scored = validate("arm-model", "other.csv")
        >>> scored.scores["percent_of_used"].max() < 10.0
        True
    """
    identified = load_model(model)
    files = log_files(paths_of(logs, least=1))
    runs = runs_for(identified, files, progress)
    names = [run.name for run in runs]
    scores = (
        scored_from_commanded(identified, files, names, progress)
        if commanded
        else scored(identified, runs, progress)
    )
    scores = marked_repeats(identified, runs, scores)
    fitted, fresh = list[RunScore](), list[tuple[Run, RunScore]]()
    for log, run, score in zip(files, runs, scores, strict=True):
        if fitted_before(identified, log) or holds_fitted_rows(identified, run):
            fitted.append(score)
        else:
            fresh.append((run, score))
    unseen = [(run, score) for run, score in fresh if score.predicted_from == "measured"]
    case = FittedCase(  # checks compare with the measured motion, not with a commanded one
        identified,
        unseen=tuple(run for run, _ in unseen),
        unseen_scores=tuple(score for _, score in unseen),
    )
    open_loops = dropped(identified.model, runs)
    content = ReportContent(
        title=f"{identified.model.robot.name}: validation",
        robot=identified.model.robot.name,
        identified=identified,
        scores=tuple(score for _, score in fresh),
        fitted=tuple(fitted),
        qualities=tuple((run.name, run.quality.rows_of_text) for run in runs),
        notes=(
            *dropped_rows(runs),
            *first_dropped(open_loops),
            *commanded_note(identified, scores),
            *(f"{score.run} was fitted: its score does not validate the model" for score in fitted),
        ),
        details=(*notes_of(runs), *open_loops[1:]),
        settings=settings(identified),
        limitations=_limitations(identified, examine_fit(case)),
        logs={run.name: log.text for run, log in zip(runs, files, strict=True)},
        only_errors=True,
    )
    return Validation(content)


def _limitations(identified: IdentifiedModel, found: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """What limits the verdict: what checks doubted of the fit, and what they find of the logs."""
    known = {(one.check, one.says) for one in found}
    kept = [one for one in kept_doubts(identified) if (one.check, one.says) not in known]
    return (*kept, *found)
