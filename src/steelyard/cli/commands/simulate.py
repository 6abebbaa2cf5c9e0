"""`steelyard simulate`: a virtual robot runs a motion and writes a log like a real one's."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import FixedBase, FrictionDrift, Json, RobotArgument, Seed, output_folder


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
    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.motion.simulate import simulate as simulated
    from steelyard.robot.xacro.read import stem_of

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
