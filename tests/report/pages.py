"""All pages, invented, and what is wrong with one on a screen and on paper.

Shared by the tests and by `proofs/product/pages.py`, which looks at all pages in all ways.
"""

from collections.abc import Iterable
from dataclasses import replace

from browser import Tab
from report.conftest import robot
from report.designed import designed_for
from report.inspected import (
    contact_content,
    health_content,
    measured_wrench_content,
    payload_events,
    wrench_content,
)
from report.test_design import content as motion_content
from report.test_findings import content as check_content
from report.test_models import models_content
from report.test_tracking import tracking_content
from steelyard.check.findings_text_and_page import render_check
from steelyard.excite.page.design_page import render_design
from steelyard.identify.comparison.estimators_page import COMPARE_SECTIONS, ComparisonContent
from steelyard.identify.comparison.models_page import COMPARE_MODELS_SECTIONS
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.scores_and_model_report import render
from steelyard.report.page import render_sections
from steelyard.uses.payload.payload import PayloadsOfLogs

PAGES = (
    "identification",
    "comparison",
    "models",
    "check",
    "motion",
    "tracking",
    "contact",
    "wrench",
    "measured wrench",
    "payload",
    "health",
    "strange names",
)


def pages_of(
    usual: ReportContent, compared: ComparisonContent, nasty: ReportContent
) -> dict[str, str]:
    """Every page, by name."""
    models = models_content("full", "better excitation", "reduced")
    return {
        "identification": render(usual),
        "strange names": render(replace(nasty, fitted=nasty.fitted[:2])),
        "comparison": render_sections(COMPARE_SECTIONS, compared, "compared"),
        "models": render_sections(COMPARE_MODELS_SECTIONS, models, "compared"),
        "check": render_check(check_content("arm")),
        "motion": render_design(motion_content(designed_for(robot()))),
        "tracking": tracking_content(robot()).report(),
        "contact": contact_content().report(),
        "wrench": wrench_content().report(),
        "measured wrench": measured_wrench_content().report(),
        "payload": PayloadsOfLogs("arm", (payload_events(),)).report(),
        "health": health_content().report(),
    }


def wrong_on_screen(tab: Tab, views: Iterable[tuple[int, bool]]) -> list[str]:
    """What is wrong with a page in windows of some widths [px], dark or not, and with its keys."""
    found = []
    for width, dark in views:
        tab.show(width, dark)
        tab.run("drawn()")
        for check in ("overflow()", "cut()", "contrast()"):
            found += [f"{width} px{', dark' * dark}: {one}" for one in tab.run(check)]
    return [*found, *(f"not reached: {one}" for one in unreached(tab)), *tab.console]


def unreached(tab: Tab) -> list[str]:
    """What can be operated but Tab does not reach, or does not show the focus."""
    names, seen = tab.run("operable()"), dict[int, bool]()
    for _ in range(len(names) + 1):
        tab.press("Tab")
        here = tab.run("focused()")
        if here is None or here["number"] in seen:
            break
        seen[here["number"]] = here["visible"]
    return [name for number, name in enumerate(names) if not seen.get(number, False)]


TOPS = """[...document.querySelectorAll('.plots.three')].map(row =>
    [...row.children].map(one => one.getBoundingClientRect().top))"""
OUT = """[...document.querySelectorAll('.sort')].filter(one =>
    one.getBoundingClientRect().right > one.closest('th').getBoundingClientRect().right)"""


def wrong_on_paper(tab: Tab) -> list[str]:
    """What is wrong with a page on paper: what sticks out, three figures not side by side."""
    tab.show(688)
    tab.run("drawn()")
    tab.send("Emulation.setEmulatedMedia", media="print")
    tab.run("dispatchEvent(new Event('beforeprint'))")
    try:
        found = list(tab.run("overflow()"))
        found += tab.run(f"{OUT}.map(one => `heading ${{one.textContent}} sticks out`)")
        found += [
            f"a row of figures at {tops}"
            for tops in tab.run(TOPS)
            if len(tops) == 3 and len(set(tops)) > 1
        ]
    finally:
        tab.send("Emulation.setEmulatedMedia", media="")
        tab.run("dispatchEvent(new Event('afterprint'))")
    return found
