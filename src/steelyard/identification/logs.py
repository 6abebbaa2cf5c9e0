"""The way of the data that commands share: logs named on the command line to runs and scores."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.errors import LogError, ModelError, OutputError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.formats import Cut, open_log, parse_log_argument
from steelyard.formats.numbered import Numbered
from steelyard.measurement import Processing, Recording, Run, prepare
from steelyard.measurement.processing import requested_processing
from steelyard.model import Model
from steelyard.progress import Progress, report_progress
from steelyard.robot.robot import Robot
from steelyard.robot_file.file import LoadedRobot
from steelyard.robot_file.signals import ROW, Signals
from steelyard.robot_file.template.guess_columns import guess_signals
from steelyard.terms.laws.coulomb import Coulomb
from steelyard.terms.laws.rotor_inertia import RotorInertia
from steelyard.terms.laws.viscous import Viscous
from steelyard.terms.register import DEFAULT_TERMS, refuse_unfit, term_of
from steelyard.terms.term import Term
from steelyard.validation.bands import Bands
from steelyard.validation.headline import effort_reference
from steelyard.validation.score import RunScore, score
from steelyard.validation.torque_parts import TorqueSplit

SAMPLE_ROWS = 20_000
"""Rows read to guess units, and whether velocities are good."""
HASHED = 1 << 20
"""Bytes that are hashed at a time."""


@dataclass(frozen=True)
class LogArgument:
    """A log as it was named on the command line."""

    text: str
    path: Path


def log_files(arguments: Sequence[str]) -> list[LogArgument]:
    """The files of logs; each must be there and be a log.

    Raises:
        LogError: One is not.
    """
    found = []
    for text in arguments:
        path = parse_log_argument(text)[0]
        open_log(path)
        found.append(LogArgument(text, path))
    return found


def refuse_overlaps(fitted: Sequence[LogArgument], unseen: Sequence[LogArgument]) -> None:
    """The same samples neither count twice in a fit nor test it.

    Raises:
        LogError: Two windows of one file overlap.
    """
    again = [(log, other) for n, log in enumerate(fitted) for other in fitted[:n]]
    tested = [(log, other) for log in fitted for other in unseen]
    for pairs, role in ((again, "is fitted twice"), (tested, "is both fitted and validated")):
        for log, other in pairs:
            if log.path.resolve() == other.path.resolve() and _overlap(log, other):
                raise LogError(
                    f"a part of '{log.path.name}' {role}",
                    where=f"{log.text} and {other.text}",
                    fix="give every part once; cut a log with LOG@START:STOP",
                )


def _overlap(one: LogArgument, other: LogArgument) -> bool:
    """Whether two windows share samples; one in seconds and one in rows cannot be compared."""
    a, b = parse_log_argument(one.text)[1], parse_log_argument(other.text)[1]
    whole = Cut()
    if whole not in (a, b) and (a.seconds == whole.seconds) != (b.seconds == whole.seconds):
        return False
    apart = a.seconds[1] <= b.seconds[0] or b.seconds[1] <= a.seconds[0]
    first, second = sorted((a.rows, b.rows), key=lambda rows: rows[0])
    return not apart and (first[1] is None or second[0] < first[1])


def fitted_before(identified: IdentifiedModel, log: LogArgument) -> bool:
    """Whether the model was identified from samples of this log, whatever it is called now."""
    origin = identified.provenance
    inputs = {h for role, h in origin.inputs.items() if role.startswith("identification ")}
    if sha256(log.path) not in inputs:
        return False
    names = [run.rpartition("/")[2] for run in origin.runs]
    cuts = [name.removeprefix(log.path.stem) for name in names if name.startswith(log.path.stem)]
    return not cuts or any(_overlap(log, LogArgument(f"{log.path}{cut}", log.path)) for cut in cuts)


def sha256(path: Path) -> str:
    """Hash of a file, read in parts; of a folder, that of its files' names and hashes."""
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        listed = (f"{file.relative_to(path).as_posix()} {sha256(file)}\n" for file in files)
        return hashlib.sha256("".join(listed).encode()).hexdigest()
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(HASHED):
            digest.update(block)
    return digest.hexdigest()


def recording_of(argument: LogArgument, signals: Signals) -> Recording:
    """The recording that an argument names, wrapped positions made continuous."""
    path, cut = parse_log_argument(argument.text)
    log = open_log(path)
    read = Numbered(log) if signals.time == ROW else log
    return Recording(read, signals, cut).unwrapped()


def sample_of(path: Path) -> tuple[tuple[str, ...], dict[str, np.ndarray]]:
    """Names of a log's columns, and some values of each."""
    log = open_log(path)
    table = next(log.parts(log.columns, (0, SAMPLE_ROWS), SAMPLE_ROWS))
    return tuple(log.columns), dict(zip(log.columns, table.T, strict=True))


def signals_of(loaded: LoadedRobot, log: LogArgument) -> tuple[Signals, tuple[str, ...]]:
    """The robot file's signals, or a guess from the log's columns with its reasons."""
    if loaded.signals is not None:
        return loaded.signals, ()
    columns, sample = sample_of(log.path)
    return guess_signals(loaded.robot, columns, sample)


def model_of(loaded: LoadedRobot) -> Model:
    """The model that a robot file describes, with the customary terms where it names none.

    Where friction is to be chosen, it is left out; on the link side no rotor is felt.

    Raises:
        ModelError: A term is of the motors' side, but efforts are logged on the link side.
    """
    behind = loaded.signals is not None and loaded.signals.effort_kind == "link_torque"
    if loaded.terms is None:
        left: tuple[type[Any], ...] = (RotorInertia,) if behind else ()
        left += (Coulomb, Viscous) if loaded.friction else ()
        return Model(loaded.robot, tuple(t for t in DEFAULT_TERMS if not isinstance(t, left)))
    terms = tuple(term_of(t.description, t.where) for t in loaded.terms)
    for term, spec in zip(terms, loaded.terms, strict=True):
        refuse_unfit(term, loaded.robot, spec.where)
        if behind and _is_of_motors(term, loaded.robot):
            raise ModelError(
                f"term '{term.law}' acts on the motors' side, but efforts are link torques, "
                "on the link side",
                where=spec.where,
                fix='leave it out, or use kind = "joint_torque" if efforts are computed from '
                "motor currents",
            )
    return Model(loaded.robot, terms)


def with_friction(model: Model, loaded: LoadedRobot) -> Model:
    """The model with Coulomb and viscous friction where a robot file leaves friction open."""
    return replace(model, terms=(*model.terms, Coulomb(), Viscous())) if loaded.friction else model


def _is_of_motors(term: Term, robot: Robot) -> bool:
    """Whether a term acts on the motors' side of the gears."""
    gears = robot.transmission
    motors = () if gears is None else gears.motors
    named = {name for pair in getattr(term, "pairs", ()) for _, name in pair}
    return term.on_motors or not named.isdisjoint(set(motors) - set(robot.joint_names))


def wanted_by(loaded: LoadedRobot) -> Processing:
    """How logs are made runs, as the robot file says it."""
    return requested_processing(loaded.processing, loaded.where)


def processing_of(identified: IdentifiedModel) -> Processing:
    """How logs are read for a model: as those were that it was identified from, without a mean."""
    return replace(
        identified.processing,
        motion_cutoff=identified.cutoffs.motion,
        matched_cutoff=identified.cutoffs.matched,
        repetitions=None,
    )


def prepared(
    recordings: Sequence[Recording],
    wanted: Processing,
    progress: Progress,
    *,
    at_rest: bool = False,
) -> tuple[Run, ...]:
    """Clean runs with common cut-offs: those wanted, or the widest that a run's motion needs.

    Logs in which no joint moves are refused, unless they may be `at_rest`.
    """
    runs = []
    for number, recording in enumerate(recordings):
        report_progress(progress, "reading logs", number, len(recordings))
        runs.append(prepare(recording, wanted, at_rest=at_rest))
    if not runs:
        return ()
    common = processing_used(wanted, runs)
    return distinct(
        [
            run
            if (run.motion_cutoff, run.matched_cutoff)
            == (common.motion_cutoff, common.matched_cutoff)
            else prepare(recording, common, at_rest=at_rest)
            for run, recording in zip(runs, recordings, strict=True)
        ]
    )


def runs_of(
    loaded: LoadedRobot,
    signals: Signals,
    fitted: Sequence[LogArgument],
    unseen: Sequence[LogArgument],
    progress: Progress,
) -> tuple[tuple[Run, ...], tuple[Run, ...]]:
    """Clean runs, to be fitted and to be predicted, with the cut-offs that the former come to."""
    wanted = wanted_by(loaded)
    clean = prepared([recording_of(log, signals) for log in fitted], wanted, progress)
    fresh = [recording_of(log, signals) for log in unseen]
    once = replace(processing_used(wanted, clean), repetitions=None)
    runs = distinct([*clean, *prepared(fresh, once, progress, at_rest=True)])
    return runs[: len(clean)], runs[len(clean) :]


def distinct(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs with distinct names: with as many folders before them as that takes.

    Logs are often called alike, each in a folder of its own; what is left out in turn, and
    parameters of single runs, go by the runs' names.
    """
    names = distinct_names([(run.name, run.recording.log.path) for run in runs])
    return tuple(replace(run, name=name) for run, name in zip(runs, names, strict=True))


def distinct_names(logs: Sequence[tuple[str, Path]]) -> list[str]:
    """Names of logs at these paths, with as many folders before them as makes them distinct."""
    names = [name for name, _ in logs]
    folders = [path.resolve().parts[-2::-1] for _, path in logs]
    for depth in range(max((len(parts) for parts in folders), default=0)):
        alike = [names.count(name) > 1 for name in names]
        names = [
            f"{parts[depth]}/{name}" if twice and depth < len(parts) else name
            for name, parts, twice in zip(names, folders, alike, strict=True)
        ]
    return names


def processing_used(wanted: Processing, runs: Sequence[Run]) -> Processing:
    """The processing with the cut-offs that the runs came to."""
    return replace(
        wanted,
        motion_cutoff=max(run.motion_cutoff for run in runs),
        matched_cutoff=max(run.matched_cutoff for run in runs),
    )


def scored(
    identified: IdentifiedModel, runs: Sequence[Run], progress: Progress
) -> tuple[RunScore, ...]:
    """Scores of a model on runs, with the nominal model beside it."""
    gains, cutoff, bands = identified.signals.gains, identified.cutoffs.score, Bands.of(identified)
    prior, reference = identified.model.prior, effort_reference(identified)
    split, scores = TorqueSplit(identified.valued), []
    for number, run in enumerate(runs):
        report_progress(progress, "validating", number, len(runs))
        scores.append(score(identified.valued, run, gains, cutoff, prior, bands, split, reference))
    return tuple(scores)


def scored_from_commanded(
    identified: IdentifiedModel,
    logs: Sequence[LogArgument],
    names: Sequence[str],
    progress: Progress,
) -> tuple[RunScore, ...]:
    """Scores of a model whose efforts are predicted from the commanded motion of logs.

    Args:
        identified: The model.
        logs: The logs.
        names: Names of their runs.
        progress: Told about every log.

    Raises:
        ModelError: The columns of the commanded motion are not known.
        LogError: A log has no such columns.
    """
    signals = identified.signals.of_commanded()
    recordings = [recording_of(log, signals) for log in logs]
    runs = prepared(recordings, processing_of(identified), progress, at_rest=True)
    named = [replace(run, name=name) for run, name in zip(runs, names, strict=True)]
    return tuple(
        replace(score, predicted_from="commanded") for score in scored(identified, named, progress)
    )


def new_folder(output: Path | None, default: str) -> Path:
    """The folder to make: the one that is given, or `default`, with a number if that exists.

    Raises:
        OutputError: A folder is given that is there already.
    """
    if output is None:
        names = chain([default], (f"{default}-{number}" for number in count(2)))
        return next(folder for folder in map(Path, names) if not folder.exists())
    if output.exists():
        raise OutputError(
            "the output folder exists already",
            where=str(output),
            fix="name another one with --output, or remove it"
            + ("; without --output folders are numbered" if default else ""),
        )
    return output
