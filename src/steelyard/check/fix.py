"""`steelyard check --fix`: a new robot file with what was found, checked again."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from steelyard.base.errors import ModelError, OutputError
from steelyard.base.files import whole_file
from steelyard.base.progress import Progress
from steelyard.check.examine import Diagnosis
from steelyard.check.finding import Edit, Finding, Severity
from steelyard.check.findings_text import diagnosis_dict, edit_dict, place_of_finding
from steelyard.check.subject import Subject, diagnosed
from steelyard.estimate.identified import IdentifiedModel
from steelyard.robot.file.toml import tomllib
from steelyard.robot.file.toml_edits import edited, lines_of
from steelyard.robot.init.template import path_from
from steelyard.robot.models.xacro import stem_of
from steelyard.runs.named_logs import LogArgument

MOST_CHECK_ROUNDS = 4
"""Checks at most: one thing that is wrong can hide another."""
REFINED_KEY = ("signals", "effort", "delay")
"""The key that may change again: residuals show a delay more exactly once most of it is out."""


@dataclass(frozen=True, eq=False)
class AppliedEdit:
    """An edit that was made, and the finding that proposed it."""

    edit: Edit
    finding: Finding

    @property
    def line(self) -> str:
        """Table and key, and the new value."""
        return " ".join(lines_of([self.edit]).split("\n"))

    @property
    def cause(self) -> str:
        """What was found."""
        where = f", {place_of_finding(self.finding)}" if place_of_finding(self.finding) else ""
        return f"{self.finding.check}{where}: {self.finding.says}"


@dataclass(frozen=True, eq=False)
class CorrectedFile:
    """A corrected robot file.

    Attributes:
        subject: The file; written only if there are changes.
        changes: What was changed, in this order.
        diagnosis: What is found with it.
        reasons: Why nothing is written, where there is no change.
    """

    subject: Subject
    changes: tuple[AppliedEdit, ...]
    diagnosis: Diagnosis
    reasons: tuple[str, ...] = ()

    def save(self) -> Path:
        """Write the robot file; where nothing was changed there is none to write.

        Raises:
            OutputError: Nothing was changed, or it cannot be written.
        """
        if not self.changes:
            raise OutputError(
                "nothing was changed, so there is no robot file to write",
                where=str(self.subject.path),
                fix="save only where `fixed.changes` has any",
            )
        with whole_file(self.subject.path) as part:
            part.write_text(self.subject.text, encoding="utf-8")
        return self.subject.path

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "robot_file": str(self.subject.path) if self.changes else None,
            "reasons": list(self.reasons),
            "changes": [
                {
                    **edit_dict(change.edit),
                    "check": change.finding.check,
                    "says": change.finding.says,
                }
                for change in self.changes
            ],
            **diagnosis_dict(self.diagnosis),
        }


def target_of(robot: str, named: str) -> Path:
    """The robot file to write; without a name one beside the robot's.

    Raises:
        OutputError: It is there already, or its folder is not.
    """
    path = Path(robot)
    folder = path.parent if path.suffix.lower() == ".toml" else Path()
    target = Path(named) if named else folder / f"{stem_of(robot)}-fixed.toml"
    if target.exists():
        raise OutputError(
            "the robot file to write exists already",
            where=str(target),
            fix="name another one behind --fix, or remove it",
        )
    if not target.parent.is_dir():
        raise OutputError(
            "the new robot file cannot be written: there is no such folder",
            where=str(target),
            fix="make the folder, or name another file behind --fix",
        )
    return target


def correct_robot_file(
    subject: Subject,
    target: Path,
    diagnosis: Diagnosis,
    files: Sequence[LogArgument],
    reference: IdentifiedModel | None,
    progress: Progress,
    *,
    quick: bool,
) -> CorrectedFile:
    """Apply the proposed edits and check again, as long as more are proposed.

    Nothing is written with which the check finds wrong what it found ok, or as much as before, or
    with which it answers fewer questions, unless what it was changed for is beyond doubt.
    """
    changes: list[AppliedEdit] = []
    new, first = subject, diagnosis
    for _ in range(MOST_CHECK_ROUNDS):
        text = new.text if changes else _moved(subject, target)
        proposed = [c for c in _proposed(diagnosis, changes) if edited(text, [c.edit]) != text]
        if not proposed:
            break
        anew = {change.edit.path for change in proposed}
        changes = [c for c in changes if c.edit.path not in anew] + proposed
        new = _loaded(new, edited(text, [change.edit for change in proposed]), target)
        diagnosis = diagnosed(new, files, reference, progress, quick=quick)
    worse = sorted(_wrong(diagnosis) & {f.check for f in first.findings if _fine(f)})
    if changes and (worse or _wrong(diagnosis) == _wrong(first) != set()):
        names = ", ".join(worse or sorted(_wrong(first)))
        why = f"with {'; '.join(c.line for c in changes)} the check finds {names} wrong"
        return CorrectedFile(subject, (), first, (why,))
    unconfirmed = sorted(_confirmed(first) - _confirmed(diagnosis))
    doubtful = any(c.finding.severity < Severity.WRONG for c in changes)
    if doubtful and len(_confirmed(diagnosis)) < len(_confirmed(first)):
        lines = "; ".join(c.line for c in changes)
        names = ", ".join(unconfirmed)
        why = f"with {lines} the check can no longer confirm what was ok before: {names}"
        return CorrectedFile(subject, (), first, (why,))
    return CorrectedFile(new, tuple(changes), diagnosis, () if changes else _unwritten(first))


def _wrong(diagnosis: Diagnosis) -> set[str]:
    return {f.check for f in diagnosis.findings if f.severity == Severity.WRONG}


def _confirmed(diagnosis: Diagnosis) -> set[str]:
    """Checks that are answered, in all logs, and not doubtful."""
    every = {f.check for f in diagnosis.findings}
    return every - {f.check for f in diagnosis.findings if not _fine(f)}


def _fine(finding: Finding) -> bool:
    return finding.answered and finding.severity == Severity.OK


def _unwritten(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Why what is not ok has no line in a new robot file, once per check."""
    reasons = {}
    for finding in diagnosis.findings:
        if not finding.severity:
            continue
        if finding.fix is None or not finding.fix.edits:
            why = "no line of the robot file is known to correct it"
        elif finding.severity < diagnosis.severity:
            why = f"its lines are not written before what is {diagnosis.severity.word} is corrected"
        else:
            why = "the robot file states this already"
        reasons[finding.check] = f"{finding.check}: {why}"
    return tuple(reasons.values())


def _loaded(subject: Subject, text: str, target: Path) -> Subject:
    try:
        return subject.changed(text, target)
    except ModelError as error:
        raise ModelError(
            f"the findings give no valid robot file: {error.wrong}",
            where=error.where,
            fix=f"change the file by hand, as the check without --fix says; {error.fix}",
        ) from None


def _proposed(diagnosis: Diagnosis, changes: Sequence[AppliedEdit]) -> list[AppliedEdit]:
    """The edits that are proposed and of keys not changed before, refined, or taken out again."""
    before = {change.edit.path for change in changes} - {REFINED_KEY}
    return [
        AppliedEdit(edit, _proposing(diagnosis, edit))
        for edit in diagnosis.edits
        if edit.path not in before or edit.value is None
    ]


def _proposing(diagnosis: Diagnosis, edit: Edit) -> Finding:
    """The worst finding that proposes an edit."""
    proposing = [
        finding
        for finding in diagnosis.findings
        if finding.fix is not None and edit.path in [other.path for other in finding.fix.edits]
    ]
    return max(proposing, key=lambda finding: finding.severity)


def _moved(subject: Subject, target: Path) -> str:
    """The text with the path of its model as seen from the new file's folder."""
    here, there = subject.path.absolute().parent, target.absolute().parent
    if here == there:
        return subject.text
    robot = tomllib.loads(subject.text)["robot"]
    for key in ("urdf", "mjcf"):
        model = robot.get(key)
        if model is not None and not model.startswith("${") and not Path(model).is_absolute():
            return edited(subject.text, [Edit(("robot", key), path_from(there, here / model))])
    return subject.text
