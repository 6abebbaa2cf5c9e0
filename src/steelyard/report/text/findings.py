"""What the detective found, as the terminal, the page and the file show it."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

from steelyard.report.text.judgement import Level
from steelyard.report.text.words import count

if TYPE_CHECKING:
    from steelyard.diagnosis import Diagnosis, Edit, Finding, Judgement, Mend

NAMED = 3
"""Most joints that a place names."""

OPEN = "open"
"""The word for a question that could not be answered."""

LEVELS: dict[str, Level] = {"ok": "good", "doubtful": "fair", "wrong": "poor"}


@dataclass(frozen=True, eq=False)
class Group:
    """All findings of one suspicion with one judgement.

    Attributes:
        suspicion: The suspicion's name.
        judgement: How bad they are.
        findings: At least one.
    """

    suspicion: str
    judgement: Judgement
    findings: tuple[Finding, ...]

    @property
    def word(self) -> str:
        """The judgement, or that the question is open."""
        return word_of(self.findings[0])

    @property
    def level(self) -> Level:
        """The judgement as a colour."""
        return LEVELS[self.judgement.word]


def groups(diagnosis: Diagnosis) -> tuple[Group, ...]:
    """The findings by judgement, ok ones first, and in these by suspicion."""
    found: dict[tuple[Judgement, str, bool], list[Finding]] = {}
    for finding in sorted(diagnosis.findings, key=lambda f: f.judgement):
        key = finding.judgement, finding.suspicion, finding.answered
        found.setdefault(key, []).append(finding)
    return tuple(Group(name, word, tuple(some)) for (word, name, _), some in found.items())


def word_of(finding: Finding) -> str:
    """The judgement, or that the question is open."""
    return OPEN if not finding.judgement and not finding.answered else finding.judgement.word


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in a few words, with the suspicions that hold."""
    worst = diagnosis.judgement
    if not diagnosis.findings:
        return "No check applies"
    if worst == 0:
        open_ones = sum(not finding.answered for finding in diagnosis.findings)
        told = "Ok: no fault was found"
        if open_ones:
            asked = count(open_ones, "question")
            told = f"Ok as far as decidable: {asked} could not be answered"
        beside = dict.fromkeys(f.says for f in diagnosis.findings if f.headline)
        return "; ".join((told, *beside))
    names = [f.suspicion for f in diagnosis.findings if f.judgement == worst]
    return f"{worst.word.capitalize()}: {', '.join(dict.fromkeys(names))}"


def tally(diagnosis: Diagnosis) -> str:
    """How many findings there are of each judgement, the worst first."""
    words = [word_of(finding) for finding in diagnosis.findings]
    counts = [
        f"{words.count(word)} {word}" for word in ("wrong", "doubtful", "ok", OPEN) if word in words
    ]
    return f"{count(len(words), 'finding')}: {', '.join(counts)}" if words else "no findings"


def mends(diagnosis: Diagnosis) -> dict[str, tuple[Mend, list[Finding]]]:
    """What is to be done, once each, with the findings that ask for it; the worst first."""
    found: dict[str, tuple[Mend, list[Finding]]] = {}
    for finding in sorted(diagnosis.findings, key=lambda f: -f.judgement):
        if finding.judgement and finding.mend is not None:
            key = f"{finding.mend.says} {lines(finding.mend.edits)}"
            found.setdefault(key, (finding.mend, []))[1].append(finding)
    return found


def lines(edits: tuple[Edit, ...]) -> str:
    """Edits as lines of a robot file."""
    from steelyard.robot_file.edits import lines_of

    return lines_of(edits)


def place(finding: Finding) -> str:
    """The log and the few joints that a finding is about; empty if it is about all."""
    few = finding.joints if len(finding.joints) <= NAMED else ()
    return ": ".join(part for part in (finding.log, ", ".join(few)) if part)


def finding_dict(finding: Finding) -> dict[str, Any]:
    """As JSON values; without the picture."""
    mend = finding.mend
    return {
        "suspicion": finding.suspicion,
        "log": finding.log,
        "judgement": finding.judgement.word,
        "says": finding.says,
        "figure": finding.figure,
        "answered": finding.answered,
        "joints": list(finding.joints),
        "mend": None
        if mend is None
        else {
            "says": mend.says,
            "edits": [edit_dict(edit) for edit in mend.edits],
            "lines": lines(mend.edits),
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
        "judgement": diagnosis.judgement.word,
        "findings": [finding_dict(finding) for finding in diagnosis.findings],
        "edits": [edit_dict(edit) for edit in diagnosis.edits],
    }


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None
