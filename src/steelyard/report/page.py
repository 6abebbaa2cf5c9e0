"""The report as one page that needs nothing else: no network, no other file."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version as package_version

from steelyard.report.content import ReportContent
from steelyard.report.html import fill, plotly_archive, verbatim
from steelyard.report.sections.model.check import PICTURE
from steelyard.report.sections.register import sections_of
from steelyard.report.sections.section import Numbers, Section


def render(content: ReportContent) -> str:
    """The report as HTML text, to be written as UTF-8."""
    shown = []
    for section in sections_of(content):
        numbers = section.numbers(content)
        if numbers is not None:
            shown.append(Shown.of(section, numbers))
    made, version = "identified", None
    if content.identified is not None:
        version = content.identified.provenance.version
    elif content.design is not None:
        made, version = "designed", package_version("steelyard")
    return page_of(content.title, content.robot, made, version, shown)


@dataclass(frozen=True)
class Shown:
    """A section of a page.

    Attributes:
        name: Its identifier.
        title: Its heading.
        body: Safe HTML.
        folded: Whether it is closed until a click opens it.
    """

    name: str
    title: str
    body: str
    folded: bool = False

    @classmethod
    def of(cls, section: Section, numbers: Numbers) -> "Shown":
        """A section with its numbers."""
        return cls(section.name, section.title, section.show(numbers), section.folded)


def page_of(
    title: str, robot: str, made: str, version: str | None, sections: Sequence[Shown]
) -> str:
    """A page of sections as HTML text; `made` by which version of steelyard, if any."""
    page = fill(
        "page.html",
        {
            "title": title,
            "robot": robot,
            "made": made,
            "version": version,
            "sections": sections,
            "plots": any('class="plot"' in one.body or PICTURE in one.body for one in sections),
            "style": verbatim("style.css"),
            "script": verbatim("page.js"),
            "plotly": plotly_archive,
        },
    )
    return str(page)
