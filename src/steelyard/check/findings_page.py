"""The page of `steelyard check`: verdict, findings with their evidence, lines to paste."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.check.finding import OPEN_WORD, Finding, Picture, Trace
from steelyard.check.findings_text import (
    LEVEL_OF_SEVERITY,
    Group,
    check_headline,
    fixes,
    groups,
    tally,
)
from steelyard.report.figures import thin
from steelyard.report.page import Numbers, Shown, fill, packed, page_of, script_json
from steelyard.report.words import percent
from steelyard.robot.file.toml_edits import lines_of

if TYPE_CHECKING:
    from steelyard.check.check_register_and_diagnosis import Diagnosis


MOST_POINTS_OF_EVIDENCE_LINE = 2000  # most points of one line
MOST_POINTS_OF_CHECK_PAGE = 200_000  # points of all pictures; those behind are left out
LEAST_NUMBER_IN_DOUBLE_PRECISION = 1e5  # numbers from here on, such as dates, need it


def findings_of(
    diagnosis: Diagnosis, budget: int = MOST_POINTS_OF_CHECK_PAGE, *, fine: bool = True
) -> Numbers:
    """What the template shows: the worst findings first, then those that are ok."""
    found = [one for group in groups(diagnosis) for one in group]
    left, shown = budget, []
    for finding in sorted(found, key=lambda finding: -finding.severity):
        picture, fix = finding.picture, finding.fix if finding.severity else None
        if picture is not None and (fine or finding.severity):
            left -= sum(min(len(t.x), MOST_POINTS_OF_EVIDENCE_LINE) for t in picture.traces)
            drawn = script_json(_figure(picture)) if left >= 0 else None
        else:
            drawn = None
        shown.append(
            {
                "check": finding.check,
                "place": finding.place,
                "level": LEVEL_OF_SEVERITY.get(finding.word, OPEN_WORD),
                "word": finding.word,
                "says": finding.says,
                "figure": finding.figure,
                "hypotheses": finding.hypotheses,
                "fix": fix and (fix.says, lines_of(fix.edits)),
                "picture": drawn,
                "still": _reason_it_is_ok(finding, diagnosis),
            }
        )
    return {
        "alone": True,
        "level": LEVEL_OF_SEVERITY[diagnosis.severity.word],
        "headline": check_headline(diagnosis),
        "tally": tally(diagnosis),
        "bad": [one for one in shown if one["level"] != "good"],
        "fine": [one for one in shown if one["level"] == "good"],
        "fixes": [
            (fix.says, lines_of(fix.edits), ", ".join(dict.fromkeys(f.check for f in asking)))
            for fix, asking in fixes(diagnosis).values()
        ],
    }


def _reason_it_is_ok(finding: Finding, diagnosis: Diagnosis) -> str:
    """Why a finding is ok although an explanation beats the declared reading; else empty."""
    rivals = finding.hypotheses
    declared = next((one for one in rivals if one.declared), None)
    others = any(f.log == finding.log and f.severity and f.hypotheses for f in diagnosis.findings)
    if finding.severity or not finding.answered or others or not declared or rivals[0] is declared:
        return ""
    misfit = (
        "Ok although another hypothesis fits better: the misfit as declared is "
        f"{percent(declared.misfit)}"
    )
    if finding.nominal:
        return (
            f"{misfit}, which wrong masses of a nominal model can cause; the other hypothesis may "
            "compensate errors of the nominal masses. A model from runs known to be correct "
            "(--model) would decide."
        )
    return (
        f"{misfit}; a hypothesis with more free parameters nearly always fits better, and is "
        "accepted only where its gain is statistically significant and large enough to matter."
    )


def _figure(picture: Picture) -> dict[str, Any]:
    return {"x": picture.x, "y": picture.y, "traces": [_trace(one) for one in picture.traces]}


def _trace(trace: Trace) -> dict[str, Any]:
    """At most so many points; a line keeps the extremes of every stretch."""
    if trace.kind == "line":
        chosen = thin(trace.y, MOST_POINTS_OF_EVIDENCE_LINE)
    else:
        chosen = np.arange(0, len(trace.x), -(-len(trace.x) // MOST_POINTS_OF_EVIDENCE_LINE) or 1)
    x = np.asarray(trace.x)[chosen]
    return {
        "name": trace.name,
        "kind": trace.kind,
        "x": packed(x, "f8" if np.any(np.abs(x) > LEAST_NUMBER_IN_DOUBLE_PRECISION) else "f4"),
        "y": packed(np.asarray(trace.y)[chosen]),
    }


@dataclass(frozen=True, eq=False)
class CheckContent:
    """What the page shows; `asks` has the question of each check by its name."""

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
    rows = [row for group in groups(content.diagnosis) for row in _rows_of_group(group)]
    rows.sort(key=lambda row: ("poor", "fair", OPEN_WORD, "good").index(row["level"]))
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


def _rows_of_group(group: Group) -> list[dict[str, str]]:
    """One row per finding; of many that are ok the first speaks."""
    more = len(group) - 1 if not group[0].severity else 0
    return [
        {
            "word": finding.word,
            "level": LEVEL_OF_SEVERITY.get(finding.word, OPEN_WORD),
            "check": finding.check,
            "place": f"{finding.log or 'all logs'} (and {more} more)" if more else finding.place,
            "says": finding.says,
            "figure": finding.figure,
        }
        for finding in (group[:1] if more else group)
    ]
