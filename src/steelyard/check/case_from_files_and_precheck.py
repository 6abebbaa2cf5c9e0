"""Logs named on the command line to the case that is checked, and the check before `identify`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from textwrap import indent
from typing import Any

from steelyard.base.errors import DataError, LogError, ModelError
from steelyard.base.progress import Progress, report_progress
from steelyard.check.all_checks import Diagnosis, examine
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.finding import Edit, Finding, Fix, Severity
from steelyard.check.findings_text_and_page import by_edits, print_notes
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.model.laws.register import term_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot, robot_text
from steelyard.robot.file.signals import Signals
from steelyard.robot.file.toml_edits import edited, lines_of
from steelyard.robot.file.toml_schema import tomllib
from steelyard.robot.init.draft_robot_file import assigned, drafted, notes_beside, proposed
from steelyard.robot.init.guess_columns import guess_columns, refuse_motors, velocities_beside
from steelyard.runs.rows.clock_and_row_scan import no_row, time_span
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import (
    LogArgument,
    distinct_names,
    processing_of_robot,
    recording_of,
    sample_of,
    signals_of,
)

READING_CHECK = "log"  # what a log that cannot be read is suspected of


@dataclass(frozen=True, eq=False)
class Subject:
    """The robot file that is checked: as it is on disk, as init writes it, or changed."""

    path: Path  # where it is or would be; relative paths in it start there
    text: str  # what it says
    loaded: LoadedRobot  # the same, loaded
    notes: tuple[str, ...] = ()  # what was assumed

    @property
    def signals(self) -> Signals:
        """Its signals; `ModelError` without any."""
        if self.loaded.signals is None:
            raise ModelError(
                "the robot file does not assign the columns of a log",
                where=str(self.path),
                fix="add [signals], or let `steelyard init URDF LOG` write a robot file",
            )
        return self.loaded.signals


def subject_of(robot: str, log: LogArgument, base: str | None = None) -> Subject:
    """The robot file, or for a URDF or MJCF what `steelyard init` would write from the log.

    `ModelError` where the file cannot be used, `LogError` where columns cannot be guessed.
    """
    path = Path(robot)
    if path.suffix.lower() == ".toml":
        text = robot_text(path)
        loaded = load_robot(path, base=base)
        for term in loaded.terms or ():
            term_of(term.description, term.where)
        if loaded.signals is not None:
            return Subject(path, text, loaded, loaded.notes)
        reasons = signals_of(loaded, log)[1]
        section = guess_columns(loaded.robot.coordinates, *sample_of(log.path)).section
        guessed = section.model_dump(exclude_none=True, exclude_defaults=True)
        text = edited(text, [Edit(("signals",), guessed)])
        return Subject(path, text, load_robot(path, text), (*loaded.notes, *reasons))
    proposal = proposed(robot, base)
    target = Path(f"{proposal.loaded.stem}.toml")
    columns, sample = sample_of(log.path)
    assignment = assigned(proposal, columns, sample)
    if assignment.targets is not None:
        signals_of(proposal.loaded, log)
    if assignment.guess is not None:
        refuse_motors(assignment.guess, columns)
    text = drafted(proposal, assignment, target).text
    loaded = load_robot(target, text)
    guess = assignment.guess or guess_columns(loaded.robot.coordinates, columns, sample)
    notes = (*proposal.notes, *notes_beside(proposal.loaded, loaded), *guess.reasons)
    return Subject(target, text, loaded, notes)


def case_of(
    subject: Subject,
    files: Sequence[LogArgument],
    reference: IdentifiedModel | None,
    progress: Progress,
) -> tuple[Case, tuple[Finding, ...]]:
    """The case, and a finding for every log that cannot be read."""
    signals, wanted = subject.signals, processing_of_robot(subject.loaded)
    log: list[CheckedLog] = []
    unread: list[Finding] = []
    names = distinct_names([(f"{f.path.stem}{f.cut.text}", f.path) for f in files])
    for number, (name, file) in enumerate(zip(names, files, strict=True)):
        report_progress(progress, "reading logs", number, len(files))
        try:
            one = CheckedLog(recording_of(file, signals), wanted, name)
            _refuse_empty(one)
            log.append(one)
        except LogError as error:
            unread.append(Finding.wrong(error.wrong, error.where, fix=Fix(error.fix), log=name))
    guesses = {}
    if signals.velocity is None and log:
        guesses["velocity"] = velocities_beside(signals.position, log[0].log.columns)
    case = Case(subject.loaded, tuple(log), reference, guesses, progress)
    return case, tuple(finding.by(READING_CHECK) for finding in unread)


def _refuse_empty(log: CheckedLog) -> None:
    recording = log.recording
    start = recording.cut.seconds[0]
    late = isfinite(start) and 0.0 < time_span(recording)[0] < start
    if late or (len(log.rows[0]) == 0 and recording.cut.text):
        raise no_row(recording)
    if len(log.rows[0]) == 0:
        raise LogError("the log has no rows", where=recording.where, fix="record or copy it again")


def diagnosis_of(case: Case, unread: Sequence[Finding], text: str, *, quick: bool) -> Diagnosis:
    """What is found in a case, beside what cannot be read, for a robot file of this text."""
    found = examine(case, quick=quick).findings if case.logs else ()
    data = tomllib.loads(text)
    return Diagnosis((*unread, *(_with_needed_edits(finding, data) for finding in found)))


def _with_needed_edits(finding: Finding, data: Mapping[str, Any]) -> Finding:
    """The finding without edits that take out what the robot file does not have."""
    if finding.fix is None:
        return finding
    edits = tuple(e for e in finding.fix.edits if e.value is not None or _given(data, e.path))
    return replace(finding, fix=replace(finding.fix, edits=edits))


def _given(data: Any, path: Sequence[str]) -> bool:
    if not path:
        return True
    return isinstance(data, Mapping) and path[0] in data and _given(data[path[0]], path[1:])


def refuse_foreign(reference: IdentifiedModel, loaded: LoadedRobot, where: str) -> None:
    """Raise `ModelError` where the model of clean runs is of other joints."""
    mine, its = loaded.robot.joint_names, reference.model.robot.joint_names
    if mine != its:
        raise ModelError(
            f"the model is of the joints {', '.join(its)}, the robot file of {', '.join(mine)}",
            where=where,
            fix="give a model that `steelyard identify` made with this robot file",
        )


def prechecked(
    robot: str, loaded: LoadedRobot, files: Sequence[LogArgument], progress: Progress
) -> tuple[Diagnosis, dict[str, Run]]:
    """What the quick checks find, and the runs that they made of logs, by their place.

    `DataError` of what is wrong that lines of the robot file correct.
    """
    path = Path(robot)
    text = robot_text(path) if path.suffix.lower() == ".toml" else ""
    case, unread = case_of(Subject(path, text, loaded), files, None, progress)
    diagnosis = diagnosis_of(case, unread, text, quick=True)
    mendable = [f for f in diagnosis.findings if f.fix is not None and f.fix.edits]
    if error := refusal(Diagnosis(tuple(mendable)), robot):
        raise error
    made = {one.recording.where: vars(one).get("run") for one in case.logs}
    return diagnosis, {where: run for where, run in made.items() if isinstance(run, Run)}


def notes_of_precheck(diagnosis: Diagnosis, robot: str) -> tuple[str, ...]:
    """Notes on what is doubtful, `DataError` of what is wrong; once runs are clean."""
    if error := refusal(diagnosis, robot):
        raise error
    return print_notes(diagnosis)


def refusal(diagnosis: Diagnosis, robot: str) -> DataError | None:
    """Why an identification stops at what is wrong; `None` if nothing is."""
    wrong = [f for f in diagnosis.findings if f.severity == Severity.WRONG]
    if not wrong:
        return None
    places = [f"{f.place} ({f.figure})" if f.place else f.figure for f in wrong]
    advice = "; ".join(dict.fromkeys(f.fix.says for f in wrong if f.fix)) or "examine the log"
    command = f"`steelyard check {robot} LOG..."
    if edits := Diagnosis(tuple(wrong)).edits:
        lines = indent(lines_of(edits), "    ")
        advice += f":\n\n{lines}\n\n  {command} --fix` writes a robot file with these lines"
    else:
        advice += f"; {command}` shows the evidence"
    return DataError(
        f"failed check, {', '.join(dict.fromkeys(f.check for f in wrong))}: "
        + "; ".join(dict.fromkeys(alike[0].says for alike in by_edits(wrong))),
        where="; ".join(dict.fromkeys(places)),
        fix=f"{advice}; --no-check continues anyway",
    )
