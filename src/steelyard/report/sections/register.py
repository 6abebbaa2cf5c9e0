"""All sections, in the order of the page."""

from steelyard.report.content import ReportContent
from steelyard.report.page import page_of, shown_sections
from steelyard.report.sections.estimation.bootstrap import BootstrapSection
from steelyard.report.sections.estimation.compare import CompareSection
from steelyard.report.sections.estimation.conditioning import ConditioningSection
from steelyard.report.sections.estimation.correlations import CorrelationsSection
from steelyard.report.sections.estimation.per_run import PerRunSection
from steelyard.report.sections.estimation.reduction import ReductionSection, RemovalsSection
from steelyard.report.sections.estimation.repeated import RepeatedSection
from steelyard.report.sections.estimation.sensitivity import SensitivitySection
from steelyard.report.sections.estimation.unseen import UnseenSection
from steelyard.report.sections.model.bodies import BodiesSection
from steelyard.report.sections.model.check_section import CheckSection
from steelyard.report.sections.model.drives import DrivesSection
from steelyard.report.sections.model.effort import EffortSection
from steelyard.report.sections.model.effort_scales import EffortScalesSection
from steelyard.report.sections.model.ellipsoids import EllipsoidsSection
from steelyard.report.sections.model.friction import FrictionSection
from steelyard.report.sections.model.friction_curves import FrictionCurvesSection
from steelyard.report.sections.model.masses import MassesSection
from steelyard.report.sections.model.parameters import ParametersSection
from steelyard.report.sections.model.quality import QualitySection
from steelyard.report.sections.model.residuals import ResidualsSection
from steelyard.report.sections.model.settings import SettingsSection
from steelyard.report.sections.model.torque_split import TorqueSplitSection
from steelyard.report.sections.model.truth import TruthSection
from steelyard.report.sections.model.verdict import VerdictSection
from steelyard.report.sections.model.zero_offsets import ZeroOffsetsSection
from steelyard.report.sections.section import Section

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
    CompareSection(),
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
    version = None if content.identified is None else content.identified.provenance.version
    shown = shown_sections(sections_of(content), content)
    return page_of(content.title, content.robot, "identified", version, shown)
