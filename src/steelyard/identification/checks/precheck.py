"""The quick check before an identification: what is wrong stops it, what is doubtful is noted."""

from collections.abc import Sequence
from pathlib import Path

from steelyard.diagnosis.examine import Diagnosis
from steelyard.diagnosis.finding import Severity
from steelyard.errors import DataError
from steelyard.identification.checks.check_case import Subject, diagnosed
from steelyard.identification.named_logs import LogArgument
from steelyard.progress import Progress
from steelyard.report.terminal.findings import notes
from steelyard.report.text.findings import by_edits, lines, place
from steelyard.robot_file.file import robot_text
from steelyard.robot_file.loaded import LoadedRobot


def prechecked(
    robot: str, loaded: LoadedRobot, files: Sequence[LogArgument], progress: Progress
) -> Diagnosis:
    """What the quick checks find.

    Raises:
        DataError: Something is wrong that lines of the robot file correct.
    """
    path = Path(robot)
    text = robot_text(path) if path.suffix.lower() == ".toml" else ""
    diagnosis = diagnosed(Subject(path, text, loaded), files, None, progress, quick=True)
    mendable = [f for f in diagnosis.findings if f.fix is not None and f.fix.edits]
    _refuse(Diagnosis(tuple(mendable)), robot)
    return diagnosis


def passed(diagnosis: Diagnosis, robot: str) -> tuple[str, ...]:
    """Notes on what is doubtful; made once runs are clean, whose own errors say more.

    Raises:
        DataError: Something is wrong.
    """
    _refuse(diagnosis, robot)
    return notes(diagnosis)


def _refuse(diagnosis: Diagnosis, robot: str) -> None:
    error = refusal(diagnosis, robot)
    if error is not None:
        raise error


def refusal(diagnosis: Diagnosis, robot: str) -> DataError | None:
    """Why an identification stops at what is wrong; `None` if nothing is.

    Args:
        diagnosis: What was found.
        robot: The robot file's name, for the advice.
    """
    wrong = [f for f in diagnosis.findings if f.severity == Severity.WRONG]
    if not wrong:
        return None
    places = [f"{place(f)} ({f.figure})" if place(f) else f.figure for f in wrong]
    fixes = [f.fix for f in wrong if f.fix is not None]
    edits = Diagnosis(tuple(wrong)).edits
    advice = "; ".join(dict.fromkeys(fix.says for fix in fixes)) or "examine the log"
    if edits:
        advice += f":\n\n{_indented(lines(edits))}\n\n  " + (
            f"`steelyard check {robot} LOG... --fix` writes a robot file with these lines; "
        )
    else:
        advice += f"; `steelyard check {robot} LOG...` shows the evidence; "
    return DataError(
        f"failed check, {', '.join(dict.fromkeys(f.check for f in wrong))}: "
        + "; ".join(dict.fromkeys(alike[0].says for alike in by_edits(wrong))),
        where="; ".join(dict.fromkeys(places)),
        fix=f"{advice}--no-check continues anyway",
    )


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" if line else "" for line in text.split("\n"))
