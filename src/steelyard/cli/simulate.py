"""`steelyard simulate`: a virtual robot runs a motion and writes a log like a real one's."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json, Output, RobotArgument, Seed

if TYPE_CHECKING:
    from steelyard.robot.robot import Robot
    from steelyard.virtual.payload import Payload


@guarded
def simulate(
    robot: RobotArgument,
    motion: Annotated[
        Path | None,
        typer.Option(help="Motion to follow: trajectory.json, or a table of time and positions."),
    ] = None,
    period: Annotated[
        float, typer.Option(min=0.5, help="Seconds of random motion, without --motion.")
    ] = 10.0,
    noise: Annotated[
        float, typer.Option(min=0.0, help="Sensor noise, as a factor on that of a usual arm.")
    ] = 1.0,
    payload_mass: Annotated[
        float | None,
        typer.Option(min=1e-3, help="Carry a steel ball of so many kilograms."),
    ] = None,
    payload_frame: Annotated[
        str | None, typer.Option(help="Frame that it hangs on; the last link's, if not named.")
    ] = None,
    attach: Annotated[
        float, typer.Option(min=0.0, help="Second of the log at which it is taken.")
    ] = 0.0,
    release: Annotated[
        float, typer.Option(min=0.0, help="Second at which it is let go; never, if not given.")
    ] = float("inf"),
    seed: Seed = 0,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Simulate a robot with invented true parameters near its nominal ones.

    Its causes of torque are those of the robot file, with Coulomb and viscous
    friction where that is to be chosen. Writes log.parquet, trajectory.json and,
    in a file of its own, truth.json. The seed makes both the robot and its random
    motion: give --motion for another motion of the same robot.

    Example: steelyard simulate panda.urdf --seed 1 -o panda-run1
    """
    from steelyard.cli import interrupt, river
    from steelyard.cli.show import progress_bar
    from steelyard.excitation.files import read_motion
    from steelyard.excitation.random_fourier import random_fourier
    from steelyard.files import whole_folder
    from steelyard.robot.robot_file import load_robot
    from steelyard.virtual.invent import random_truth
    from steelyard.virtual.simulate import customary_sensors
    from steelyard.virtual.simulate import simulate as run

    loaded = load_robot(robot)
    folder = river.new_folder(output, f"steelyard-{Path(robot).stem}-simulated")
    trajectory = (
        random_fourier(loaded.robot, seed=seed, period=period)
        if motion is None
        else read_motion(motion, loaded.robot)
    )
    terms = river.with_friction(river.model_of(loaded), loaded).terms
    truth = random_truth(loaded.robot, seed, terms=terms)
    sensors = customary_sensors(loaded.robot, truth, noise)
    if loaded.signals is not None and any(loaded.signals.unknown_gains):
        sensors = sensors.with_random_gains(loaded.robot.n, seed)
    load = _payload(loaded.robot, payload_mass, payload_frame, attach, release)
    with progress_bar() as progress, whole_folder(folder) as part:
        files = run(
            loaded.robot,
            truth,
            trajectory,
            sensors,
            part,
            seed=seed,
            signals=loaded.signals,
            payload=load,
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


def _payload(
    robot: "Robot", mass: float | None, frame: str | None, attach: float, release: float
) -> "Payload | None":
    """The load that the options describe.

    Raises:
        ModelError: It has no mass, or cannot be carried.
    """
    from steelyard.errors import ModelError
    from steelyard.virtual.payload import Payload

    if mass is not None:
        named = [f.name for f in robot.frames] or [b.name for b in robot.bodies]
        return Payload.ball(mass, named[-1] if frame is None else frame, attach, release)
    if frame is not None or attach > 0.0 or release < float("inf"):
        raise ModelError(
            "a payload is taken, but it has no mass",
            where="--payload-frame, --attach or --release",
            mend="add --payload-mass KG",
        )
    return None
