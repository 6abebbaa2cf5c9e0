"""What the checks found, as the terminal, the page and the file show it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

from steelyard.report.text.words import Level, count

if TYPE_CHECKING:
    from steelyard.diagnosis import Diagnosis, Edit, Finding, Fix, Severity

NAMED = 3
"""Most joints that a place names."""

OPEN = "open"
"""The word for a question that could not be answered."""

WORDS = ("wrong", "doubtful", OPEN, "ok")
"""What a check finds, the worst first."""

LEVELS: dict[str, Level] = {"ok": "good", "doubtful": "fair", "wrong": "poor"}


@dataclass(frozen=True, eq=False)
class Group:
    """All findings of one check with one severity.

    Attributes:
        check: The check's name.
        severity: How bad they are.
        findings: At least one.
    """

    check: str
    severity: Severity
    findings: tuple[Finding, ...]

    @property
    def word(self) -> str:
        """The severity, or that the question is open."""
        return word_of(self.findings[0])

    @property
    def level(self) -> Level:
        """The severity as a colour."""
        return LEVELS[self.severity.word]


def by_edits(findings: Iterable[Finding]) -> tuple[tuple[Finding, ...], ...]:
    """The findings of one check that need the same lines of the robot file, together."""
    found: dict[object, list[Finding]] = {}
    for finding in findings:
        edits = () if finding.fix is None else finding.fix.edits
        found.setdefault((finding.check, lines(edits)) if edits else id(finding), []).append(
            finding
        )
    return tuple(map(tuple, found.values()))


def groups(diagnosis: Diagnosis) -> tuple[Group, ...]:
    """The findings by severity, ok ones first, and in these by check."""
    found: dict[tuple[Severity, str, bool], list[Finding]] = {}
    for finding in sorted(diagnosis.findings, key=lambda f: f.severity):
        key = finding.severity, finding.check, finding.answered
        found.setdefault(key, []).append(finding)
    return tuple(Group(name, word, tuple(some)) for (word, name, _), some in found.items())


def word_of(finding: Finding) -> str:
    """The severity, or that the question is open."""
    return OPEN if not finding.severity and not finding.answered else finding.severity.word


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in a few words, with the checks that hold."""
    worst = diagnosis.severity
    if not diagnosis.findings:
        return "No check applies"
    if diagnosis.inconclusive:
        return f"Inconclusive: {open_words(diagnosis)}"
    if worst == 0:
        every, left = len(words_of(diagnosis)), diagnosis.open_checks
        verdict = "Ok: no error was found"
        if diagnosis.model_open:
            verdict = (
                f"Open: the logs do not decide {', '.join(left)} ({len(left)} of "
                f"{count(every, 'check')}); no error was found"
            )
        elif left:
            verdict = (
                f"Ok, but {len(left)} of {count(every, 'check')} could not be decided: "
                f"{', '.join(left)}"
            )
        beside = dict.fromkeys(f.says for f in diagnosis.findings if f.headline)
        return "; ".join((verdict, *beside))
    names = [f.check for f in diagnosis.findings if f.severity == worst]
    return f"{worst.word.capitalize()}: {', '.join(dict.fromkeys(names))}"


def open_words(diagnosis: Diagnosis) -> str:
    """How many checks are open, where that makes the robot file doubtful."""
    every = count(len(words_of(diagnosis)), "check")
    return (
        f"{len(diagnosis.open_checks)} of {every} could not be decided; the robot file may be wrong"
    )


def words_of(diagnosis: Diagnosis) -> dict[str, str]:
    """The worst word that each check found in any log."""
    found: dict[str, str] = {}
    for finding in diagnosis.findings:
        words = (word_of(finding), found.get(finding.check, WORDS[-1]))
        found[finding.check] = min(words, key=WORDS.index)
    return found


def tally(diagnosis: Diagnosis) -> str:
    """How many checks there are of each word, the worst first."""
    words = list(words_of(diagnosis).values())
    counts = [f"{words.count(word)} {word}" for word in WORDS if word in words]
    return f"{count(len(words), 'check')}: {', '.join(counts)}" if words else "no findings"


def fixes(diagnosis: Diagnosis) -> dict[str, tuple[Fix, list[Finding]]]:
    """What is to be done, once each, with the findings that ask for it; the worst first."""
    found: dict[str, tuple[Fix, list[Finding]]] = {}
    for finding in sorted(diagnosis.findings, key=lambda f: -f.severity):
        if finding.severity and finding.fix is not None:
            key = f"{finding.fix.says} {lines(finding.fix.edits)}"
            found.setdefault(key, (finding.fix, []))[1].append(finding)
    return found


def lines(edits: tuple[Edit, ...]) -> str:
    """Edits as lines of a robot file."""
    from steelyard.robot_file.edits import lines_of

    return lines_of(edits)


def place(finding: Finding) -> str:
    """The log and the few joints that a finding is about, unless its sentence names these."""
    few = finding.joints if len(finding.joints) <= NAMED else ()
    if all(re.search(rf"(?<!\w){re.escape(joint)}(?!\w)", finding.says) for joint in few):
        few = ()
    return ": ".join(part for part in (finding.log, ", ".join(few)) if part)


def finding_dict(finding: Finding) -> dict[str, Any]:
    """As JSON values; without the picture."""
    fix = finding.fix
    return {
        "check": finding.check,
        "log": finding.log,
        "severity": finding.severity.word,
        "says": finding.says,
        "figure": finding.figure,
        "answered": finding.answered,
        "joints": list(finding.joints),
        "fix": None
        if fix is None
        else {
            "says": fix.says,
            "edits": [edit_dict(edit) for edit in fix.edits],
            "lines": lines(fix.edits),
        },
        "hypotheses": [
            {
                "says": one.says,
                "misfit_percent": _number(one.misfit),
                "log_likelihood": _number(one.log_likelihood),
            }
            for one in finding.hypotheses
        ],
    }


def edit_dict(edit: Edit) -> dict[str, Any]:
    """As JSON values."""
    from steelyard.robot_file.edits import plain

    return {"path": list(edit.path), "value": plain(edit.value)}


def diagnosis_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """As JSON values; without pictures."""
    return {
        "severity": diagnosis.severity.word,
        "findings": [finding_dict(finding) for finding in diagnosis.findings],
        "edits": [edit_dict(edit) for edit in diagnosis.edits],
    }


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None
