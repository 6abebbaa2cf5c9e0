"""The report as one page that needs nothing else: no network, no other file."""

from steelyard.report.content import ReportContent
from steelyard.report.html import fill, plotly_script, verbatim
from steelyard.report.sections.register import SECTIONS


def render(content: ReportContent) -> str:
    """The report as HTML text, to be written as UTF-8."""
    shown = []
    for section in SECTIONS:
        numbers = section.numbers(content)
        if numbers is not None:
            shown.append((section, section.show(numbers)))
    page = fill(
        "page.html",
        {
            "title": content.title,
            "robot": content.robot,
            "version": None if not content.identified else content.identified.provenance.version,
            "sections": shown,
            "plots": any(section.name == "effort" for section, _ in shown),
            "style": verbatim("style.css"),
            "script": verbatim("page.js"),
            "plotly": plotly_script,
        },
    )
    return str(page)
