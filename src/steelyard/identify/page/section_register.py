"""All sections in the order of the page, their terminal text, and `parameters.csv`."""

from __future__ import annotations

import csv
import io
from dataclasses import fields
from math import isfinite

from rich.console import Console
from rich.text import Text

from steelyard.estimate.identified import IdentifiedModel
from steelyard.identify.page.calibration_tables import (
    DrivesSection,
    EffortScalesSection,
    PerRunSection,
    ZeroOffsetsSection,
)
from steelyard.identify.page.conditioning import (
    ConditioningSection,
    CorrelationsSection,
    UnseenSection,
)
from steelyard.identify.page.content import (
    CheckSection,
    QualitySection,
    ReportContent,
    SettingsSection,
)
from steelyard.identify.page.effort_figures import EffortSection, TorqueSplitSection
from steelyard.identify.page.friction_sections import FrictionCurvesSection, FrictionSection
from steelyard.identify.page.inertia_ellipsoids import EllipsoidsSection
from steelyard.identify.page.link_inertias import BodiesSection, MassesSection
from steelyard.identify.page.parameter_table import (
    ParameterRow,
    ParametersSection,
    TruthSection,
    parameter_rows,
)
from steelyard.identify.page.reduction_sections import ReductionSection, RemovalsSection
from steelyard.identify.page.residual_figures import ResidualsSection
from steelyard.identify.page.scatter_of_estimates import (
    BootstrapSection,
    RepeatedSection,
    SensitivitySection,
)
from steelyard.identify.page.verdict_section import VerdictSection
from steelyard.report.page import Section, render_sections

SECTIONS: tuple[Section, ...] = (
    VerdictSection(),
    ReductionSection(),
    EffortSection(),
    TorqueSplitSection(),
    FrictionCurvesSection(),
    FrictionSection(),
    ResidualsSection(),
    DrivesSection(),
    EffortScalesSection(),
    ZeroOffsetsSection(),
    TruthSection(),
    RemovalsSection(),
    ParametersSection(),
    MassesSection(),
    EllipsoidsSection(),
    BodiesSection(),
    PerRunSection(),
    UnseenSection(),
    ConditioningSection(),
    CorrelationsSection(),
    BootstrapSection(),
    RepeatedSection(),
    SensitivitySection(),
    CheckSection(),
    QualitySection(),
    SettingsSection(),
)

ERROR_SECTIONS: tuple[Section, ...] = (
    VerdictSection(),
    EffortSection(),
    TorqueSplitSection(),
    ResidualsSection(),
    CheckSection(),
    QualitySection(),
    SettingsSection(),
)
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
