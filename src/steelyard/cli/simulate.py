"""`steelyard simulate`: a virtual robot runs a motion and writes a log like a real one's."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import FixedBase, Json, Output, RobotArgument, Seed

if TYPE_CHECKING:
    from steelyard.excitation.trajectories.exact import ExactTrajectory
    from steelyard.robot.robot import Robot
    from steelyard.virtual.payload import Payload


_LONGEST = 24.0 * 3600.0
"""Robot time that a run may take [s]."""

_ALIKE = (("position", "", 1e-9), ("speed", "/s", 1e-6))
"""What must be the same at both ends of a motion to be repeated, its unit, how closely."""


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
    periods: Annotated[
        int, typer.Option(min=1, help="How often the motion is run through, without a stop.")
    ] = 1,
    dry_run: Annotated[
        float,
        typer.Option(
            help="Share of the speed, for a first run: 0.2 takes five times as long.",
            metavar="FACTOR",
        ),
    ] = 1.0,
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
    fixed_base: FixedBase = None,
    seed: Seed = 0,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Simulate a robot with invented true parameters near its nominal ones.

    It follows any motion that excite or simulate wrote, or a table of postures; --dry-run
    follows it slowly. Its causes of torque are those of the robot file, with Coulomb and viscous
    friction where that is to be chosen. Writes log.parquet, trajectory.json and,
    in a file of its own, truth.json. The seed makes both the robot and its random
    motion: give --motion for another motion of the same robot.

    Example: steelyard simulate panda.urdf --seed 1 -o panda-run1
    """
    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.excitation.trajectories.files import read_motion
    from steelyard.excitation.trajectories.random_fourier import random_fourier
    from steelyard.files import whole_folder
    from steelyard.identification.logs import model_of, new_folder, with_friction
    from steelyard.robot_file.file import load_robot
    from steelyard.robot_file.signals import ROW
    from steelyard.virtual.invent import random_truth
    from steelyard.virtual.simulate import customary_sensors
    from steelyard.virtual.simulate import simulate as run

    loaded = load_robot(robot, base=fixed_base)
    folder = new_folder(output, f"steelyard-{loaded.stem}-simulated")
    _check_factor(dry_run)
    if motion is None:
        _check_length(period, periods, dry_run)
    once = (
        random_fourier(loaded.robot, seed=seed, period=period)
        if motion is None
        else read_motion(motion, loaded.robot)
    )
    _check_length(once.duration, periods, dry_run)
    trajectory = _slowed(_repeated(once, loaded.robot, periods), dry_run)
    terms = with_friction(model_of(loaded), loaded).terms
    truth = random_truth(loaded.robot, seed, terms=terms)
    sensors = customary_sensors(loaded.robot, truth, noise)
    if loaded.signals is not None and any(loaded.signals.unknown_gains):
        sensors = sensors.with_random_gains(loaded.robot.n, seed)
    if loaded.signals is not None and loaded.signals.time == ROW:
        sensors = sensors.with_even_rows(1.0 / loaded.signals.time_scale)
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
    for line in _running(once.duration, periods, dry_run):
        typer.echo(line)
    typer.echo(
        f"robot       the one of seed {seed}: another seed is another robot; for another motion of "
        "this one give --motion"
    )
    for name, path in written.items():
        typer.echo(f"{name:<11} {path}")


def _repeated(trajectory: "ExactTrajectory", robot: "Robot", periods: int) -> "ExactTrajectory":
    """The motion several times without a stop.

    Raises:
        DataError: It does not end where and as it starts.
    """
    from steelyard.errors import DataError
    from steelyard.excitation.trajectories.chained import repeated

    for order, (what, unit, close) in enumerate(_ALIKE):
        first, last = trajectory.derivative([0.0, trajectory.duration], order)
        jumps = abs(last - first)
        worst = int(jumps.argmax())
        if periods > 1 and jumps[worst] > close:
            joint = robot.coordinates[worst]
            raise DataError(
                f"{periods} periods are asked for, but the motion does not end as it starts: joint "
                f"'{joint.name}' begins with {what} {first[worst]:.4g} {joint.unit}{unit} and "
                f"ends with {last[worst]:.4g} {joint.unit}{unit}",
                where="--periods",
                mend="leave it out, or give a motion that returns to its start",
            )
    return repeated(trajectory, periods)


def _check_factor(factor: float) -> None:
    """A dry run is slower than the motion.

    Raises:
        DataError: It is not.
    """
    from steelyard.errors import DataError

    if not 0.0 < factor <= 1.0:
        raise DataError(
            f"a dry run at {factor:g} of the speed is not slower than the motion",
            where="--dry-run",
            mend="give a number above 0 and at most 1, such as 0.2",
        )


def _check_length(once: float, periods: int, factor: float) -> None:
    """The run takes a day of robot time at most.

    Raises:
        DataError: It takes longer.
    """
    from steelyard.errors import DataError

    seconds = once * periods / factor
    if not seconds <= _LONGEST:
        raise DataError(
            f"the run would be {seconds / 3600.0:.4g} hours long: {periods} times {once:g} s at "
            f"{factor:g} of the speed; a log holds 24 hours at most",
            where="--period, --motion, --periods or --dry-run",
            mend="ask for fewer periods, a dry run less slow, or a shorter motion",
        )


def _slowed(trajectory: "ExactTrajectory", factor: float) -> "ExactTrajectory":
    """The motion at a share of its speed."""
    from steelyard.excitation.trajectories.slowed import SlowedMotion

    return trajectory if factor == 1.0 else SlowedMotion(trajectory, factor)


def _running(once: float, periods: int, factor: float) -> list[str]:
    """What is run otherwise than the motion says, a line each."""
    lines = [f"periods     {periods} of {once:g} s"] if periods > 1 else []
    if factor < 1.0:
        full = once * periods
        lines.append(f"dry run     at {factor:g} of the speed: {full / factor:g} s, not {full:g} s")
    return lines


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
