"""Work of the check in a process: its findings with pictures and lines, and its report."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.files import whole_file
from steelyard.base.progress import Progress
from steelyard.check.check import check
from steelyard.check.finding import Edit, Finding, Picture, Trace
from steelyard.check.findings_text_and_page import check_headline, drawn_picture, edit_dict, tally
from steelyard.report.words import significant
from steelyard.robot.file.toml_edits import lines_of


def findings(
    robot: str, logs: Sequence[str], model: str | None, report: str, progress: Progress
) -> dict[str, Any]:
    """What `steelyard check ROBOT LOG... --model MODEL` finds, page and numbers as it writes."""
    found = check(robot, logs, model, progress=progress)
    diagnosis = found.last
    page = Path(report)
    for name, text in (("check.html", found.report()), ("check.json", _json(found.to_dict()))):
        with whole_file(page / name) as part:
            part.write_text(text, encoding="utf-8")
    return {
        "headline": check_headline(diagnosis),
        "tally": tally(diagnosis),
        "severity": diagnosis.severity.word,
        "notes": list(found.content.notes),
        "findings": [
            _finding(one, _edits(one, diagnosis.findings))
            for one in sorted(diagnosis.findings, key=lambda one: -one.severity)
        ],
    }


def _json(values: dict[str, Any]) -> str:
    return json.dumps(values, indent=1, allow_nan=False) + "\n"


def _edits(finding: Finding, every: Sequence[Finding]) -> tuple[Edit, ...]:
    """Changes of the robot file for a finding, with those that were tried together with them."""
    fix = finding.fix
    if fix is None or not (fix.jointly and fix.edits):
        return () if fix is None else fix.edits
    fixes = (one.fix for one in every if one.log == finding.log)
    together = (edit for one in fixes if one is not None and one.jointly for edit in one.edits)
    return tuple({edit.path: edit for edit in together}.values())


def _finding(finding: Finding, edits: Sequence[Edit]) -> dict[str, Any]:
    fix, picture = finding.fix, picture_of(finding)
    return {
        "check": finding.check,
        "log": finding.log,
        "place": finding.place,
        "word": finding.word,
        "severity": int(finding.severity),
        "says": finding.says,
        "figure": finding.figure,
        "picture": None if picture is None else drawn_picture(picture),
        "fix": None if fix is None else fix.says,
        "lines": lines_of(edits),
        "edits": [edit_dict(edit) for edit in edits],
    }


def picture_of(finding: Finding) -> Picture | None:
    """The picture of a finding: its own, or how well each of its hypotheses fits."""
    if finding.picture is not None or not finding.hypotheses:
        return finding.picture
    traces = tuple(
        Trace(
            f"{one.says} ({significant(one.misfit)} %)",
            np.array([float(k + 1)]),
            np.array([one.misfit]),
            "bars",
        )
        for k, one in enumerate(finding.hypotheses)
    )
    return Picture("hypothesis", "misfit [%]", traces)
