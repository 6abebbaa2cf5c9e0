"""The commands of motions, `excite` and `replay`, and of simulated robots."""

import time
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.base.files import new_folder, whole_folder
from steelyard.base.progress import Event, Progress, Stopped
from steelyard.cli import interrupt
from steelyard.cli import shared_by_commands as shared
from steelyard.cli.commands_from_functions import from_function

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.excite.excite import DesignedMotion, DesignTask
    from steelyard.excite.search.parallel_search import SearchBudget
    from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
    from steelyard.identify.identify import Identification
    from steelyard.report.result import Result
    from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
    from steelyard.simulate.simulate import SimulatedRun

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
    output: Annotated[Path | None, shared.output_folder("steelyard-ROBOT-motion")] = None,
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
    from steelyard.excite.excite import design_task
    from steelyard.excite.page.design_text import design_level
    from steelyard.excite.search.parallel_search import SearchBudget

    given = dict(call.keywords)
    effort = SearchBudget(*(given.pop(x) for x in ("budget", "searches", "processes", "seed")))
    task = design_task(**given)
    folder = shared.robot_folder(output, given["robot"], "-motion")
    found, written = _designed(task, effort, folder, begun)
    if as_json:
        shared.print_json(found.to_dict() | {"files": written})
    else:
        shared.show(found, verbose)
        lines = ["", *(f"{name:<12} {path}" for name, path in written.items())]
        if withheld := [form for form in task.formats if form not in found.written_formats]:
            words = "the motion is not proven to satisfy all limits; do not run it"
            lines.append(f"not written  {', '.join(withheld)}: {words}")
        shared.say("\n".join(lines))
    if code := EXITS[design_level(found.designed)]:
        raise typer.Exit(code)


def _designed(
    task: "DesignTask", effort: "SearchBudget", folder: Path, begun: float
) -> "tuple[DesignedMotion, dict[str, str]]":
    """The design and its files, whole in a new folder; Ctrl-C ends a search and keeps its best."""
    try:
        with shared.progress_bar() as progress, whole_folder(folder) as part:
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


def _ending(progress: Progress) -> Progress:
    """A watcher that lets Ctrl-C end a search, and keeps what it has found."""

    def watch(event: Event) -> bool:
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
        shared.say(f"note        {note}")
    with interrupt.quietly():
        shown = replayed(stage, host, port, speed)
        typer.echo(f"replay      {shown.address}  (Ctrl-C ends it)")
        try:
            shown.run(interrupt.stop_requested)
        finally:
            shown.stop()
    interrupt.answered()


FACTOR = {"metavar": "FACTOR"}


@from_function(
    "steelyard:simulate",
    folder=None,
    dry_run=FACTOR,
    noise={**FACTOR, "max": 1000},
    friction_drift={**FACTOR, "max": 1000},
    control={"metavar": "KIND"},
    model={"metavar": "MODEL"},
    wrench={"metavar": "FILE"},
    wrench_axes={"metavar": "NAME"},
)
def simulate(
    call: "partial[SimulatedRun]",
    output: Annotated[Path | None, shared.output_folder("steelyard-ROBOT-simulated")] = None,
    as_json: bool = False,
) -> None:
    """Simulate a robot with random true parameters near the nominal ones, and log it.

    Follows any motion written by excite or simulate, or a table of positions; --dry-run slows it
    down. Torque terms are those of the robot file, with Coulomb and viscous friction if its
    friction is "auto". Writes log.csv, trajectory.json and truth.json (the true parameters).
    With --control or --model the log has the desired motion and the commanded torques too, with
    --wrench the readings of a force and torque sensor, along the axes of its frame.
    The seed determines the robot and its random motion: give --motion for another motion of the
    same robot.

    Example: steelyard simulate panda.urdf --seed 1 -o panda-run1
    """
    given = call.keywords
    periods, dry_run, truth = (given[name] for name in ("periods", "dry_run", "truth"))
    folder = shared.robot_folder(output, given["robot"], "-simulated")
    with shared.progress_bar() as progress, whole_folder(folder) as part:
        made = call(folder=part, progress=progress)
        interrupt.too_late()
    written = {name: str(folder / path.name) for name, path in vars(made.files).items()}
    if as_json:
        shared.print_json(written)
        return
    lines = [f"note        {note}" for note in made.notes]
    if periods > 1:
        lines.append(f"periods     {periods} of {made.seconds:g} s")
    if dry_run < 1.0:
        full = made.seconds * periods
        slow = f"{full / dry_run:g} s, not {full:g} s"
        lines.append(f"dry run     at {dry_run:g} of the speed: {slow}")
    another = "another seed is another robot); for another motion of this robot give --motion"
    seed = f"seed {given['seed']} ({another}"
    lines.append(f"robot       {truth or seed}")
    shared.say("\n".join([*lines, *(f"{name:<11} {path}" for name, path in written.items())]))


@from_function(
    "steelyard:track",
    motion={"help": "trajectory.json, or a table of time and positions."},
    model={
        "help": f"Identified model: {shared.MODEL_HELP[:-1]}; several with --model A --model B.",
        "metavar": "MODEL",
    },
    control={"metavar": "KIND"},
    friction_drift={**FACTOR, "max": 1000},
    lag={"max": 1},
    tool={"metavar": "NAME"},
)
def track(
    call: "partial[Result]",
    output: Annotated[Path | None, shared.output_folder("steelyard-ROBOT-tracking")] = None,
    as_json: bool = False,
) -> None:
    """Simulate a robot under control, with and without an identified model.

    pd, pid and cascade get the torques of the model along the motion as feedforward;
    computed_torque computes with the model at every tick, and is compared with joint PD control
    of the same gains. The controller sees quantised, delayed positions. Writes tracking.html
    and tracking.json.

    Example: steelyard track panda.toml motion.json --model panda-model -o panda-tracking
    """
    folder = shared.robot_folder(output, call.keywords["robot"], "-tracking")
    found = shared.computed(call, folder)
    if as_json:
        shared.print_json({**found.to_dict(), "output": str(folder)})
        return
    shared.show(found)
    typer.echo(shared.file_lines(folder, page="tracking.html", JSON="tracking.json"))


DESIGN_SEARCHES = 2  # searches after which the design of the motion ends, on a busy machine as well
DESIGN_TIME = 120.0  # seconds after which it ends in any case


@from_function()
def demo(
    output: Annotated[Path | None, shared.output_folder("steelyard-demo")] = None,
    seed: int = 0,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Demonstration on a simulated arm: design a motion, identify, validate.

    Example: steelyard demo -o first-try
    """
    from steelyard.excite.excite import DesignedMotion, DesignTask
    from steelyard.excite.search.parallel_search import SearchBudget
    from steelyard.identify.identify import identify
    from steelyard.model.model import model_with_open_friction
    from steelyard.report.terminal import terminal
    from steelyard.simulate.simulate import demo_runs

    folder = new_folder(output, "steelyard-demo")
    found: list[DesignedMotion] = []
    with shared.progress_bar() as progress, whole_folder(folder) as part:

        def designed(loaded: "LoadedRobot") -> "ExactTrajectory":
            effort = SearchBudget(DESIGN_TIME, DESIGN_SEARCHES, None, seed)
            tables = (loaded, model_with_open_friction(loaded), None)
            task = DesignTask(tables, ("csv",), None)
            found.append(task.done(effort, progress=progress))
            (part / "motion").mkdir()
            found[0].write(part / "motion")
            return found[0].trajectory

        runs = demo_runs(part / "robot", seed, progress, design=designed)
        identified = identify(
            runs.robot, runs.identification, validate=runs.validation, progress=progress
        )
        identified = identified.beside(runs.parameters)
        (part / "results").mkdir()
        identified.write(part / "results")
        interrupt.too_late()
    if as_json:
        motion = found[0].to_dict() | {"output": str(folder / "motion")}
        numbers = identified.to_dict() | {"motion": motion}
        shared.print_json({"output": str(folder / "results"), **numbers})
        return
    console = terminal()
    if verbose:
        found[0].show(console, verbose)
        console.print()
        identified.show(console, verbose)
    else:
        _show(found[0], identified, console)
    typer.echo(
        "\nyour own robot: steelyard init URDF LOG, steelyard check ROBOT LOG..., then identify\n"
        f"robot file, logs, true parameters      {folder / 'robot'}\n"
        f"designed motion and its report         {folder / 'motion' / 'report.html'}\n"
        f"model                                  {folder / 'results' / 'model.json'}\n"
        f"report                                 {folder / 'results' / 'report.html'}"
    )


def _show(motion: "DesignedMotion", found: "Identification", console: "Console") -> None:
    """Print whether the motion is safe, the error of the model, and how near it is to the truth."""
    from steelyard.excite.page.design_text import design_headline
    from steelyard.identify.page.parameters_and_truth import TruthSection
    from steelyard.identify.page.verdict_and_joint_errors import VerdictSection

    shared.print_lines(design_headline(motion.designed))
    parts = [*VerdictSection().printed(found.content), *TruthSection().printed(found.content)]
    for number, part in enumerate(parts):
        if number:
            console.print()
        console.print(part)
