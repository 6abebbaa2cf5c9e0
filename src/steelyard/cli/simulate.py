"""`steelyard simulate`: a virtual robot runs a motion and writes a log like a real one's."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json, Output, RobotArgument, Seed


@guarded
def simulate(
    robot: RobotArgument,
    motion: Annotated[
        Path | None,
        typer.Option(help="Motion to follow: trajectory.json, or a table of time and positions."),
    ] = None,
    period: Annotated[
        float, typer.Option(min=0.5, help="Length of the random motion [s], without --motion.")
    ] = 10.0,
    noise: Annotated[
        float, typer.Option(min=0.0, help="Sensor noise, as a factor on that of a usual arm.")
    ] = 1.0,
    seed: Seed = 0,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Simulate a robot with invented true parameters near its nominal ones.

    Writes log.parquet, trajectory.json and, in a file of its own, truth.json.

    Example: steelyard simulate panda.urdf --seed 1 -o panda-run1
    """
    from steelyard.cli import interrupt, river
    from steelyard.cli.show import progress_bar
    from steelyard.excitation.files import read_motion
    from steelyard.excitation.random_fourier import random_fourier
    from steelyard.files import whole_folder
    from steelyard.robot.robot_file import load_robot
    from steelyard.virtual.simulate import customary_sensors
    from steelyard.virtual.simulate import simulate as run
    from steelyard.virtual.truth import random_truth

    loaded = load_robot(robot)
    folder = river.new_folder(output, f"steelyard-{Path(robot).stem}-simulated")
    trajectory = (
        random_fourier(loaded.robot, seed=seed, period=period)
        if motion is None
        else read_motion(motion, loaded.robot)
    )
    truth = random_truth(loaded.robot, seed)
    sensors = customary_sensors(loaded.robot, truth, noise)
    with progress_bar() as progress, whole_folder(folder) as part:
        files = run(
            loaded.robot,
            truth,
            trajectory,
            sensors,
            part,
            seed=seed,
            signals=loaded.signals,
            progress=progress,
        )
        interrupt.too_late()
    written = {name: str(folder / path.name) for name, path in vars(files).items()}
    if as_json:
        typer.echo(json.dumps(written))
        return
    for note in loaded.notes:
        typer.echo(f"note        {note}")
    for name, path in written.items():
        typer.echo(f"{name:<11} {path}")
