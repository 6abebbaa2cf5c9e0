"""Logs as they are named on a command line, made runs."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from types import MappingProxyType

import numpy as np

from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError, ModelError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.logs.clocks_and_combined_logs import Numbered
from steelyard.logs.files_and_urls import path_of
from steelyard.logs.formats import open_log
from steelyard.logs.lerobot import is_lerobot, open_lerobot
from steelyard.logs.log_and_errors import Cut, parse_log_argument
from steelyard.logs.log_parts import LogPart
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import ROW, Signals
from steelyard.robot.init.column_names import listed
from steelyard.robot.init.guess_columns import guess_signals
from steelyard.robot.init.guess_targets import targets_without_efforts
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing, requested_processing
from steelyard.runs.recording import Recording
from steelyard.runs.run import Run

SAMPLE_ROWS = 20_000  # rows read to guess units, and whether velocities are good
HASHED_BYTES = 1 << 20  # bytes that are hashed at a time


@dataclass(frozen=True)
class LogArgument:
    """A log as it was named on the command line."""

    text: str
    path: Path
    cut: Cut


def log_files(arguments: Sequence[str]) -> list[LogArgument]:
    """The files of logs; each must be there and be a log. A dataset is one log for each episode.

    Raises:
        LogError: One is not.
    """
    found = []
    for text in arguments:
        path, cut = parse_log_argument(text)
        open_log(path)
        if is_lerobot(path):
            found += _of_dataset(text, path, cut)
        else:
            found.append(LogArgument(text, path, cut))
    return found


def log_file(argument: str) -> LogArgument:
    """The one log that an argument names; `LogError` where it is several, as of a dataset."""
    found = log_files([argument])
    if len(found) > 1:
        raise LogError(
            f"the dataset has {len(found)} episodes there, and one is needed",
            where=argument,
            fix=f"name one by its rows: {found[0].text}; `steelyard log info` lists them",
        )
    return found[0]


def _of_dataset(text: str, path: Path, cut: Cut) -> list[LogArgument]:
    """One log for each episode of a dataset, or for the part of it in a window of rows."""
    if cut.seconds != Cut().seconds:
        return [LogArgument(text, path, cut)]
    first, last = cut.rows
    parts = [
        (max(start, first), stop if last is None else min(stop, last))
        for start, stop in open_lerobot(path).episodes
    ]
    cuts = [Cut(rows=part) for part in parts if part[0] < part[1]]
    found = [LogArgument(f"{path}{one.text}", path, one) for one in cuts]
    if not found:
        raise LogError(
            "the dataset has no episode in these rows",
            where=text,
            fix="name other rows, or the whole dataset",
        )
    return found


def refuse_overlaps(fitted: Sequence[LogArgument], unseen: Sequence[LogArgument]) -> None:
    """The same samples neither count twice in a fit nor test it."""
    again = [(log, other) for n, log in enumerate(fitted) for other in fitted[:n]]
    tested = [(log, other) for log in fitted for other in unseen]
    for pairs, role in ((again, "is fitted twice"), (tested, "is both fitted and validated")):
        for log, other in pairs:
            if log.path.resolve() == other.path.resolve() and overlap(log.cut, other.cut):
                raise LogError(
                    f"a part of '{log.path.name}' {role}",
                    where=f"{log.text} and {other.text}",
                    fix="give every part once; cut a log with LOG@START:STOP",
                )


def overlap(a: Cut, b: Cut) -> bool:
    """Whether two windows share samples; one in seconds and one in rows cannot be compared."""
    whole = Cut()
    if whole not in (a, b) and (a.seconds == whole.seconds) != (b.seconds == whole.seconds):
        return False
    apart = a.seconds[1] <= b.seconds[0] or b.seconds[1] <= a.seconds[0]
    first, second = sorted((a.rows, b.rows), key=lambda rows: rows[0])
    return not apart and (first[1] is None or second[0] < first[1])


def sha256(path: Path) -> str:
    """Hash of a file, read in parts; of a folder, that of its files' names and hashes.

    Videos and images of a dataset, which are not read, do not count.
    """
    if path.is_dir():
        folders = [path / "meta", path / "data"] if is_lerobot(path) else [path]
        files = sorted(file for one in folders for file in one.rglob("*") if file.is_file())
        listed = (f"{file.relative_to(path).as_posix()} {sha256(file)}\n" for file in files)
        return hashlib.sha256("".join(listed).encode()).hexdigest()
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(HASHED_BYTES):
            digest.update(block)
    return digest.hexdigest()


def recording_of(argument: LogArgument, signals: Signals) -> Recording:
    """The recording that an argument names, wrapped positions made continuous."""
    log = open_log(argument.path)
    read = Numbered(log) if signals.time == ROW else log
    return Recording(read, signals, argument.cut).unwrapped()


def sample_of(path: Path) -> tuple[tuple[str, ...], dict[str, np.ndarray]]:
    """Names of a log's columns, and some values of each whose name is its own.

    Of columns of text there is the word that they begin with.
    """
    log = open_log(path)
    single = [name for name, count in Counter(log.columns).items() if count == 1]
    table = next(log.parts(single, (0, SAMPLE_ROWS), SAMPLE_ROWS), None)
    if table is None:
        raise LogError("the log has no rows", where=str(path), fix="record or export it again")
    texts = {name: np.array([text]) for name, text in getattr(log, "texts", ())}
    return tuple(dict.fromkeys(log.columns)), dict(zip(single, table.T, strict=True)) | texts


def signals_of(loaded: LoadedRobot, log: LogArgument) -> tuple[Signals, tuple[str, ...]]:
    """The robot file's signals, or a guess from the log's columns with its reasons."""
    if loaded.signals is not None:
        return loaded.signals, ()
    if loaded.targets is not None:
        raise ModelError(
            "the robot file names position targets, but no efforts",
            where=loaded.where("signals", "target"),
            fix="from these, `steelyard check`, `identify` and `validate` do what is possible (in "
            "Python check_targets, identify_actuators, validate_actuators); for all else log "
            "efforts, and add [signals.effort]",
        )
    columns, sample = sample_of(log.path)
    try:
        return guess_signals(loaded.robot, columns, sample)
    except LogError as error:
        targets = targets_without_efforts(columns, sample)[1]
        if not targets:
            raise
        raise LogError(
            f"the log has position targets ({listed(targets)}) and no efforts",
            where=log.text,
            fix="actuators are identified from these: `steelyard init MODEL LOG` writes the robot "
            "file that `check` and `identify` need for it",
        ) from error


def processing_of_robot(loaded: LoadedRobot) -> Processing:
    """How logs are made runs, as the robot file says it."""
    return requested_processing(loaded.processing, loaded.where)


def prepared(
    recordings: Sequence[Recording],
    wanted: Processing,
    progress: Progress,
    *,
    at_rest: bool = False,
    known: Mapping[str, Run] = MappingProxyType({}),
    before: Sequence[Run] = (),
) -> tuple[Run, ...]:
    """Clean runs with common cut-offs: those wanted, or the widest that a run's motion needs.

    Logs in which no joint moves are refused, unless they may be `at_rest`. Of `known` runs by the
    place of their log, made as wanted, and of runs made `before` with other cut-offs, one for each
    recording or none, the log is not surveyed again.
    """
    runs: list[Run] = []
    for recording, old in zip_longest(recordings, before):
        report_progress(progress, "reading logs", len(runs), len(recordings))
        run = None if before else known.get(recording.where)
        runs.append(prepare(recording, wanted, at_rest=at_rest, before=old) if run is None else run)
    if not runs:
        return ()
    common = processing_used(wanted, runs)
    wide = common.motion_cutoff, common.matched_cutoff
    for k, run in enumerate(runs):
        if (run.motion_cutoff, run.matched_cutoff) != wide:
            runs[k] = prepare(recordings[k], common, at_rest=at_rest, before=run)
    return distinct(runs)


def runs_of(
    loaded: LoadedRobot,
    signals: Signals,
    fitted: Sequence[LogArgument],
    unseen: Sequence[LogArgument],
    progress: Progress,
    made: Mapping[str, Run] = MappingProxyType({}),
    before: Sequence[Run] = (),
) -> tuple[tuple[Run, ...], tuple[Run, ...]]:
    """Clean runs, to be fitted and to be predicted, with the cut-offs that the former come to.

    Runs that were `made` of single motions, by the place of their log, are taken over; runs that
    were made of all these logs `before`, with other cut-offs, spare their survey.
    """
    wanted = processing_of_robot(loaded)
    known, count = made if wanted.repetitions is None else {}, len(fitted)
    first, later = ([recording_of(log, signals) for log in logs] for logs in (fitted, unseen))
    clean = prepared(first, wanted, progress, known=known, before=before[:count])
    once = replace(processing_used(wanted, clean), repetitions=None)
    fresh = prepared(later, once, progress, at_rest=True, before=before[count:])
    runs = distinct([*clean, *fresh])
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
    folders = [path.resolve().parts[-2:0:-1] for _, path in logs]
    # logs of one folder that differ in their suffix alone
    places = list(zip(names, folders, strict=True))
    names = [
        f"{name}{path.suffix}" if places.count(place) > 1 else name
        for (name, path), place in zip(logs, places, strict=True)
    ]
    for depth in range(max((len(parts) for parts in folders), default=0)):
        alike = [names.count(name) > 1 for name in names]
        names = [
            f"{parts[depth]}/{name}" if twice and depth < len(parts) else name
            for name, parts, twice in zip(names, folders, alike, strict=True)
        ]
    return names


def names_of_parts(parts: Sequence[LogPart]) -> list[str]:
    """Short names of parts that are all different, with their rows."""
    paths = {part.file.url: Path(path_of(part.file.url)) for part in parts}
    names = distinct_names([(path.stem, path) for path in paths.values()])
    by_url = dict(zip(paths, names, strict=True))
    return [f"{by_url[part.file.url]}{part.cut}" for part in parts]


def processing_used(wanted: Processing, runs: Sequence[Run]) -> Processing:
    """The processing with the cut-offs that the runs came to."""
    return replace(
        wanted,
        motion_cutoff=max(run.motion_cutoff for run in runs),
        matched_cutoff=max(run.matched_cutoff for run in runs),
    )


def paths_of(logs: str | Path | Iterable[str | Path], least: int = 0) -> list[str]:
    """One log or several as texts."""
    given = [logs] if isinstance(logs, str | Path) else list(logs)
    strange = next((log for log in given if not isinstance(log, str | Path)), None)
    if strange is not None or len(given) < least:
        raise LogError(
            "no log is given" if strange is None else f"a {type(strange).__name__} is no log",
            where="list of logs",
            fix="give the paths of log files",
        )
    return [str(log) for log in given]


@checked()
def load_runs(
    robot: str | Path | LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    *,
    progress: Progress = silent,
) -> tuple[Run, ...]:
    """Logs as runs: motion and effort on a uniform clock, in SI units and joint order.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used.

    Example:
        >>> (run,) = load_runs("arm.toml", "fit.csv")
        >>> run.whole().motion.n_joints
        2
    """
    loaded = load_robot(robot)
    files = log_files(paths_of(logs, least=1))
    return runs_of(loaded, signals_of(loaded, files[0])[0], files, (), progress)[0]
