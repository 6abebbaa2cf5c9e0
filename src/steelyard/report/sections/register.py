"""All sections, in the order of the page."""

from steelyard.report.sections.bodies import BodiesSection
from steelyard.report.sections.bootstrap import BootstrapSection
from steelyard.report.sections.check import CheckSection
from steelyard.report.sections.compare import CompareSection
from steelyard.report.sections.conditioning import ConditioningSection
from steelyard.report.sections.drives import DrivesSection
from steelyard.report.sections.effort import EffortSection
from steelyard.report.sections.friction import FrictionSection
from steelyard.report.sections.parameters import ParametersSection
from steelyard.report.sections.per_run import PerRunSection
from steelyard.report.sections.quality import QualitySection
from steelyard.report.sections.section import Section
from steelyard.report.sections.sensitivity import SensitivitySection
from steelyard.report.sections.settings import SettingsSection
from steelyard.report.sections.unseen import UnseenSection
from steelyard.report.sections.verdict import VerdictSection

SECTIONS: tuple[Section, ...] = (
    VerdictSection(),
    EffortSection(),
    FrictionSection(),
    DrivesSection(),
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
