"""The page of `steelyard compare-models`: errors, efforts over time, parameters, masses."""

from importlib.metadata import version

from steelyard.report.content import ReportContent
from steelyard.report.page import page_of, shown_sections
from steelyard.report.sections.model.quality import QualitySection
from steelyard.report.sections.model.settings import SettingsSection
from steelyard.report.sections.models.efforts import ModelEffortsSection
from steelyard.report.sections.models.errors import ModelErrorsSection
from steelyard.report.sections.models.masses import ModelMassesSection
from steelyard.report.sections.models.parameters import ModelParametersSection, ModelsSection
from steelyard.report.sections.section import Section

SECTIONS: tuple[Section, ...] = (
    ModelErrorsSection(),
    ModelsSection(),
    ModelEffortsSection(),
    ModelParametersSection(),
    ModelMassesSection(),
    QualitySection(),
    SettingsSection(),
)


def render_models(content: ReportContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    shown = shown_sections(SECTIONS, content)
    return page_of(content.title, content.robot, "compared", version("steelyard"), shown)
