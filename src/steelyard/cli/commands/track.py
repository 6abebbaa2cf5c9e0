"""`steelyard track`: a simulated robot under control with and without an identified model."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import FixedBase, FrictionDrift, Json, RobotArgument, Seed, output_folder


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

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.motion.track import track as tracked
    from steelyard.robot.xacro.read import stem_of

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
