"""What is wrong with logs, or with the robot file: what `steelyard check` does."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from steelyard.base.checked_arguments import checked
from steelyard.base.progress import Progress, silent
from steelyard.check import all_checks
from steelyard.check.all_checks import Diagnosis
from steelyard.check.case_from_files_and_precheck import (
    Subject,
    diagnosed,
    refuse_foreign,
    subject_of,
)
from steelyard.check.corrected_robot_file import CorrectedFile, correct_robot_file, target_of
from steelyard.check.findings_text_and_page import (
    CheckContent,
    check_headline,
    diagnosis_dict,
    print_findings,
    render_check,
    tally,
)
from steelyard.estimate.estimator_register import method_of
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.report.result import Result
from steelyard.runs.runs_of_named_logs import log_files, paths_of


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
    progress: Progress = silent,
) -> CheckResult:
    """Check logs for errors, and propose lines of the robot file that correct them.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        model: Reference model, identified from runs without payload, contact or wrong signals.
        fix: Path of a corrected robot file; if empty, beside the given one. It is checked
            again, and written by `CheckResult.fixed.save()`. `None` for none.
        quick: Only the checks that `identify` makes before the fit.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used.

    Example:
        >>> found = check("arm.toml", "fit.csv")
        >>> found.last.severity.name
        'OK'
    """
    target = None if fix is None else target_of(str(robot), str(fix))
    known = None if model is None else load_model(model)
    files = log_files(paths_of(logs, least=1))
    subject = subject_of(str(robot), files[0], fixed_base)
    method_of(subject.loaded)
    named = None if model is None or isinstance(model, IdentifiedModel) else str(model)
    if known is not None:
        refuse_foreign(known, subject.loaded, named or "the model")

    def check_with(robot_file: Subject) -> Diagnosis:
        return diagnosed(robot_file, files, known, progress, quick=quick)

    diagnosis, corrected = check_with(subject), None
    if target is not None:
        corrected = correct_robot_file(subject, target, diagnosis, check_with)
    content = CheckContent(
        subject.loaded.robot.name,
        str(robot),
        tuple(file.text for file in files),
        named,
        diagnosis,
        {check.name: check.question for check in all_checks.CHECKS},
        subject.notes,
    )
    return CheckResult(content, corrected)
