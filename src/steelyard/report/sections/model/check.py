"""What the checks found in the logs before anything was identified, with the evidence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.report.html import packed, script_json
from steelyard.report.sections.section import Numbers
from steelyard.report.text.findings import (
    LEVELS,
    OPEN,
    fixes,
    groups,
    headline,
    lines,
    place,
    tally,
    word_of,
)
from steelyard.report.text.words import percent
from steelyard.report.thin import thin

if TYPE_CHECKING:
    from steelyard.diagnosis import Diagnosis, Finding
    from steelyard.diagnosis.finding import Picture, Trace

POINTS = 2000
"""Most points of one line."""

BUDGET = 200_000
"""Points of all pictures of a page together; those behind it are left out."""

EXACT = 1e5
"""Numbers from here on, such as times that are dates, are drawn in double precision."""


def findings_of(diagnosis: Diagnosis, budget: int = BUDGET, *, fine: bool = True) -> Numbers:
    """What the template shows: the worst findings first, then those that are ok.

    Args:
        diagnosis: What was found.
        budget: Most points of all pictures.
        fine: Whether those that are ok have their pictures too.
    """
    found = [one for group in groups(diagnosis) for one in group.findings]
    found.sort(key=lambda finding: -finding.severity)
    left, shown = budget, []
    for finding in found:
        picture = finding.picture if fine or finding.severity else None
        points = 0 if picture is None else sum(min(len(t.x), POINTS) for t in picture.traces)
        left -= points
        shown.append(
            _shown(finding, drawn=picture is not None and left >= 0)
            | {"still": _still_ok(finding, diagnosis)}
        )
    return {
        "alone": True,
        "level": LEVELS[diagnosis.severity.word],
        "headline": headline(diagnosis),
        "tally": tally(diagnosis),
        "bad": [one for one in shown if one["level"] != "good"],
        "fine": [one for one in shown if one["level"] == "good"],
        "fixes": [
            (fix.says, lines(fix.edits), ", ".join(dict.fromkeys(f.check for f in asking)))
            for fix, asking in fixes(diagnosis).values()
        ],
    }


def _shown(finding: Finding, *, drawn: bool) -> dict[str, Any]:
    fix = finding.fix if finding.severity else None
    return {
        "check": finding.check,
        "place": place(finding),
        "level": LEVELS.get(word_of(finding), OPEN),
        "word": word_of(finding),
        "says": finding.says,
        "figure": finding.figure,
        "hypotheses": finding.hypotheses,
        "fix": None if fix is None else (fix.says, lines(fix.edits)),
        "picture": script_json(_figure(finding.picture)) if drawn and finding.picture else None,
    }


def _still_ok(finding: Finding, diagnosis: Diagnosis) -> str:
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
        f"accepted only "
        "where its gain is statistically significant and large enough to matter."
    )


def _figure(picture: Picture) -> dict[str, Any]:
    return {"x": picture.x, "y": picture.y, "traces": [_trace(one) for one in picture.traces]}


def _trace(trace: Trace) -> dict[str, Any]:
    """At most so many points; a line keeps the extremes of every stretch."""
    if trace.kind == "line":
        chosen = thin(trace.y, POINTS)
    else:
        chosen = np.arange(0, len(trace.x), -(-len(trace.x) // POINTS) or 1)
    x = np.asarray(trace.x)[chosen]
    return {
        "name": trace.name,
        "kind": trace.kind,
        "x": packed(x, "f8" if np.any(np.abs(x) > EXACT) else "f4"),
        "y": packed(np.asarray(trace.y)[chosen]),
    }
