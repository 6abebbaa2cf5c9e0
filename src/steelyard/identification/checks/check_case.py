"""Logs named on the command line to the case that is checked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.examine import Diagnosis, examine
from steelyard.diagnosis.finding import Edit, Finding, Fix, Severity
from steelyard.errors import LogError, ModelError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.formats import parse_log_argument
from steelyard.identification.named_logs import (
    LogArgument,
    distinct_names,
    recording_of,
    sample_of,
    signals_of,
    wanted_by,
)
from steelyard.measurement.rows.clock import no_row, time_span
from steelyard.progress import Progress, report_progress
from steelyard.robot_file.edits import edited
from steelyard.robot_file.file import load_robot, robot_text
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.robot_file.signals import Signals
from steelyard.robot_file.template.guess_columns import (
    guess_columns,
    refuse_motors,
    velocities_beside,
)
from steelyard.robot_file.template.proposal import proposed
from steelyard.robot_file.template.template import assigned, drafted, notes_beside
from steelyard.robot_file.toml_reader import tomllib
from steelyard.terms.register import term_of

READING = "log"
"""What a log that cannot be read is suspected of."""


@dataclass(frozen=True, eq=False)
class Subject:
    """The robot file that is checked: as it is on disk, as init writes it, or changed.

    Attributes:
        path: Where it is or would be; relative paths in it start there.
        text: What it says.
        loaded: The same, loaded.
        notes: What was assumed.
    """

    path: Path
    text: str
    loaded: LoadedRobot
    notes: tuple[str, ...] = ()

    @property
    def signals(self) -> Signals:
        """Its signals.

        Raises:
            ModelError: It has none.
        """
        if self.loaded.signals is None:
            raise ModelError(
                "the robot file does not assign the columns of a log",
                where=str(self.path),
                fix="add [signals], or let `steelyard init URDF LOG` write a robot file",
            )
        return self.loaded.signals

    def changed(self, text: str, path: Path) -> "Subject":
        """Another robot file."""
        return Subject(path, text, load_robot(path, text), self.notes)


def subject_of(robot: str, log: LogArgument, base: str | None = None) -> Subject:
    """The robot file, or for a URDF or MJCF what `steelyard init` would write from the log.

    Raises:
        ModelError: The file cannot be used.
        LogError: The log's columns cannot be guessed.
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
    signals, wanted = subject.signals, wanted_by(subject.loaded)
    evidence, unread = [], []
    cuts = [parse_log_argument(file.text)[1].text for file in files]
    names = distinct_names(
        [(f"{file.path.stem}{cut}", file.path) for file, cut in zip(files, cuts, strict=True)]
    )
    for number, (name, file) in enumerate(zip(names, files, strict=True)):
        report_progress(progress, "reading logs", number, len(files))
        try:
            one = Evidence(recording_of(file, signals), wanted, name)
            _refuse_empty(one)
            evidence.append(one)
        except LogError as error:
            unread.append(_unreadable(name, error))
    case = Case(subject.loaded, tuple(evidence), reference, _guesses(signals, evidence), progress)
    return case, tuple(unread)


def _refuse_empty(evidence: Evidence) -> None:
    """A log, and its window, have rows.

    Raises:
        LogError: They have none.
    """
    recording = evidence.recording
    start = recording.cut.seconds[0]
    if isfinite(start) and 0.0 < time_span(recording)[0] < start:
        raise no_row(recording)
    if len(evidence.rows[0]) > 0:
        return
    if recording.cut.text:
        raise no_row(recording)
    raise LogError("the log has no rows", where=recording.where, fix="record or copy it again")


def diagnosed(
    subject: Subject,
    files: Sequence[LogArgument],
    reference: IdentifiedModel | None,
    progress: Progress,
    *,
    quick: bool,
) -> Diagnosis:
    """All that is found in logs; what cannot be read is a finding too."""
    case, unread = case_of(subject, files, reference, progress)
    found = examine(case, quick=quick).findings if case.logs else ()
    data = tomllib.loads(subject.text)
    return Diagnosis((*unread, *(_needed(finding, data) for finding in found)))


def _needed(finding: Finding, data: Mapping[str, Any]) -> Finding:
    """The finding without edits that take out what the robot file does not have."""
    if finding.fix is None:
        return finding
    edits = tuple(e for e in finding.fix.edits if e.value is not None or _given(data, e.path))
    return replace(finding, fix=replace(finding.fix, edits=edits))


def _given(data: Any, path: Sequence[str]) -> bool:
    """Whether a robot file has a key."""
    for name in path:
        if not isinstance(data, Mapping) or name not in data:
            return False
        data = data[name]
    return True


def _unreadable(name: str, error: LogError) -> Finding:
    return Finding(READING, name, Severity.WRONG, error.wrong, error.where, (), Fix(error.fix))


def _guesses(signals: Signals, evidence: Sequence[Evidence]) -> Mapping[str, tuple[str, ...]]:
    """Velocity columns that are there, but not declared."""
    if signals.velocity is not None or not evidence:
        return {}
    velocity = velocities_beside(signals.position, evidence[0].log.columns)
    return {"velocity": velocity} if velocity else {}


def refuse_foreign(reference: IdentifiedModel, loaded: LoadedRobot, where: str) -> None:
    """The model of clean runs must be one of the same joints.

    Raises:
        ModelError: It is not.
    """
    mine, its = loaded.robot.joint_names, reference.model.robot.joint_names
    if mine != its:
        raise ModelError(
            f"the model is of the joints {', '.join(its)}, the robot file of {', '.join(mine)}",
            where=where,
            fix="give a model that `steelyard identify` made with this robot file",
        )
