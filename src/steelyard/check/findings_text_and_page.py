"""Findings of the checks in words, as JSON, in a terminal, and on the page of steelyard check."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from steelyard.base.arrays import by_key, json_values
from steelyard.check.all_checks import Diagnosis
from steelyard.check.finding import MOST_NAMED, OPEN_WORD, Edit, Finding, Fix, Picture
from steelyard.report.page import Numbers, Shown, fill, notes, packed, page_of, script_json
from steelyard.report.words import COLOURS, Level, count, percent
from steelyard.robot.file.toml_edits import lines_of

FINDING_WORDS = ("wrong", "doubtful", OPEN_WORD, "ok")  # what a check finds, the worst first
LEVEL_OF_SEVERITY: dict[str, Level] = {"ok": "good", "doubtful": "fair", "wrong": "poor"}

Group = tuple[Finding, ...]  # all findings of one check with one word, at least one


def by_edits(findings: Iterable[Finding]) -> tuple[tuple[Finding, ...], ...]:
    """The findings of one check that need the same lines of the robot file, together."""
    found: dict[object, list[Finding]] = {}
    for finding in findings:
        edits = () if finding.fix is None else finding.fix.edits
        key = (finding.check, lines_of(edits)) if edits else id(finding)
        found.setdefault(key, []).append(finding)
    return tuple(map(tuple, found.values()))


def groups(diagnosis: Diagnosis) -> tuple[Group, ...]:
    """The findings by severity, ok ones first, and in these by check."""
    ordered = sorted(diagnosis.findings, key=lambda f: f.severity)
    found = by_key(((f.severity, f.check, f.answered), f) for f in ordered)
    return tuple(map(tuple, found.values()))


def check_headline(diagnosis: Diagnosis) -> str:
    """The verdict in a few words, with the checks that hold."""
    worst = diagnosis.severity
    if not diagnosis.findings:
        return "No check applies"
    if diagnosis.inconclusive:
        return f"Inconclusive: {open_words(diagnosis)}"
    if worst:
        names = [f.check for f in diagnosis.findings if f.severity == worst]
        return f"{worst.word.capitalize()}: {', '.join(dict.fromkeys(names))}"
    every, left = count(len(words_of(diagnosis)), "check"), diagnosis.open_checks
    listed, verdict = ", ".join(left), "Ok: no error was found"
    if diagnosis.model_open:
        of = f"{len(left)} of {every}"
        verdict = f"Open: the logs do not decide {listed} ({of}); no error was found"
    elif left:
        verdict = f"Ok, but {len(left)} of {every} could not be decided: {listed}"
    return "; ".join((verdict, *dict.fromkeys(f.says for f in diagnosis.findings if f.headline)))


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
        words = (finding.word, found.get(finding.check, FINDING_WORDS[-1]))
        found[finding.check] = min(words, key=FINDING_WORDS.index)
    return found


def tally(diagnosis: Diagnosis) -> str:
    """How many checks there are of each word, the worst first."""
    words = list(words_of(diagnosis).values())
    counts = [f"{words.count(word)} {word}" for word in FINDING_WORDS if word in words]
    return f"{count(len(words), 'check')}: {', '.join(counts)}" if words else "no findings"


def fixes(diagnosis: Diagnosis) -> dict[str, tuple[Fix, list[Finding]]]:
    """What is to be done, once each, with the findings that ask for it; the worst first."""
    found: dict[str, tuple[Fix, list[Finding]]] = {}
    for finding in sorted(diagnosis.findings, key=lambda f: -f.severity):
        if finding.severity and finding.fix is not None:
            key = f"{finding.fix.says} {lines_of(finding.fix.edits)}"
            found.setdefault(key, (finding.fix, []))[1].append(finding)
    return found


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
        "fix": fix
        and {
            "says": fix.says,
            "edits": [edit_dict(edit) for edit in fix.edits],
            "lines": lines_of(fix.edits),
        },
        "hypotheses": [
            {
                "says": one.says,
                "misfit_percent": one.misfit if isfinite(one.misfit) else None,
                "log_likelihood": one.log_likelihood if isfinite(one.log_likelihood) else None,
            }
            for one in finding.hypotheses
        ],
    }


def edit_dict(edit: Edit) -> dict[str, Any]:
    """As JSON values."""
    return {"path": list(edit.path), "value": json_values(edit.value)}


def diagnosis_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """As JSON values; without pictures."""
    return {
        "severity": diagnosis.severity.word,
        "findings": [finding_dict(finding) for finding in diagnosis.findings],
        "edits": [edit_dict(edit) for edit in diagnosis.edits],
    }


MOST_SHOWN_FINDINGS = 3  # findings of one check and severity that are shown one by one
PAYLOAD_CHECK = "payload"  # the check whose masses a fitted model corrects
MASS_ERROR_NOTE = (
    "; this mass contains the errors of the model file's masses: where a line with ! names one by "
    "the identified model, rely on its interval"
)
"""What a note says of such a mass."""


def print_findings(
    diagnosis: Diagnosis, console: Console, *, fine: bool = True, verbose: bool = False
) -> None:
    """Print the findings, the worst last, then what to do and the verdict."""
    worst = words_of(diagnosis)
    shown = [
        group
        for group in groups(diagnosis)
        if (fine or group[0].severity) and (verbose or worst[group[0].check] == group[0].word)
    ]
    if shown:
        console.print(_table(shown, verbose))
    for fix, findings in fixes(diagnosis).values():
        names = ", ".join(dict.fromkeys(f.check for f in findings))
        console.print()
        console.print(Text.assemble((f"fix {names}: ", "bold"), fix.says))
        if fix.edits:
            console.print(Padding(Text(lines_of(fix.edits), style="cyan"), (0, 0, 0, 4)))
    if shown:
        console.print()
    style = f"bold {COLOURS[LEVEL_OF_SEVERITY[diagnosis.severity.word]]}"
    counts = f"  ({tally(diagnosis)})" if any(f.severity for f in diagnosis.findings) else ""
    console.print(Text.assemble((check_headline(diagnosis), style), counts))


def print_notes(diagnosis: Diagnosis) -> tuple[str, ...]:
    """The findings that are not ok, one sentence per check."""
    sentences = []
    for group in (group for group in groups(diagnosis) if group[0].severity):
        first, more = group[0], _others(group, 1)
        where = f"{first.place}: " if first.place else ""
        note = MASS_ERROR_NOTE if first.check == PAYLOAD_CHECK and first.nominal else ""
        says = f"check, {first.check}: {where}{first.says} ({first.figure}){note}"
        sentences.append(f"{says}; {more}" if more else says)
    return tuple(sentences)


def _table(shown: Sequence[Group], verbose: bool) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(max_width=18)
    table.add_column(ratio=1)
    before = None
    passed = [
        group for group in shown if not verbose and group[0].word == "ok" and not _brief(group)
    ]
    if passed:
        names = ", ".join(group[0].check for group in passed)
        word = Text("ok", style=f"bold {COLOURS['good']}")
        table.add_row(word, count(len(passed), "check"), names)
        before = passed[0][0].severity
    for group in (group for group in shown if group not in passed):
        first = group[0]
        # questions that are open for the same reason have one row
        alike = [
            g for g in shown if g[0].word == OPEN_WORD == first.word and g[0].says == first.says
        ]
        if group in alike[1:]:
            continue
        if before not in (None, first.severity):
            table.add_row()
        before = first.severity
        style = f"bold {COLOURS[LEVEL_OF_SEVERITY[first.severity.word]]}"
        name, found = Text(first.check), _found(group)
        if not verbose and first.word == "ok":
            found = Text(_brief(group))
        if len(alike) > 1:
            name = Text(count(len(alike), "check"))
            found = Text(", ".join(g[0].check for g in alike) + ": ").append_text(found)
        word = Text(first.word, style="dim" if first.word == OPEN_WORD else style)
        table.add_row(word, name, found)
    return table


def _brief(group: Group) -> str:
    """What findings say in brief, each with its log if several do; empty if none does."""
    said = [finding for finding in group if finding.brief]
    if len(group) == 1:
        return group[0].brief
    briefs = [f"{f.log}: {f.brief}" for f in said[:MOST_SHOWN_FINDINGS]]
    more = len(said) - MOST_SHOWN_FINDINGS
    return "; ".join([*briefs, *[f"and {more} more logs"] * (more > 0)])


def _found(group: Group) -> Text:
    """What one row says; of many that are ok the first speaks."""
    if not group[0].severity:
        return Text.assemble((_speaks(group), "dim"), group[0].says)
    shown = []
    for one, *same in by_edits(group[:MOST_SHOWN_FINDINGS]):
        place = [(f"{one.place}: ", "bold")] if one.place else []
        figure = [(f"\n{one.figure}", "dim")] if one.figure else []
        shown.append(Text.assemble(*place, one.says, *figure))
        if same:
            alike = ", ".join(f"{other.place} ({other.figure})" for other in same)
            shown.append(Text(f"the same in {alike}"))
    rest = _others(group, MOST_SHOWN_FINDINGS)
    return Text("\n").join([*shown, Text(rest, style="dim")] if rest else shown)


def _speaks(group: Group) -> str:
    """Which logs a sentence is about that stands for findings of several."""
    first = group[0]
    others = {finding.log for finding in group[1:]} - {first.log}
    if not others:
        return ""
    logs = count(len(others - {""}) + bool(first.log), "log")
    together = ["all logs together"] if "" in others or not first.log else []
    every = " and ".join([logs, *together])
    if all(finding.says == first.says for finding in group):
        return f"{every}: "
    if len(others) == len(together):
        return f"{first.log} (and all logs together): "
    return f"{every}; the first, {first.log or 'all logs together'}: "


def _others(group: Group, shown: int) -> str:
    rest = [finding.log or "all logs" for finding in group[shown:]]
    if not rest:
        return ""
    more = len(rest) - MOST_NAMED
    named = f"and {len(rest)} more: {', '.join(rest[:MOST_NAMED])}"
    return f"{named} and {count(more, 'other')}" if more > 0 else named


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
            left -= sum(len(t.x) for t in picture.traces)
            drawn = script_json(drawn_picture(picture)) if left >= 0 else None
        else:
            drawn = None
        shown.append(
            {
                "finding": finding,
                "level": LEVEL_OF_SEVERITY.get(finding.word, OPEN_WORD),
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


def drawn_picture(picture: Picture) -> dict[str, Any]:
    """A picture as JSON values for a page."""
    traces = []
    for one in picture.traces:
        far = np.any(np.abs(one.x) > LEAST_NUMBER_IN_DOUBLE_PRECISION)
        x, y = packed(one.x, "f8") if far else packed(one.x), packed(one.y)
        traces.append({"name": one.name, "kind": one.kind, "x": x, "y": y})
    return {"x": picture.x, "y": picture.y, "traces": traces}


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
    fixes = found["fixes"] and Shown("fixes", "What to do", fill("check_fixes.html", numbers))
    sections = (
        Shown("verdict", "Verdict", fill("check_verdict.html", numbers)),
        fixes or None,
        Shown("evidence", "Evidence", fill("findings.html", numbers)),
        notes("notes", "Notes", content.notes, folded=True),
    )
    return page_of(f"{content.robot}: check of the logs", content.robot, sections, "checked")


def _rows_of_group(group: Group) -> list[Numbers]:
    """One row per finding; of many that are ok the first speaks."""
    more = len(group) - 1 if not group[0].severity else 0
    return [
        {
            "finding": finding,
            "level": LEVEL_OF_SEVERITY.get(finding.word, OPEN_WORD),
            "place": f"{finding.log or 'all logs'} (and {more} more)" if more else finding.place,
        }
        for finding in (group[:1] if more else group)
    ]
