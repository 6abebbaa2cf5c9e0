"""The page of `steelyard track`: errors, the path of the tool, errors over time, settings."""

from importlib.metadata import version

from steelyard.report.content import ReportContent
from steelyard.report.page import page_of, shown_sections
from steelyard.report.sections.model.settings import SettingsSection
from steelyard.report.sections.section import Section
from steelyard.report.sections.tracking.errors import TrackingErrorsSection
from steelyard.report.sections.tracking.over_time import ErrorsOverTimeSection
from steelyard.report.sections.tracking.path import ToolPathSection

SECTIONS: tuple[Section, ...] = (
    TrackingErrorsSection(),
    ToolPathSection(),
    ErrorsOverTimeSection(),
    SettingsSection(),
)


def render_tracking(content: ReportContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    shown = shown_sections(SECTIONS, content)
    return page_of(content.title, content.robot, "simulated", version("steelyard"), shown)
