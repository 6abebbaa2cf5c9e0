"""Scores of an identified model on logs, and the report on both: all sections of its page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from html import escape
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import finite_json
from steelyard.base.errors import DataError, advice
from steelyard.base.files import csv_text
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.scores.effort_errors import effort_reference
from steelyard.estimate.scores.parts_and_bands_along_run import Bands, TorqueSplit
from steelyard.estimate.scores.score import RunScore, score
from steelyard.identify.page import (
    conditioning_correlations_and_repeats,
    efforts_their_parts_and_residuals,
    friction_choice_and_curves,
    gains_offsets_search_and_settings,
    link_inertias_and_ellipsoids,
    parameters_and_truth,
    reduction_and_removals,
    verdict_and_joint_errors,
)
from steelyard.identify.page.parameters_and_truth import ParameterRow, parameter_rows
from steelyard.identify.page.report_content_and_error_words import ReportContent, both_words
from steelyard.identify.page.verdict_and_joint_errors import joints_table
from steelyard.identify.runs_and_notes_of_logs import runs_for
from steelyard.identify.verdict_and_next_steps import Verdict, verdict
from steelyard.report.page import Section, render_sections
from steelyard.report.result import TEXT_WIDTH, DataFrame, Result, Series, frame
from steelyard.report.terminal import terminal
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import LogArgument

SECTIONS: tuple[Section, ...] = (
    verdict_and_joint_errors.VerdictSection(),
    reduction_and_removals.ReductionSection(),
    efforts_their_parts_and_residuals.EffortSection(),
    efforts_their_parts_and_residuals.TorqueSplitSection(),
    friction_choice_and_curves.FrictionCurvesSection(),
    friction_choice_and_curves.FrictionSection(),
    efforts_their_parts_and_residuals.ResidualsSection(),
    gains_offsets_search_and_settings.DrivesSection(),
    gains_offsets_search_and_settings.EffortScalesSection(),
    gains_offsets_search_and_settings.ZeroOffsetsSection(),
    parameters_and_truth.TruthSection(),
    reduction_and_removals.RemovalsSection(),
    parameters_and_truth.ParametersSection(),
    link_inertias_and_ellipsoids.MassesSection(),
    link_inertias_and_ellipsoids.EllipsoidsSection(),
    link_inertias_and_ellipsoids.BodiesSection(),
    gains_offsets_search_and_settings.PerRunSection(),
    gains_offsets_search_and_settings.EvolutionSection(),
    conditioning_correlations_and_repeats.UnseenSection(),
    conditioning_correlations_and_repeats.ConditioningSection(),
    conditioning_correlations_and_repeats.CorrelationsSection(),
    conditioning_correlations_and_repeats.BootstrapSection(),
    conditioning_correlations_and_repeats.RepeatedSection(),
    conditioning_correlations_and_repeats.SensitivitySection(),
    gains_offsets_search_and_settings.CheckSection(),
    gains_offsets_search_and_settings.QualitySection(),
    gains_offsets_search_and_settings.SettingsSection(),
)

OF_ERRORS = ("verdict", "effort", "torque-split", "residuals", "check", "quality", "settings")
ERROR_SECTIONS = tuple(section for section in SECTIONS if section.name in OF_ERRORS)
"""Sections about the errors of a model on logs, without its fit."""


def sections_of(content: ReportContent) -> tuple[Section, ...]:
    """The sections of a page: those about errors alone, or all."""
    return ERROR_SECTIONS if content.only_errors else SECTIONS


def render(content: ReportContent) -> str:
    """The report as HTML text, to be written as UTF-8."""
    by = content.identified.provenance.version
    return render_sections(sections_of(content), content, "identified", by)


CSV_COLUMNS = tuple(field.name for field in fields(ParameterRow))  # columns of `parameters.csv`


def print_report(content: ReportContent, console: Console, verbose: bool = False) -> None:
    """Print what the sections have for a terminal, and the notes."""
    sections = sections_of(content)
    shown = [part for section in sections for part in section.printed(content)]
    if verbose:
        shown += [part for section in sections for part in section.detailed(content)]
    for number, part in enumerate(shown):
        if number:
            console.print()
        console.print(part)
    for note in (*content.notes, *(content.details if verbose else ())):
        console.print(Text(f"note: {note}"))


def parameters_csv(identified: IdentifiedModel) -> str:
    """All base parameters as CSV: values, intervals, and how well they are identified."""
    return csv_text(
        [CSV_COLUMNS, *(finite_json(vars(row)).values() for row in parameter_rows(identified))]
    )


def scored(
    identified: IdentifiedModel, runs: Sequence[Run], progress: Progress
) -> tuple[RunScore, ...]:
    """Scores of a model on runs, with the nominal model beside it."""
    gains, cutoff, bands = identified.signals.gains, identified.cutoffs.score, Bands.of(identified)
    prior, reference = identified.model.prior, effort_reference(identified)
    split, scores = TorqueSplit(identified.valued), []
    for number, run in enumerate(runs):
        report_progress(progress, "validating", number, len(runs))
        scores.append(score(identified.valued, run, gains, cutoff, prior, bands, split, reference))
    return tuple(scores)


def scored_from_commanded(
    identified: IdentifiedModel,
    logs: Sequence[LogArgument],
    names: Sequence[str],
    progress: Progress,
) -> tuple[RunScore, ...]:
    """Scores of a model whose efforts are predicted from the commanded motion of logs."""
    runs = runs_for(identified, logs, progress, signals=identified.signals.of_commanded())
    named = [replace(run, name=name) for run, name in zip(runs, names, strict=True)]
    return tuple(
        replace(score, predicted_from="commanded") for score in scored(identified, named, progress)
    )


@dataclass(frozen=True, eq=False, repr=False)
class Scores:
    """Errors of predicted efforts in logs, fitted or not: `print` shows a table per log."""

    fitted: tuple[RunScore, ...]  # scores of the fitted logs
    unseen: tuple[RunScore, ...]  # scores of the others

    @property
    def table(self) -> DataFrame:
        """All columns as a Polars data frame, one row per joint of each log.

        `error`, `used` and `limit` are in `unit`, below `band_hz`, over `seconds`; the other errors
        (`rmse`, `mae` ...) are in `logged_unit`, in the validation band. Where scales of the
        efforts were estimated, `error`, `used` and `percent_of_used` are of the efforts divided by
        them, and `error_as_logged`, `used_as_logged` and `percent_of_used_as_logged` of those as
        logged.

        Raises:
            PackageError: Polars is not installed.
        """
        rows = []
        every = [(True, score) for score in self.fitted] + [(False, x) for x in self.unseen]
        for fitted, one in every:
            others = one.to_dict()["joints"]
            for (joint, logged), other in zip(one.errors.pairs, others, strict=True):
                printed, unscaled = joint.to_dict(), {} if logged is None else logged.to_dict()
                rows.append(  # `print` shows the first and the last columns
                    {
                        **{"run": one.run, "fitted": fitted, "joint": joint.joint},
                        **{
                            k: printed[k]
                            for k in ("error", "percent_of_limit", "used", "limit", "seconds")
                        },
                        **{f"{key}_as_logged": unscaled[key] for key in UNSCALED if unscaled},
                        "predicted_from": one.predicted_from,
                        **{"logged_unit" if k == "unit" else k: x for k, x in other.items()},
                        **{k: printed[k] for k in ("unit", "percent_of_used", "moving")},
                        "band_hz": one.errors.cutoff,
                    }
                )
        return frame(rows, "scores")

    def __getitem__(self, column: str) -> Series:
        """A column of `table`.

        Raises:
            DataError: There is no such column.
        """
        table = self.table
        if column not in table.columns:
            fix = advice(column, table.columns, "columns", len(table.columns))
            raise DataError(f"the scores have no column '{column}'", where="scores", fix=fix)
        return table[column]

    def __str__(self) -> str:
        text = io.StringIO()
        console = terminal(file=text, width=TEXT_WIDTH)
        for scores, unseen in ((self.fitted, False), (self.unseen, True)):
            for one in scores:
                console.print(joints_table(one, unseen))
        return text.getvalue().rstrip("\n")

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


UNSCALED = ("error", "used", "percent_of_used")  # as logged too, with estimated scales


def parameter_table(model: str | Path | IdentifiedModel) -> DataFrame:
    """The base parameters of a model as a data frame, one a row.

    Its columns are those of `parameters.csv`, in an order whose first and last ones, which Polars
    prints, have the estimate: `name`, `group` (the base parameter in full),
    `value`, `unit`, `std`, `lower95` and `upper95` (95 % interval), `relative_std_percent`,
    `status` (how well it is identified), `remark`, `symbol`, `from_data_percent` (share from the
    data, with a prior), `nominal` (of the model file).

    Args:
        model: The model, its `model.json`, or the folder that holds it.

    Raises:
        SteelyardError: The model cannot be read.
        PackageError: Polars is not installed.

    Example:
        >>> table = parameter_table("arm-model")
        >>> table["std"].min() >= 0.0
        True
    """
    table = frame([vars(row) for row in parameter_rows(load_model(model))], "parameters")
    first = ("name", "value", "unit", "std")
    last = ("lower95", "upper95", "relative_std_percent", "status")
    between = [name for name in table.columns if name not in (*first, *last)]
    return table.select(*first, *between, *last)


@dataclass(frozen=True, eq=False, repr=False)
class ModelReport(Result):
    """A model with its scores, and a report on both."""

    content: ReportContent  # all that the report shows

    @property
    def model(self) -> IdentifiedModel:
        """The model."""
        return self.content.identified

    @property
    def verdict(self) -> Verdict:
        """The headline, its level, and findings that limit it."""
        return verdict(self.content)

    @property
    def scores(self) -> Scores:
        """Errors of predicted efforts per joint and log; all columns in its `table`."""
        return Scores(self.content.fitted, self.content.scores)

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render(self.content)

    def write(self, folder: Path) -> None:
        """Write `model.json`, `parameters.csv` and `report.html`."""
        (folder / "model.json").write_text(self.model.text(), encoding="utf-8")
        (folder / "parameters.csv").write_text(parameters_csv(self.model), encoding="utf-8")
        (folder / "report.html").write_text(self.report(), encoding="utf-8")

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the verdict and the errors of every joint; with `verbose` all details."""
        print_report(self.content, console, verbose)

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as the command's `--json` prints them."""
        found: dict[str, Any] = {}
        for section in SECTIONS:
            found |= section.to_dict(self.content)
        return found

    def __repr__(self) -> str:
        """Robot, level and error in one line."""
        judged = self.verdict
        level = "no verdict" if judged.level == "none" else judged.grade
        error = f", {both_words(judged.errors, judged.as_logged)}" if judged.errors else ""
        error += f" ({', '.join(judged.worse)})" if " for " in level else ""
        return f"{type(self).__name__}({self.content.robot}: {level}{error})".replace("\u00a0", " ")
