"""The designed motion in a few words: its figure, whether it is safe, what it asks of the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from steelyard.excitation.constraints.certificate import COVERS
from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.design_words import (
    USED,
    detail,
    hardest,
    headline,
    left_words,
    level,
    nearest,
    scopes,
    uncovered,
    unseen,
    used_words,
)
from steelyard.report.text.words import NONE, significant

if TYPE_CHECKING:
    from steelyard.excitation.result import Designed


class DesignVerdictSection(Section):
    """Headline, figures, what is tight, and what was assumed."""

    name: ClassVar[str] = "design"
    title: ClassVar[str] = "The designed motion"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Everything, if a motion was designed."""
        designed = content.design
        if designed is None:
            return None
        return {
            "level": level(designed),
            "headline": headline(designed),
            "detail": detail(designed),
            "scopes": scopes(designed),
            "facts": _facts(designed),
            "failures": designed.certificate.failures,
            "tables": [_margins(designed)],
            "title": self.title,
            "share": 100.0 * designed.limits.share,
            "covers": COVERS,
            "uncovered": uncovered(designed),
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_verdict.html", numbers)


def _margins(designed: Designed) -> PlainTable:
    """Of every kind of limit the nearest one."""
    rows = [
        Row((one.kind, one.name, left_words(one), used_words(one))) for one in nearest(designed)
    ]
    headings = ("Limit", "Where it is nearest", "Left", USED)
    return PlainTable("Smallest margins", "", headings, rows, (0, 1))


def _facts(designed: Designed) -> list[tuple[str, str]]:
    """Values and labels."""
    shown, top = designed.shown, hardest(designed)
    total = len(shown.names)
    return [
        (significant(shown.raw), "condition number, raw"),
        (significant(shown.normalised), "condition number, columns of unit length"),
        (f"{designed.trajectory.duration:.4g} s", "duration"),
        (f"{total - unseen(designed)} of {total}", "base parameters identifiable"),
        (NONE if top is None else f"{100.0 * top[1]:.3g} %", "use of the closest joint limit"),
    ]
