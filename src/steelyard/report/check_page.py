"""The page of `steelyard check`: verdict, all findings in a table, evidence, lines to paste."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

from steelyard.report.html import fill
from steelyard.report.page import Shown, page_of
from steelyard.report.sections.model.check import findings_of
from steelyard.report.text.findings import OPEN, Group, groups, place

if TYPE_CHECKING:
    from steelyard.diagnosis import Diagnosis


@dataclass(frozen=True, eq=False)
class CheckContent:
    """Everything that the page shows.

    Attributes:
        robot: The robot's name.
        file: The robot file or model that was given.
        logs: The logs as they were given.
        model: The model they were compared with, if one was given.
        diagnosis: What was found.
        asks: The question of each check, by name.
        notes: What was assumed.
    """

    robot: str
    file: str
    logs: tuple[str, ...]
    model: str | None
    diagnosis: Diagnosis
    asks: Mapping[str, str]
    notes: tuple[str, ...] = ()


def render_check(content: CheckContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    found = findings_of(content.diagnosis)
    rows = [row for group in groups(content.diagnosis) for row in _rows(group)]
    rows.sort(key=lambda row: ("poor", "fair", OPEN, "good").index(row["level"]))
    numbers = {**found, "alone": False, "rows": rows, "content": content}
    sections = [
        Shown("verdict", "Verdict", fill("check_verdict.html", numbers)),
        Shown("evidence", "Evidence", fill("findings.html", numbers)),
    ]
    if content.notes:
        notes = fill("notes.html", {"notes": content.notes})
        sections.append(Shown("notes", "Notes", notes, folded=True))
    if found["fixes"]:
        sections.insert(1, Shown("fixes", "What to do", fill("check_fixes.html", numbers)))
    return page_of(
        f"{content.robot}: check of the logs",
        content.robot,
        "checked",
        version("steelyard"),
        sections,
    )


def _rows(group: Group) -> list[dict[str, str]]:
    """One row per finding; of many that are ok the first speaks."""
    count = len(group.findings)
    alike = count > 1 and not group.severity
    return [
        {
            "word": group.word,
            "level": group.level if group.word != OPEN else OPEN,
            "check": group.check,
            "place": f"{finding.log or 'all logs'} (and {count - 1} more)"
            if alike
            else place(finding),
            "says": finding.says,
            "figure": finding.figure,
        }
        for finding in (group.findings[:1] if alike else group.findings)
    ]
