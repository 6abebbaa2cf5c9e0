"""The page of `steelyard compare`: advice, picture and tables, and what the data were like."""

from importlib.metadata import version

from steelyard.report.content import ReportContent
from steelyard.report.page import page_of, shown_sections
from steelyard.report.sections.estimation.compare import CompareSection
from steelyard.report.sections.model.drives import DrivesSection
from steelyard.report.sections.model.friction import FrictionSection
from steelyard.report.sections.model.quality import QualitySection
from steelyard.report.sections.model.settings import SettingsSection
from steelyard.report.sections.section import Section

SECTIONS: tuple[Section, ...] = (
    CompareSection(),
    FrictionSection(),
    DrivesSection(),
    QualitySection(),
    SettingsSection(),
)
"""What of a report says something of a comparison."""


def render_comparison(content: ReportContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    shown = shown_sections(SECTIONS, content)
    return page_of(content.title, content.robot, "compared", version("steelyard"), shown)
