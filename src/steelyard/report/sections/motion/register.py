"""All sections about a designed motion, in the order of its page."""

from importlib.metadata import version

from steelyard.report.content import ReportContent
from steelyard.report.page import page_of, shown_sections
from steelyard.report.sections.model.settings import SettingsSection
from steelyard.report.sections.motion.advice import DesignAdviceSection
from steelyard.report.sections.motion.joints import DesignJointsSection
from steelyard.report.sections.motion.proof import DesignProofSection
from steelyard.report.sections.motion.run import DesignRunSection
from steelyard.report.sections.motion.search import DesignSearchSection
from steelyard.report.sections.motion.shown import DesignShownSection
from steelyard.report.sections.motion.tool import DesignToolSection
from steelyard.report.sections.motion.verdict import DesignVerdictSection
from steelyard.report.sections.section import Section

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


def render_design(content: ReportContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    shown = shown_sections((*DESIGN_SECTIONS, SettingsSection()), content)
    return page_of(content.title, content.robot, "designed", version("steelyard"), shown)
