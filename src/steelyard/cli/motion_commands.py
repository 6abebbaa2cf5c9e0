"""The commands `excite` and `replay`: a motion designed, and shown in the browser."""

import os
import time
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli import interrupt
from steelyard.cli.command import output_folder, print_json, progress_bar, say, show
from steelyard.cli.derived_command import from_function

if TYPE_CHECKING:
    from steelyard.base.progress import Event, Progress
    from steelyard.excite.excite import DesignedMotion, DesignTask
    from steelyard.excite.search.parallel_search import SearchBudget


UNPROVEN = 1  # exit code where a limit or a constraint is not proven
UNCOVERED = 3  # exit code where all that was looked at is proven, but not everything was looked at


EXITS = {"good": 0, "fair": UNCOVERED, "poor": UNPROVEN}  # exit code by how good the certificate is


@from_function(
    "steelyard:design_excitation",
    motion={"metavar": "KIND"},
    criterion={"metavar": "KIND"},
    earlier={"metavar": "MODEL"},
    start={"metavar": "MOTION"},
    budget={"min": 1.0},
    formats={"name": "--format", "metavar": "NAME"},
    rate={"help": "Points per second in the files of --format."},
    verbose={},
)
def excite(
    call: "partial[DesignedMotion]",
    output: Annotated[Path | None, output_folder("steelyard-ROBOT-motion")] = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Design an excitation motion, and prove that it satisfies all limits.

    The excitation tables of the robot file give limits, workspace, obstacles and criterion.
    Writes trajectory.json, certificate.json, trajectory.csv and report.html. Ctrl-C ends the search
    and keeps the best motion so far. Exit code 1: a planned motion violates a limit; trajectory and
    report are written, but no controller program. Exit code 3: all that was checked is proven, but
    something was not checked (floor, links without shapes, torques), no search converged, or
    parameters are nearly inseparable; all files are written, and the summary lists what is not
    covered.

    Options:
        verbose: Print all tight limits, all motions that would reduce uncertainty, and notes.

    Example: steelyard excite panda.toml --budget 20 -o panda-motion
    """
    begun = time.monotonic()
    from steelyard.base.files import new_folder
    from steelyard.excite.excite import design_task
    from steelyard.excite.page.design_text import design_level
    from steelyard.excite.search.parallel_search import SearchBudget
    from steelyard.robot.models.xacro import stem_of

    given = dict(call.keywords)
    budget, searches, processes, seed = (
        given.pop(name) for name in ("budget", "searches", "processes", "seed")
    )
    task = design_task(**given)
    folder = new_folder(output, f"steelyard-{stem_of(given['robot'])}-motion")
    effort = SearchBudget(budget, searches, processes or os.cpu_count() or 1, seed)
    found, written = _designed(task, effort, folder, begun)
    if as_json:
        print_json(found.to_dict() | {"files": written})
    else:
        show(found, verbose)
        files = [f"{name:<12} {path}" for name, path in written.items()]
        say("\n".join(["", *files, *_withheld(task, found)]))
    if code := EXITS[design_level(found.designed)]:
        raise typer.Exit(code)


def _designed(
    task: "DesignTask", effort: "SearchBudget", folder: Path, begun: float
) -> "tuple[DesignedMotion, dict[str, str]]":
    """The design and its files, whole in a new folder; Ctrl-C ends a search and keeps its best."""
    from steelyard.base.files import whole_folder
    from steelyard.base.progress import Stopped

    try:
        with progress_bar() as progress, whole_folder(folder) as part:
            with interrupt.quietly() if task.searched else nullcontext():
                watch = _ending(progress) if task.searched else progress
                found = task.done(effort, progress=watch, since=begun)
                if not found.designed.stopped:
                    interrupt.answered()
            files = found.written_to(part)
            interrupt.too_late()
    except Stopped:
        interrupt.leave()
    return found, {name: str(folder / path) for name, path in files.items()}


def _withheld(task: "DesignTask", found: "DesignedMotion") -> list[str]:
    """A line on formats that were requested and not written."""
    missing = [form for form in task.formats if form not in found.written_formats]
    words = "the motion is not proven to satisfy all limits; do not run it"
    return [f"not written  {', '.join(missing)}: {words}"] if missing else []


def _ending(progress: "Progress") -> "Progress":
    """A watcher that lets Ctrl-C end a search, and keeps what it has found."""

    def watch(event: "Event") -> bool:
        if interrupt.stop_requested():
            interrupt.answered()
            return False
        return progress(event)

    return watch


THIS_MACHINE = "127.0.0.1"  # this machine alone


@from_function(
    trajectory={"metavar": "TRAJECTORY"},
    port={"min": 1, "max": 65535},
    speed={"min": 0.01, "max": 100.0},
)
def replay(
    robot: str, trajectory: Path, port: int = 8080, host: str = THIS_MACHINE, speed: float = 1.0
) -> None:
    r"""Animate a motion of a robot in the browser, until Ctrl-C.

    Links are drawn as their collision shapes, or as lines without one. Needs viser:
    pip install "steelyard\[replay]".

    Options:
        trajectory: Motion: trajectory.json, or a table of time and positions.
        port: Port of the page in the browser.
        host: Address to listen at; 0.0.0.0 accepts other machines.
        speed: Playback speed, relative to the motion's.

    Example: steelyard replay panda.toml panda-motion/trajectory.json
    """
    from steelyard.excite.page.browser_replay import replayed, staged
    from steelyard.excite.trajectories.trajectory_files import read_motion
    from steelyard.robot.file.robot_file import load_robot

    loaded = load_robot(robot)
    stage = staged(loaded, read_motion(trajectory, loaded.robot))
    for note in stage.notes:
        say(f"note        {note}")
    with interrupt.quietly():
        shown = replayed(stage, host, port, speed)
        typer.echo(f"replay      {shown.address}  (Ctrl-C ends it)")
        try:
            shown.run(interrupt.stop_requested)
        finally:
            shown.stop()
    interrupt.answered()
