"""What all commands share: options, errors as one message, a progress bar, results written."""

import functools
import inspect
import json
import os
import re
import shlex
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TypeVar

import typer

from steelyard.base.errors import ModelError, OutputError, SteelyardError, visible
from steelyard.base.files import new_folder, whole_folder
from steelyard.base.progress import Event, Progress
from steelyard.cli import interrupt

if TYPE_CHECKING:
    from steelyard.report.result import Result

ROBOT_SUFFIXES = (".toml", ".urdf", ".xacro", ".xml", ".mjcf")  # no log has them

FIRST_ARGUMENTS = {"robot": ("robot file", "ROBOT"), "model": ("model", "MODEL")}
"""Parameters that stand before the logs, with their name and placeholder."""


def refuse_wrong_order(command: Callable[..., None], arguments: Mapping[str, Any]) -> None:
    """Refuse a log in the place of the robot or the model, and a robot file among the logs."""
    role = next(iter(inspect.signature(command).parameters), "")
    given = arguments.get("logs") or arguments.get("log")
    if role not in FIRST_ARGUMENTS or not given:
        return
    first, logs = arguments[role], [given] if isinstance(given, str) else list(given)
    what, placeholder = (
        ("robot model", "URDF") if command.__name__ == "init" else FIRST_ARGUMENTS[role]
    )
    if _is_log(first):
        wrong = f"a log is in the place of the {what}"
    elif misplaced := [text for text in logs if _is_robot(text)]:
        wrong = f"'{misplaced[0]}' is among the logs, but is a robot file"
    else:
        return
    words = _in_order([first, *logs], placeholder, model=placeholder == "MODEL")
    raise ModelError(
        wrong,
        where=f"steelyard {command.__name__} {shlex.join([first, *logs])}",
        fix=f"{what} first, then logs: steelyard {command.__name__} {words}",
    )


def _in_order(texts: Sequence[str], placeholder: str, *, model: bool) -> str:
    """The robot, or the first that can be an identified model, or a placeholder; then the logs."""
    able = [t for t in texts if (not _is_log(t) and not _is_robot(t) if model else _is_robot(t))]
    first = able[0] if able else None
    logs = [text for text in texts if text != first and not _is_robot(text)]
    return f"{placeholder if first is None else shlex.quote(first)} {shlex.join(logs) or 'LOG'}"


def _is_log(text: str) -> bool:
    """Whether an argument has the suffix or the window of a log."""
    from steelyard.logs.formats import FORMATS

    name = re.sub(r"[@#][^@#/]*:[^@#/]*$", "", text)
    return Path(name).suffix.lower() in FORMATS or (name != text and not _is_robot(name))


def _is_robot(text: str) -> bool:
    """Whether an argument has the suffix of a robot file, arguments of a xacro file apart."""
    return Path(text.split(" ")[0]).suffix.lower() in ROBOT_SUFFIXES


Arguments = ParamSpec("Arguments")

USAGE_ERROR = 2
DEFECT = 70  # exit code where the program itself failed


def guarded(command: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """Exit code 2 with a message for what a user can correct."""

    @functools.wraps(command)
    def run(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        try:
            refuse_wrong_order(command, kwargs)
            command(*args, **kwargs)
        except SteelyardError as error:
            interrupt.check()
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(USAGE_ERROR) from None
        except (BrokenPipeError, typer.Abort, typer.Exit, typer.BadParameter):
            raise
        except OSError as error:
            where = error.filename or "standard output"
            fix = "check the path, its permissions and the space left"
            wrong = f"cannot be read or written: {error.strerror or error}"
            typer.echo(f"error: {OutputError(wrong, where=str(where), fix=fix)}", err=True)
            raise typer.Exit(USAGE_ERROR) from None
        except Exception as error:
            interrupt.check()
            if os.environ.get("STEELYARD_TRACEBACK"):
                raise
            place = traceback.extract_tb(error.__traceback__)[-1]
            defect = SteelyardError(
                f"a defect of steelyard: {type(error).__name__}: {error}",
                where=f"{place.filename}, line {place.lineno}",
                fix="report it with the command and, if possible, the input; "
                "STEELYARD_TRACEBACK=1 shows where it came from",
            )
            typer.echo(f"error: {defect}", err=True)
            raise typer.Exit(DEFECT) from None

    return run


def output_option(help: str) -> Any:
    """The option `--output` with its help."""
    return typer.Option("--output", "-o", help=help)


def output_folder(default: str) -> Any:
    """The option of a folder that is always written, `default` if unset."""
    return output_option(
        f"Output folder; must not exist. If unset {default}, or {default}-2 and so on if that "
        "exists."
    )


ReportFolder = Annotated[Path | None, output_option("Output folder for the report; none if unset.")]
PlotsFolder = Annotated[
    Path | None, output_option("Output folder for a page with plots; none if unset.")
]
XACRO_ARGUMENTS_HELP = "Arguments of a xacro file follow it: arm.urdf.xacro name:=left."
MODEL_HELP = "model.json, or the folder that contains it."
LOG_HELP = (
    "Logs: CSV, Parquet (a file, or a folder of parts), LeRobot datasets (their folders), MCAP, "
    "ROS 1 and 2 bags, NumPy, MATLAB, HDF5. Cut by time: run.parquet@0.6:9.5 (seconds from "
    "its start), or by rows: run.parquet#921:4442."
)


R = TypeVar("R", bound="Result")


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A watcher that draws one bar per phase, and is gone when the work is done."""
    from rich.progress import BarColumn, TaskID, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    from steelyard.report.terminal import terminal

    bars = Bars(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
        console=terminal(file=sys.stderr),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    tasks: dict[str, TaskID] = {}

    def watch(event: Event) -> bool:
        interrupt.check()
        note = visible(event.note)
        if event.phase not in tasks:
            for task in tasks.values():
                bars.remove_task(task)
            tasks.clear()
            tasks[event.phase] = bars.add_task(event.phase, total=event.total, note=note)
        bars.update(tasks[event.phase], completed=event.done, total=event.total, note=note)
        return True

    with bars:
        yield watch


def computed(compute: Callable[..., R], folder: Path | None) -> R:
    """Compute a result with a progress bar, and write it to a new folder, if any, whole or not.

    A folder that cannot be made is refused before the computation.
    """
    with progress_bar() as progress, ExitStack() as stack:
        part = stack.enter_context(whole_folder(folder)) if folder else None
        found = compute(progress=progress)
        if part is not None:
            found.write(part)
            interrupt.too_late()
    return found


def reported(
    compute: Callable[..., R], output: Path | None, as_json: bool, *shown: bool, **files: str
) -> R:
    """Compute a result, write it if wanted, and print it, with the written files by what they are.

    `shown` says how much the terminal shows; the JSON values of such a command name the folder.
    """
    folder = optional_folder(output)
    found = computed(compute, folder)
    if as_json:
        place = {"output": folder and str(folder)} if shown else {}
        print_json({**found.to_dict(), **place})
        return found
    show(found, *shown)
    if folder is not None:
        typer.echo("\n" + file_lines(folder, **files))
    return found


def show(found: "Result", *shown: bool) -> None:
    """Print a result for people."""
    from steelyard.report.terminal import terminal

    found.show(terminal(), *shown)


def say(words: str) -> None:
    """Print words that may name what strangers named, so that they cannot command the terminal."""
    typer.echo(visible(words, "\n"))


def optional_folder(output: Path | None) -> Path | None:
    """The output folder, if one is named; it must not exist."""
    return None if output is None else new_folder(output, "")


def robot_folder(output: Path | None, robot: str, ending: str = "") -> Path:
    """The folder that is always written, called after the robot if unset; it must not exist."""
    from steelyard.robot.models.xacro import stem_of

    return new_folder(output, f"steelyard-{stem_of(robot)}{ending}")


def print_lines(*lines: str, style: str = "", whole: bool = False) -> None:
    """Print lines of text, broken at the terminal's width unless they stay `whole`."""
    from rich.text import Text

    from steelyard.report.terminal import terminal

    console = terminal()
    for line in lines:
        console.print(Text(line, style=style), soft_wrap=whole)


def refuse_options(given: Mapping[str, object], wrong: str, fix: str) -> None:
    """Refuse options without a use, by their names, where one of them is given."""
    for option in (name for name, value in given.items() if value):
        raise OutputError(f"{option} {wrong}", where=option, fix=fix)


def file_lines(folder: Path, **files: str) -> str:
    """Written files by what they are, a line each."""
    width = max(map(len, files))
    return "\n".join(f"{kind:<{width}}  {folder / name}" for kind, name in files.items())


def print_json(values: Any) -> None:
    """Print JSON on standard output."""
    typer.echo(json.dumps(values, allow_nan=False))
