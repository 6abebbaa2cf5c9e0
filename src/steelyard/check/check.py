"""What is wrong with logs, or with the robot file, and the corrected file: `steelyard check`."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from steelyard.base.checked_arguments import checked
from steelyard.base.errors import ModelError, OutputError
from steelyard.base.files import whole_file
from steelyard.base.progress import Progress, silent
from steelyard.base.workers import refuse_odd
from steelyard.check import all_checks
from steelyard.check.all_checks import Diagnosis
from steelyard.check.case_from_files_and_precheck import (
    Subject,
    case_of,
    diagnosis_of,
    refuse_foreign,
    subject_of,
)
from steelyard.check.check_by_workers import (
    CheckWork,
    diagnosis_by_workers,
    subject_by_first_log,
)
from steelyard.check.finding import Edit, Finding, Severity
from steelyard.check.findings_text_and_page import (
    CheckContent,
    check_headline,
    diagnosis_dict,
    edit_dict,
    print_findings,
    render_check,
    tally,
)
from steelyard.estimate.estimator_register import method_of
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.logs.log_parts import LogPart, whole_logs
from steelyard.report.result import Result
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_edits import edited, lines_of
from steelyard.robot.file.toml_schema import tomllib
from steelyard.robot.init.draft_robot_file import path_from
from steelyard.robot.models.xacro import stem_of
from steelyard.robot.robot import refuse_floating
from steelyard.runs.runs_of_named_logs import log_files, paths_of

MOST_CHECK_ROUNDS = 4  # checks at most: one thing that is wrong can hide another
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


@dataclass(frozen=True, eq=False)
class CorrectedFile:
    """A corrected robot file."""

    subject: Subject  # the file; written only if there are changes
    changes: tuple[AppliedEdit, ...]  # what was changed, in this order
    diagnosis: Diagnosis  # what is found with it
    reasons: tuple[str, ...] = ()  # why nothing is written, where there is no change

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
                {**edit_dict(c.edit), "check": c.finding.check, "says": c.finding.says}
                for c in self.changes
            ],
            **diagnosis_dict(self.diagnosis),
        }


def target_of(robot: str, named: str) -> Path:
    """The robot file to write, new in a folder; without a name one beside the robot's."""
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
    subject: Subject, target: Path, diagnosis: Diagnosis, again: Callable[[Subject], Diagnosis]
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
        try:
            text = edited(text, [change.edit for change in proposed])
            new = replace(subject, path=target, text=text, loaded=load_robot(target, text))
        except ModelError as error:
            raise ModelError(
                f"the findings give no valid robot file: {error.wrong}",
                where=error.where,
                fix=f"change the file by hand, as the check without --fix says; {error.fix}",
            ) from None
        diagnosis = again(new)
    wrong, before = (_with(d, lambda f: f.severity == Severity.WRONG) for d in (diagnosis, first))
    fine = {(f.check, f.log) for f in first.findings if _fine(f)}
    now = {(f.check, f.log) for f in diagnosis.findings if f.severity == Severity.WRONG}
    worse = sorted({check for check, _ in now & fine})
    why, lines = "", "; ".join(c.line for c in changes)
    if changes and (worse or wrong == before != set()):
        names = ", ".join(worse or sorted(before))
        why = f"with {lines} the check finds {names} wrong"
    elif any(c.finding.severity < Severity.WRONG for c in changes):
        # checks that are answered, in all logs, and not doubtful
        after, sure = (
            _with(d, lambda f: True) - _with(d, lambda f: not _fine(f)) for d in (diagnosis, first)
        )
        if len(after) < len(sure):
            names = ", ".join(sorted(sure - after))
            why = f"with {lines} the check can no longer confirm what was ok before: {names}"
    if why:
        return CorrectedFile(subject, (), first, (why,))
    return CorrectedFile(new, tuple(changes), diagnosis, () if changes else _unwritten(first))


def _with(diagnosis: Diagnosis, holds: Callable[[Finding], bool]) -> set[str]:
    return {f.check for f in diagnosis.findings if holds(f)}


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


def _proposed(diagnosis: Diagnosis, changes: Sequence[AppliedEdit]) -> list[AppliedEdit]:
    """The edits of keys not changed before, refined, or taken out again; with the worst finding."""
    before = {change.edit.path for change in changes} - {REFINED_KEY}
    worst = {
        edit.path: finding
        for finding in sorted(reversed(diagnosis.findings), key=lambda f: f.severity)
        for edit in (finding.fix.edits if finding.fix else ())
    }
    return [
        AppliedEdit(edit, worst[edit.path])
        for edit in diagnosis.edits
        if edit.path not in before or edit.value is None
    ]


def _moved(subject: Subject, target: Path) -> str:
    here, there = subject.path.absolute().parent, target.absolute().parent
    if here == there:
        return subject.text
    robot = tomllib.loads(subject.text)["robot"]
    for key in ("urdf", "mjcf"):
        model = robot.get(key)
        if model is not None and not model.startswith("${") and not Path(model).is_absolute():
            return edited(subject.text, [Edit(("robot", key), path_from(there, here / model))])
    return subject.text


@dataclass(frozen=True, eq=False, repr=False)
class CheckResult(Result):
    """What was found in logs.

    Attributes:
        content: What the page shows.
        fixed: The corrected robot file and what is found with it, if one was requested.
    """

    content: CheckContent
    page_name, json_name = "check.html", "check.json"
    fixed: CorrectedFile | None = None

    @property
    def last(self) -> Diagnosis:
        """The findings with the corrected robot file; without one, with the given file."""
        return self.content.diagnosis if self.fixed is None else self.fixed.diagnosis

    def __repr__(self) -> str:
        """Robot file, verdict and numbers of findings in one line."""
        return f"CheckResult({self.content.file}: {check_headline(self.last)}; {tally(self.last)})"

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render_check(self.content)

    def to_dict(self) -> dict[str, Any]:
        """The findings as JSON values, as `steelyard check --json` prints them."""
        return {
            "robot": self.content.file,
            "logs": list(self.content.logs),
            "model": self.content.model,
            **diagnosis_dict(self.content.diagnosis),
            "notes": list(self.content.notes),
            "fixed": None if self.fixed is None else self.fixed.to_dict(),
        }

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print what was found and what was changed; with `verbose` each check that is ok."""
        for note in self.content.notes:
            console.print(Text(f"note: {note}", style="dim"))
        if self.content.notes:
            console.print()
        print_findings(self.content.diagnosis, console, verbose=verbose)
        if self.fixed is None:
            return
        console.print()
        if not self.fixed.changes:
            console.print(Text("No robot file is written" + (":" if self.fixed.reasons else ".")))
            for reason in self.fixed.reasons:
                console.print(Text(f"  {reason}"), soft_wrap=True)
            return
        path = self.fixed.subject.path
        console.print(Text(f"{path} differs:", style="bold"))
        for change in self.fixed.changes:
            console.print(Text(f"  {change.line}", style="cyan"), soft_wrap=True)
            found = change.finding
            where = f", {found.place}" if found.place else ""
            cause = Text(f"{found.check}{where}: {found.says}", style="dim")
            console.print(Padding(cause, (0, 0, 0, 4)))
        console.print(Text(f"\nChecked again with {path}:\n", style="bold"))
        print_findings(self.fixed.diagnosis, console, fine=False)


@checked()
def check(
    robot: str | Path,
    logs: str | Path | Iterable[str | Path],
    model: str | Path | IdentifiedModel | None = None,
    *,
    fix: str | Path | None = None,
    quick: bool = False,
    fixed_base: str | None = None,
    cluster: str | None = None,
    progress: Progress = silent,
) -> CheckResult:
    """Check logs for errors, and propose lines of the robot file that correct them.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        model: Reference model, identified from runs without payload, contact or wrong signals.
        fix: Path of a corrected robot file; if empty, beside the given one. It is checked
            again, and written by `CheckResult.fixed.save()`. `None` for none. Not for logs of
            targets.
        quick: Only the checks that `identify` makes before the fit.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        cluster: Many logs (also folders, patterns with `*`, URLs), each checked alone by workers:
            address of a Dask scheduler, `tcp://HOST:PORT`, or `local:N` for N workers here. A line
            of the robot file is proposed where every log asks for it.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used.

    Example:
        >>> found = check("arm.toml", "fit.csv")
        >>> found.last.severity.name
        'OK'
    """
    refuse_odd(cluster)
    target = None if fix is None else target_of(str(robot), str(fix))
    known = None if model is None else load_model(model)
    given, names = paths_of(logs, least=1), tuple[str, ...]()
    if cluster is None:
        files, parts = log_files(given), tuple[LogPart, ...]()
        subject = subject_of(str(robot), files[0], fixed_base)
        names = tuple(file.text for file in files)
    else:
        files, parts = [], whole_logs(given)
        subject = subject_by_first_log(str(robot), parts, fixed_base)
        names = tuple(part.where for part in parts)
        refuse_floating(subject.loaded.robot, "the check of logs by workers")
    method_of(subject.loaded)
    named = None if model is None or isinstance(model, IdentifiedModel) else str(model)
    if known is not None:
        refuse_foreign(known, subject.loaded, named or "the model")

    def check_with(robot_file: Subject) -> Diagnosis:
        if cluster is not None:
            work = CheckWork(robot_file, known, quick)
            return diagnosis_by_workers(work, parts, cluster, progress)
        case, unread = case_of(robot_file, files, known, progress)
        return diagnosis_of(case, unread, robot_file.text, quick=quick)

    diagnosis, corrected = check_with(subject), None
    if target is not None:
        corrected = correct_robot_file(subject, target, diagnosis, check_with)
    floating = subject.loaded.robot.floating
    asks = {check.name: check.question for check in all_checks.checks_of(floating)}
    content = CheckContent(
        subject.loaded.robot.name, str(robot), names, named, diagnosis, asks, subject.notes
    )
    return CheckResult(content, corrected)
