"""All sections, in the order of the page."""

from steelyard.report.content import ReportContent
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
from steelyard.report.sections.model.check import CheckSection
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
from steelyard.report.sections.motion.advice import DesignAdviceSection
from steelyard.report.sections.motion.joints import DesignJointsSection
from steelyard.report.sections.motion.proof import DesignProofSection
from steelyard.report.sections.motion.run import DesignRunSection
from steelyard.report.sections.motion.search import DesignSearchSection
from steelyard.report.sections.motion.shown import DesignShownSection
from steelyard.report.sections.motion.tool import DesignToolSection
from steelyard.report.sections.motion.verdict import DesignVerdictSection
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
    if content.only_errors:
        return ERROR_SECTIONS
    if content.design is None:
        return SECTIONS
    if content.identified is None:
        return (*DESIGN_SECTIONS, SettingsSection())
    return (*SECTIONS, *DESIGN_SECTIONS)
