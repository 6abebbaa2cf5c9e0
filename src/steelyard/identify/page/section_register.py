"""All sections in the order of the page, their terminal text, and `parameters.csv`."""

from __future__ import annotations

from dataclasses import fields

from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import finite_json
from steelyard.base.files import csv_text
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.identify.page import (
    bootstrap_repeats_and_sensitivity,
    conditioning_correlations_and_unseen,
    efforts_and_their_parts,
    evolution_section,
    friction_choice_and_curves,
    gains_effort_scales_and_zero_offsets,
    link_inertias_and_ellipsoids,
    parameters_and_truth,
    reduction_and_removals,
    residuals_over_motion,
    settings_quality_and_checks,
    verdict_and_joint_errors,
)
from steelyard.identify.page.parameters_and_truth import ParameterRow, parameter_rows
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import Section, render_sections

SECTIONS: tuple[Section, ...] = (
    verdict_and_joint_errors.VerdictSection(),
    reduction_and_removals.ReductionSection(),
    efforts_and_their_parts.EffortSection(),
    efforts_and_their_parts.TorqueSplitSection(),
    friction_choice_and_curves.FrictionCurvesSection(),
    friction_choice_and_curves.FrictionSection(),
    residuals_over_motion.ResidualsSection(),
    gains_effort_scales_and_zero_offsets.DrivesSection(),
    gains_effort_scales_and_zero_offsets.EffortScalesSection(),
    gains_effort_scales_and_zero_offsets.ZeroOffsetsSection(),
    parameters_and_truth.TruthSection(),
    reduction_and_removals.RemovalsSection(),
    parameters_and_truth.ParametersSection(),
    link_inertias_and_ellipsoids.MassesSection(),
    link_inertias_and_ellipsoids.EllipsoidsSection(),
    link_inertias_and_ellipsoids.BodiesSection(),
    gains_effort_scales_and_zero_offsets.PerRunSection(),
    evolution_section.EvolutionSection(),
    conditioning_correlations_and_unseen.UnseenSection(),
    conditioning_correlations_and_unseen.ConditioningSection(),
    conditioning_correlations_and_unseen.CorrelationsSection(),
    bootstrap_repeats_and_sensitivity.BootstrapSection(),
    bootstrap_repeats_and_sensitivity.RepeatedSection(),
    bootstrap_repeats_and_sensitivity.SensitivitySection(),
    settings_quality_and_checks.CheckSection(),
    settings_quality_and_checks.QualitySection(),
    settings_quality_and_checks.SettingsSection(),
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
