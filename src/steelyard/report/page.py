"""The report as one page that needs nothing else: no network, no other file."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.report.html import PICTURE, fill, plotly_archive, verbatim
from steelyard.report.sections.section import Numbers, Section


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


def shown_sections(sections: Iterable[Section], content: Any) -> list[Shown]:
    """The sections that have something to show."""
    numbered = ((section, section.numbers(content)) for section in sections)
    return [Shown.of(section, numbers) for section, numbers in numbered if numbers is not None]


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
