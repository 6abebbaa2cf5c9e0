"""All sections, in the order of the page."""

from steelyard.report.content import ReportContent
from steelyard.report.sections.bodies import BodiesSection
from steelyard.report.sections.bootstrap import BootstrapSection
from steelyard.report.sections.check import CheckSection
from steelyard.report.sections.compare import CompareSection
from steelyard.report.sections.conditioning import ConditioningSection
from steelyard.report.sections.design_advice import DesignAdviceSection
from steelyard.report.sections.design_joints import DesignJointsSection
from steelyard.report.sections.design_proof import DesignProofSection
from steelyard.report.sections.design_run import DesignRunSection
from steelyard.report.sections.design_search import DesignSearchSection
from steelyard.report.sections.design_shown import DesignShownSection
from steelyard.report.sections.design_tool import DesignToolSection
from steelyard.report.sections.design_verdict import DesignVerdictSection
from steelyard.report.sections.drives import DrivesSection
from steelyard.report.sections.effort import EffortSection
from steelyard.report.sections.effort_scales import EffortScalesSection
from steelyard.report.sections.friction import FrictionSection
from steelyard.report.sections.parameters import ParametersSection
from steelyard.report.sections.per_run import PerRunSection
from steelyard.report.sections.quality import QualitySection
from steelyard.report.sections.section import Section
from steelyard.report.sections.sensitivity import SensitivitySection
from steelyard.report.sections.settings import SettingsSection
from steelyard.report.sections.unseen import UnseenSection
from steelyard.report.sections.verdict import VerdictSection
from steelyard.report.sections.zero_offsets import ZeroOffsetsSection

SECTIONS: tuple[Section, ...] = (
    VerdictSection(),
    EffortSection(),
    FrictionSection(),
    DrivesSection(),
    EffortScalesSection(),
    ZeroOffsetsSection(),
    ParametersSection(),
    BodiesSection(),
    PerRunSection(),
    UnseenSection(),
    ConditioningSection(),
    BootstrapSection(),
    SensitivitySection(),
    CompareSection(),
    CheckSection(),
    QualitySection(),
    SettingsSection(),
)

DESIGN_SECTIONS: tuple[Section, ...] = (
    DesignVerdictSection(),
    DesignJointsSection(),
    DesignToolSection(),
    DesignShownSection(),
    DesignAdviceSection(),
    DesignProofSection(),
    DesignSearchSection(),
    DesignRunSection(),
)
"""Sections about a designed motion."""


def sections_of(content: ReportContent) -> tuple[Section, ...]:
    """The sections of a page; one about a motion alone has no verdict on a model."""
    if content.design is None:
        return SECTIONS
    if content.identified is None:
        return (*DESIGN_SECTIONS, SettingsSection())
    return (*SECTIONS, *DESIGN_SECTIONS)
