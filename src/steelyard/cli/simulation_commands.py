"""The commands `simulate`, `track` and `demo`, on simulated robots."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.command import (
    Details,
    FixedBase,
    FrictionDrift,
    Json,
    RobotArgument,
    Seed,
    guarded,
    output_folder,
)

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.excite.excite import DesignedMotion
    from steelyard.excite.trajectories.trajectory import ExactTrajectory
    from steelyard.identify.identify import Identification
    from steelyard.robot.file.loaded_robot import LoadedRobot


@guarded
def simulate(
    robot: RobotArgument,
    motion: Annotated[
        Path | None,
        typer.Option(help="Motion to follow: trajectory.json, or a table of time and positions."),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(
            min=0.5,
            metavar="SECONDS",
            help="Duration of random motion without --motion; 10 if unset.",
        ),
    ] = None,
    periods: Annotated[
        int, typer.Option(min=1, help="Number of periods, without a stop between them.")
    ] = 1,
    dry_run: Annotated[
        float,
        typer.Option(
            help="Speed factor for a first run: 0.2 takes five times as long.",
            metavar="FACTOR",
        ),
    ] = 1.0,
    noise: Annotated[
        float,
        typer.Option(
            min=0,
            max=1000,
            metavar="FACTOR",
            help="Sensor noise, relative to that of a typical arm.",
        ),
    ] = 1.0,
    payload_mass: Annotated[
        float | None,
        typer.Option(min=1e-3, metavar="KG", help="Mass of the payload, a steel sphere."),
    ] = None,
    payload_frame: Annotated[
        str | None, typer.Option(help="Frame of the payload; that of the last link if unset.")
    ] = None,
    attach: Annotated[
        float,
        typer.Option(min=0, metavar="SECONDS", help="Time at which the payload is attached."),
    ] = 0.0,
    release: Annotated[
        float,
        typer.Option(
            min=0, metavar="SECONDS", help="Time at which it is released; never if unset."
        ),
    ] = float("inf"),
    truth: Annotated[
        Path | None,
        typer.Option(
            help="truth.json of another simulation: the same robot again.", metavar="FILE"
        ),
    ] = None,
    friction_drift: FrictionDrift = 1.0,
    rate: Annotated[
        float | None,
        typer.Option(help="Rows per second of the log; 250 if unset, or as the robot file says."),
    ] = None,
    control: Annotated[
        str | None,
        typer.Option(
            help="pd, pid, cascade or computed_torque, with encoders, delay and lag of real "
            "drives; gains follow: cascade,kv=20. If unset, joint PD control with ideal encoders "
            "and drives.",
            metavar="KIND",
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            help="Identified model for torque feedforward or computed_torque: model.json, or the "
            "folder that contains it.",
            metavar="MODEL",
        ),
    ] = None,
    wrench: Annotated[
        Path | None,
        typer.Option(
            help="Table of an external wrench, each row until the next one: time_s, fx_N, fy_N, "
            "fz_N, tx_Nm, ty_Nm, tz_Nm.",
            metavar="FILE",
        ),
    ] = None,
    wrench_frame: Annotated[
        str | None, typer.Option(help="Frame that it acts on; that of the last link if unset.")
    ] = None,
    wrench_axes: Annotated[
        str, typer.Option(help="Axes of the table: base or frame.", metavar="NAME")
    ] = "base",
    fixed_base: FixedBase = None,
    seed: Seed = 0,
    output: Annotated[Path | None, output_folder("steelyard-ROBOT-simulated")] = None,
    as_json: Json = False,
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
    from steelyard.base.files import new_folder, whole_folder
    from steelyard.cli import interrupt
    from steelyard.cli.command import progress_bar
    from steelyard.robot.models.xacro import stem_of
    from steelyard.simulate.simulate import simulate as simulated

    folder = new_folder(output, f"steelyard-{stem_of(robot)}-simulated")
    with progress_bar() as progress, whole_folder(folder) as part:
        made = simulated(
            robot,
            part,
            motion,
            period=period,
            periods=periods,
            dry_run=dry_run,
            noise=noise,
            payload_mass=payload_mass,
            payload_frame=payload_frame,
            attach=attach,
            release=release,
            truth=truth,
            friction_drift=friction_drift,
            rate=rate,
            control=control,
            model=model,
            wrench=wrench,
            wrench_frame=wrench_frame,
            wrench_axes=wrench_axes,
            fixed_base=fixed_base,
            seed=seed,
            progress=progress,
        )
        interrupt.too_late()
    written = {name: str(folder / path.name) for name, path in vars(made.files).items()}
    if as_json:
        typer.echo(json.dumps(written))
        return
    notes = (f"note        {note}" for note in made.notes)
    running = _running(made.seconds, periods, dry_run)
    files = (f"{name:<11} {path}" for name, path in written.items())
    typer.echo("\n".join([*notes, *running, _robot(seed, truth), *files]))


def _robot(seed: int, truth: Path | None) -> str:
    """Which robot was simulated, and how to simulate it again."""
    if truth is not None:
        return f"robot       {truth}"
    return (
        f"robot       seed {seed} (another seed is another robot); for another motion of this "
        "robot give --motion"
    )


def _running(once: float, periods: int, factor: float) -> list[str]:
    """What is run otherwise than the motion says, a line each."""
    lines = [f"periods     {periods} of {once:g} s"] if periods > 1 else []
    if factor < 1.0:
        full = once * periods
        lines.append(f"dry run     at {factor:g} of the speed: {full / factor:g} s, not {full:g} s")
    return lines


@guarded
def track(
    robot: RobotArgument,
    motion: Annotated[
        Path,
        typer.Argument(help="trajectory.json, or a table of time and positions.", metavar="MOTION"),
    ],
    model: Annotated[
        list[str] | None,
        typer.Option(
            "--model",
            help="Identified model: model.json, or the folder that contains it; several with "
            "--model A --model B.",
            metavar="MODEL",
        ),
    ] = None,
    control: Annotated[
        str,
        typer.Option(
            help="pd, pid, cascade or computed_torque; gains follow: computed_torque,kp=100,kv=5.",
            metavar="KIND",
        ),
    ] = "cascade",
    truth: Annotated[
        Path | None,
        typer.Option(
            help="truth.json of a simulation; if unset, random true parameters near the nominal "
            "ones.",
            metavar="FILE",
        ),
    ] = None,
    friction_drift: FrictionDrift = 1.0,
    lag: Annotated[
        float,
        typer.Option(min=0, max=1, metavar="SECONDS", help="Time constant of the drives' torque."),
    ] = 0.002,
    tool: Annotated[
        str | None,
        typer.Option(
            help="Frame whose path is compared; that of the last link if unset.", metavar="NAME"
        ),
    ] = None,
    fixed_base: FixedBase = None,
    seed: Seed = 0,
    output: Annotated[Path | None, output_folder("steelyard-ROBOT-tracking")] = None,
    as_json: Json = False,
) -> None:
    """Simulate a robot under control, with and without an identified model.

    pd, pid and cascade get the torques of the model along the motion as feedforward;
    computed_torque computes with the model at every tick, and is compared with joint PD control
    of the same gains. The controller sees quantised, delayed positions. Writes tracking.html
    and tracking.json.

    Example: steelyard track panda.toml motion.json --model panda-model -o panda-tracking
    """
    from rich.console import Console

    from steelyard.base.files import new_folder, whole_folder
    from steelyard.cli import interrupt
    from steelyard.cli.command import progress_bar
    from steelyard.robot.models.xacro import stem_of
    from steelyard.simulate.track import track as tracked

    folder = new_folder(output, f"steelyard-{stem_of(robot)}-tracking")
    with progress_bar() as progress, whole_folder(folder) as part:
        found = tracked(
            robot,
            motion,
            model or (),
            control=control,
            truth=truth,
            friction_drift=friction_drift,
            lag=lag,
            tool=tool,
            fixed_base=fixed_base,
            seed=seed,
            progress=progress,
        )
        found.write(part)
        interrupt.too_late()
    if as_json:
        typer.echo(json.dumps({**found.to_dict(), "output": str(folder)}, allow_nan=False))
        return
    found.show(Console())
    typer.echo(f"page  {folder / 'tracking.html'}\nJSON  {folder / 'tracking.json'}")


DESIGN_SEARCHES = 2
"""Searches after which the design of the motion ends, on a busy machine as well."""

DESIGN_TIME = 120.0
"""Seconds after which it ends in any case."""


@guarded
def demo(
    output: Annotated[Path | None, output_folder("steelyard-demo")] = None,
    seed: Seed = 0,
    verbose: Details = False,
    as_json: Json = False,
) -> None:
    """Demonstration on a simulated arm: design a motion, identify, validate.

    Example: steelyard demo -o first-try
    """
    from rich.console import Console

    from steelyard.base.files import new_folder, whole_folder
    from steelyard.cli import interrupt
    from steelyard.cli.command import progress_bar
    from steelyard.excite.excite import DesignedMotion, DesignTask
    from steelyard.excite.search.parallel_search import SearchBudget
    from steelyard.identify.identify import identify
    from steelyard.model.robot_file_model import model_with_open_friction
    from steelyard.simulate.demo import demo_runs, true_parameters

    folder = new_folder(output, "steelyard-demo")
    found: list[DesignedMotion] = []
    with progress_bar() as progress, whole_folder(folder) as part:

        def designed(loaded: "LoadedRobot") -> "ExactTrajectory":
            effort = SearchBudget(DESIGN_TIME, DESIGN_SEARCHES, os.cpu_count() or 1, seed)
            task = DesignTask(loaded, model_with_open_friction(loaded), None, ("csv",), None)
            found.append(task.done(effort, progress=progress))
            (part / "motion").mkdir()
            found[0].write(part / "motion")
            return found[0].trajectory

        runs = demo_runs(part / "robot", seed, progress, design=designed)
        identified = identify(
            runs.robot, runs.identification, validate=runs.validation, progress=progress
        )
        identified = identified.beside(true_parameters(runs))
        (part / "results").mkdir()
        identified.write(part / "results")
        interrupt.too_late()
    if as_json:
        motion = found[0].to_dict() | {"output": str(folder / "motion")}
        content = {"output": str(folder / "results"), **identified.to_dict(), "motion": motion}
        typer.echo(json.dumps(content, allow_nan=False))
        return
    console = Console()
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
    from rich.text import Text

    from steelyard.excite.page.design_words import design_headline
    from steelyard.identify.page.parameter_table import TruthSection
    from steelyard.identify.page.verdict_section import VerdictSection

    console.print(Text(design_headline(motion.designed)))
    parts = [
        part
        for section in (VerdictSection(), TruthSection())
        for part in section.printed(found.content)
    ]
    for number, part in enumerate(parts):
        if number:
            console.print()
        console.print(part)
