"""All sections in the order of the page, their terminal text, and `parameters.csv`."""

from __future__ import annotations

import csv
import io
from dataclasses import fields
from math import isfinite

from rich.console import Console
from rich.text import Text

from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.identify.page import (
    conditioning,
    effort_figures,
    estimate_tables,
    friction_and_residuals,
    inertia_ellipsoids,
    link_inertias,
    parameter_table,
    reduction_sections,
    verdict_section,
)
from steelyard.identify.page.content import (
    CheckSection,
    QualitySection,
    ReportContent,
    SettingsSection,
)
from steelyard.identify.page.parameter_table import ParameterRow, parameter_rows
from steelyard.report.page import Section, render_sections

SECTIONS: tuple[Section, ...] = (
    verdict_section.VerdictSection(),
    reduction_sections.ReductionSection(),
    effort_figures.EffortSection(),
    effort_figures.TorqueSplitSection(),
    friction_and_residuals.FrictionCurvesSection(),
    friction_and_residuals.FrictionSection(),
    friction_and_residuals.ResidualsSection(),
    estimate_tables.DrivesSection(),
    estimate_tables.EffortScalesSection(),
    estimate_tables.ZeroOffsetsSection(),
    parameter_table.TruthSection(),
    reduction_sections.RemovalsSection(),
    parameter_table.ParametersSection(),
    link_inertias.MassesSection(),
    inertia_ellipsoids.EllipsoidsSection(),
    link_inertias.BodiesSection(),
    estimate_tables.PerRunSection(),
    conditioning.UnseenSection(),
    conditioning.ConditioningSection(),
    conditioning.CorrelationsSection(),
    estimate_tables.BootstrapSection(),
    estimate_tables.RepeatedSection(),
    estimate_tables.SensitivitySection(),
    CheckSection(),
    QualitySection(),
    SettingsSection(),
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
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    writer.writerows(
        [_cell(getattr(row, name)) for name in CSV_COLUMNS] for row in parameter_rows(identified)
    )
    return text.getvalue()


def _cell(value: str | float | None) -> str:
    if isinstance(value, str):
        return value
    return "" if value is None or not isfinite(value) else repr(float(value))
