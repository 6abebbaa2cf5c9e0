"""A virtual robot runs a motion and writes a log: what `steelyard simulate` does."""

from dataclasses import dataclass
from pathlib import Path

from steelyard.arguments import checked
from steelyard.errors import DataError, ModelError
from steelyard.excitation.trajectories.chained import repeated
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.trajectories.files import read_motion
from steelyard.excitation.trajectories.random_fourier import random_fourier
from steelyard.excitation.trajectories.slowed import SlowedMotion
from steelyard.identification.logs import model_of, with_friction
from steelyard.progress import Progress, silent
from steelyard.robot.robot import Robot
from steelyard.robot_file.file import load_robot
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.robot_file.signals import ROW
from steelyard.virtual.invent import random_truth
from steelyard.virtual.payload import Payload
from steelyard.virtual.simulate import SimulatedFiles, customary_sensors
from steelyard.virtual.simulate import simulate as simulate_robot

PERIOD = 10.0
"""Length of a random motion [s], if none is given."""

_LONGEST = 24.0 * 3600.0
"""Robot time that a run may take [s]."""

_ALIKE = (("position", "", 1e-9), ("speed", "/s", 1e-6))
"""What must be the same at both ends of a motion to be repeated, its unit, how closely."""


@dataclass(frozen=True)
class SimulatedRun:
    """A simulated run.

    Attributes:
        files: What was written.
        notes: What was assumed of the robot.
        seconds: Length of the motion that was repeated or slowed [s].
    """

    files: SimulatedFiles
    notes: tuple[str, ...]
    seconds: float


@checked(period=0.5, periods=1, noise=0.0, payload_mass=1e-3, attach=0.0, release=0.0, seed=0)
def simulate(
    robot: str | Path | LoadedRobot,
    folder: str | Path,
    motion: str | Path | None = None,
    *,
    period: float | None = None,
    periods: int = 1,
    dry_run: float = 1.0,
    noise: float = 1.0,
    payload_mass: float | None = None,
    payload_frame: str | None = None,
    attach: float = 0.0,
    release: float = float("inf"),
    fixed_base: str | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> SimulatedRun:
    """Simulate a robot with random true parameters near the nominal ones, and log it.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        folder: Folder to make, for `log.csv`, `trajectory.json` and `truth.json`.
        motion: Motion to follow, a `trajectory.json` or a table of postures; a random one if
            `None`.
        period: Length of the random motion [s], 10 if `None`.
        periods: Number of periods.
        dry_run: Speed relative to the motion's, at most 1.
        noise: Sensor noise relative to that of a typical arm.
        payload_mass: Mass of the payload, a steel sphere [kg]; `None` for none.
        payload_frame: Frame of the payload; that of the last link if `None`.
        attach: Time at which it is attached [s].
        release: Time at which it is released [s].
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        seed: Same seed, same robot and same random motion.
        progress: Receives events of progress; when it requests a stop, nothing is written.

    Raises:
        SteelyardError: A file cannot be used, or the folder is there and not empty.
        Stopped: `progress` requested a stop.

    Example:
        >>> run = simulate("arm.toml", "run2", seed=2, period=5.0)
        >>> run.files.log.name
        'log.csv'
    """
    loaded = load_robot(robot, base=fixed_base)
    _check_factor(dry_run)
    once = _once(loaded.robot, motion, period, periods, dry_run, seed)
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
    files = simulate_robot(
        loaded.robot,
        truth,
        trajectory,
        sensors,
        Path(folder),
        seed=seed,
        signals=loaded.signals,
        payload=load,
        progress=progress,
    )
    return SimulatedRun(files, loaded.notes, once.duration)


def _once(
    robot: Robot,
    motion: str | Path | None,
    period: float | None,
    periods: int,
    dry_run: float,
    seed: int,
) -> ExactTrajectory:
    """The motion that is given, or a random one.

    Raises:
        DataError: A period is given together with a motion, or the run takes too long.
    """
    if motion is None:
        seconds = PERIOD if period is None else period
        _check_length(seconds, periods, dry_run)
        return random_fourier(robot, seed=seed, period=seconds)
    if period is not None:
        raise DataError(
            "a period of the random motion is given together with a motion",
            where="--period with --motion",
            fix="leave out one of the two",
        )
    return read_motion(Path(motion), robot)


def _repeated(trajectory: ExactTrajectory, robot: Robot, periods: int) -> ExactTrajectory:
    """The motion several times without a stop.

    Raises:
        DataError: It does not end where and as it starts.
    """
    for order, (what, unit, close) in enumerate(_ALIKE):
        first, last = trajectory.derivative([0.0, trajectory.duration], order)
        jumps = abs(last - first)
        worst = int(jumps.argmax())
        if periods > 1 and jumps[worst] > close:
            joint = robot.coordinates[worst]
            raise DataError(
                f"{periods} periods are requested, but the motion does not end as it starts: joint "
                f"'{joint.name}' begins with {what} {first[worst]:.4g} {joint.unit}{unit} and "
                f"ends with {last[worst]:.4g} {joint.unit}{unit}",
                where="--periods",
                fix="leave it out, or give a motion that returns to its start",
            )
    return repeated(trajectory, periods)


def _check_factor(factor: float) -> None:
    """A dry run is slower than the motion.

    Raises:
        DataError: It is not.
    """
    if not 0.0 < factor <= 1.0:
        raise DataError(
            f"a dry run at {factor:g} of the speed is not slower than the motion",
            where="--dry-run",
            fix="give a number above 0 and at most 1, such as 0.2",
        )


def _check_length(once: float, periods: int, factor: float) -> None:
    """The run takes a day of robot time at most.

    Raises:
        DataError: It takes longer.
    """
    seconds = once * periods / factor
    if not seconds <= _LONGEST:
        raise DataError(
            f"the run would be {seconds / 3600.0:.4g} hours long: {periods} times {once:g} s at "
            f"{factor:g} of the speed; a log holds 24 hours at most",
            where="--period, --motion, --periods or --dry-run",
            fix="give fewer periods, a faster dry run, or a shorter motion",
        )


def _slowed(trajectory: ExactTrajectory, factor: float) -> ExactTrajectory:
    """The motion at a share of its speed."""
    return trajectory if factor == 1.0 else SlowedMotion(trajectory, factor)


def _payload(
    robot: Robot, mass: float | None, frame: str | None, attach: float, release: float
) -> Payload | None:
    """The load that the options describe.

    Raises:
        ModelError: It has no mass, or cannot be carried.
    """
    from steelyard.virtual.payload import Payload

    if mass is not None:
        named = [f.name for f in robot.frames] or [b.name for b in robot.bodies]
        return Payload.ball(mass, named[-1] if frame is None else frame, attach, release)
    if frame is not None or attach > 0.0 or release < float("inf"):
        raise ModelError(
            "a payload is attached, but it has no mass",
            where="--payload-frame, --attach or --release",
            fix="add --payload-mass KG",
        )
    return None
