r"""A virtual robot runs a motion and writes a log, as `steelyard simulate` and the demo do."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array, Parameters
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, ModelError
from steelyard.base.files import whole_folder, write_json
from steelyard.base.motion import run
from steelyard.base.progress import Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.excite.collision.workspace_from_tables import workspace_of
from steelyard.excite.trajectories.exact_trajectories import (
    ExactTrajectory,
    SlowedMotion,
)
from steelyard.excite.trajectories.fourier import FourierMotion, random_fourier, repeated
from steelyard.excite.trajectories.trajectory_files import read_motion, write_motion
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.model.model import model_with_open_friction, with_friction
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import ROW
from steelyard.robot.robot import Robot, refuse_floating
from steelyard.simulate.drives_sensors_and_loads import (
    AppliedWrench,
    Axes,
    Payload,
    Sensors,
    customary_drives,
    read_wrench,
)
from steelyard.simulate.ground_truth import Truth, random_truth, read_truth
from steelyard.simulate.virtual_robot import (
    SimulatedFiles,
    VirtualRobot,
    customary_sensors,
    write_run,
)
from steelyard.uses.control.feedforward import refuse_other_robot, refuse_unknown_gains
from steelyard.uses.control.joint_controllers import PD, Control, control_of

LARGEST_LIMIT_SHARE = 0.9  # of the limits that a random motion uses, where the table has room


@dataclass(frozen=True)
class DemoFiles:
    """What the demonstration works on, and all standard parameters of the simulated arm."""

    robot: Path
    identification: Path
    validation: Path
    parameters: Parameters


def demo_runs(
    folder: Path,
    seed: int = 0,
    progress: Progress = silent,
    *,
    period: float = 10.0,
    design: Callable[[LoadedRobot], ExactTrajectory] | None = None,
) -> DemoFiles:
    """Simulate two runs of the demo arm and write all that identification needs.

    The folder appears whole, when all is done, or not at all. The motion to identify from is that
    of `design`, or a random one, run twice, whose period is `period` [s]; `seed` is that of the
    truth, the motions and the noise.
    """
    names = ("identification", "validation")
    with whole_folder(folder) as part:
        loaded = write_demo_arm(part)
        robot = loaded.robot
        designed = None if design is None else design(loaded)
        truth = random_truth(robot, seed)
        sensors = customary_sensors(robot, truth)
        rig = VirtualRobot(robot, truth, sensors, seed=seed, progress=progress)
        for number, name in enumerate(names):
            motion: ExactTrajectory = _above_table(loaded, 2 * seed + number, period)
            if name == "identification":
                motion = repeated(motion, 2) if designed is None else designed
            run(rig, motion, part / f"{name}.csv")
            write_motion(part / f"{name}_motion.json", motion, robot)
        write_json(part / "truth.json", truth.to_dict())
    identification, validation = (folder / f"{name}.csv" for name in names)
    return DemoFiles(folder / "demo_arm.toml", identification, validation, truth.values)


def _above_table(loaded: LoadedRobot, seed: int, period: float) -> FourierMotion:
    """A random motion, as large as the limits and the table allow."""
    walls, _ = workspace_of(loaded, ())
    for share in np.linspace(LARGEST_LIMIT_SHARE, 0.1, 9):
        motion = random_fourier(loaded.robot, seed=seed, period=period, limits_fraction=share)
        if all(wall.proven(motion).min() >= 0.0 for wall in walls):
            break
    return motion


def write_demo_arm(folder: Path) -> LoadedRobot:
    """Write the demo arm's URDF and robot file to a folder; the robot they describe."""
    for name in ("demo_arm.urdf", "demo_arm.toml"):
        text = (files("steelyard.simulate") / name).read_text(encoding="utf-8")
        (folder / name).write_text(text, encoding="utf-8")
    return load_robot(folder / "demo_arm.toml")


RANDOM_PERIOD = 10.0  # length of a random motion [s], if none is given
RANDOM_GAINS = (5.0, 15.0)  # least and greatest, of a robot whose truth has none [Nm/A; N/A]
_LONGEST_RUN = 24.0 * 3600.0  # robot time that a run may take [s]

_REPEATABLE_ENDS = (("position", "", 1e-9), ("speed", "/s", 1e-6))
"""What must be the same at both ends of a motion to be repeated, its unit, how closely."""


@dataclass(frozen=True)
class SimulatedRun:
    """A simulated run."""

    files: SimulatedFiles
    notes: tuple[str, ...]
    seconds: float  # length of the motion that was repeated or slowed [s]


@checked(
    period=0.5, periods=1, noise=0, payload_mass=1e-3, attach=0, release=0, friction_drift=0, seed=0
)
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
    truth: str | Path | None = None,
    friction_drift: float = 1.0,
    rate: float | None = None,
    control: str | None = None,
    model: str | Path | IdentifiedModel | None = None,
    wrench: str | Path | None = None,
    wrench_frame: str | None = None,
    wrench_axes: str = "base",
    fixed_base: str | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> SimulatedRun:
    """Simulate a robot with random true parameters near the nominal ones, and log it.

    With `control` or `model`, drives with encoders, delay and lag lie between the controller and
    the joints, and the log has columns of the desired motion and the commanded torques
    (`q_cmd1_rad`, `dq_cmd1_rad_s`, `tau_cmd1_Nm`).

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        folder: Folder to make, for `log.csv`, `trajectory.json` and `truth.json`.
        motion: Motion to follow: `trajectory.json`, or a table of time and positions; a random one
            if `None`.
        period: Duration [s] of random motion without `motion`; 10 if `None`.
        periods: Number of periods, without a stop between them.
        dry_run: Speed factor for a first run: 0.2 takes five times as long.
        noise: Sensor noise, relative to that of a typical arm.
        payload_mass: Mass of the payload [kg], a steel sphere.
        payload_frame: Frame of the payload; that of the last link if `None`.
        attach: Time [s] at which the payload is attached.
        release: Time [s] at which it is released; never by default.
        truth: `truth.json` of another simulation: the same robot again.
        friction_drift: Factor on the true friction, such as 1.2.
        rate: Rows per second of the log, such as 33.333; at most 1000; 250 if `None`, or as the
            robot file says.
        control: `pd`, `pid`, `cascade` or `computed_torque`, with encoders, delay and lag of real
            drives; gains follow: `cascade,kv=20`. If `None`, joint PD control with ideal encoders
            and drives.
        model: Identified model for torque feedforward or computed torque: model.json, or the folder
            that contains it.
        wrench: Table of an external wrench, each row until the next one: `time_s`, `fx_N`, `fy_N`,
            `fz_N`, `tx_Nm`, `ty_Nm`, `tz_Nm`. The log gets these columns, along the axes of the
            frame.
        wrench_frame: Frame that it acts on; that of the last link if `None`.
        wrench_axes: Axes of the table: `base` or `frame`.
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
    refuse_floating(loaded.robot, "a simulation")
    if not 0.0 < dry_run <= 1.0:
        raise DataError(
            f"a dry run at {dry_run:g} of the speed is not slower than the motion",
            where="--dry-run",
            fix="give a number above 0 and at most 1, such as 0.2",
        )
    if motion is None:  # before it is made
        _check_length(period or RANDOM_PERIOD, periods, dry_run)
    once = _one_period(loaded.robot, motion, period, seed)
    _check_length(once.duration, periods, dry_run)
    trajectory = _repeated(once, loaded.robot, periods)
    if dry_run < 1.0:
        trajectory = SlowedMotion(trajectory, dry_run)
    real, gains = true_robot(loaded, truth, friction_drift, seed)
    sensors = _sensors(loaded, real, noise, rate, gains, seed)
    controller = _controller(loaded.robot, control, model)
    if controller is not None:
        sensors = replace(sensors, commanded=True)
    rig = VirtualRobot(
        loaded.robot,
        real,
        sensors,
        seed=seed,
        signals=loaded.signals,
        payload=_payload(loaded.robot, payload_mass, payload_frame, attach, release),
        control=controller,
        drives=None if controller is None else customary_drives(loaded.robot),
        wrench=_wrench(loaded.robot, wrench, wrench_frame, wrench_axes),
        progress=progress,
    )
    return SimulatedRun(write_run(rig, trajectory, Path(folder)), loaded.notes, once.duration)


def true_robot(
    loaded: LoadedRobot, truth: str | Path | None, friction_drift: float, seed: int
) -> tuple[Truth, Array | None]:
    """What a robot really is, and its drive gains, shape `(n,)`, if the file `truth` has some.

    Without a file, random values near the nominal ones.
    """
    if truth is None:
        terms = with_friction(model_with_open_friction(loaded), loaded).terms
        return random_truth(loaded.robot, seed, terms=terms).drifted(friction_drift), None
    real, gains = read_truth(Path(truth), loaded.robot)
    return real.drifted(friction_drift), gains


def _sensors(
    loaded: LoadedRobot,
    truth: Truth,
    noise: float,
    rate: float | None,
    gains: Array | None,
    seed: int,
) -> Sensors:
    """Customary sensors, with the rate and the gains that are requested or declared."""
    sensors = customary_sensors(loaded.robot, truth, noise)
    signals = loaded.signals
    if signals is not None and any(signals.unknown_gains):
        if gains is None:
            gains = np.random.default_rng(seed).uniform(*RANDOM_GAINS, loaded.robot.n)
        sensors = replace(sensors, gains=gains)
    if signals is not None and signals.time == ROW:
        declared = 1.0 / signals.time_scale
        if rate is not None and abs(rate - declared) > 1e-9 * declared:
            raise DataError(
                f"the log is to have {rate:g} rows a second, but the robot file declares "
                f"{declared:g}",
                where="--rate",
                fix="leave it out, or change the robot file",
            )
        # stamps of such a log are not written: its clock is even
        return replace(sensors, rate=declared, clock_jitter=0.0)
    return sensors if rate is None else replace(sensors, rate=rate)


def _controller(
    robot: Robot, control: str | None, model: str | Path | IdentifiedModel | None
) -> Control | None:
    """The controller that the options describe; `None` for the default one."""
    if model is None:
        return None if control is None else control_of(control)
    identified = load_model(model)
    refuse_unknown_gains(identified)
    refuse_other_robot(identified, robot)
    return control_of(PD.kind if control is None else control, identified.valued)


def _wrench(
    robot: Robot, file: str | Path | None, frame: str | None, axes: str
) -> AppliedWrench | None:
    if file is None:
        if frame is None and axes == "base":
            return None
        raise ModelError(
            "a frame or axes of a wrench are given, but no wrench",
            where="--wrench-frame or --wrench-axes",
            fix="add --wrench FILE",
        )
    if axes not in ("base", "frame"):
        raise ModelError(
            f"there are no axes '{axes}'", where="--wrench-axes", fix="give base or frame"
        )
    chosen: Axes = "base" if axes == "base" else "frame"
    return read_wrench(Path(file), last_frame(robot) if frame is None else frame, chosen)


def _one_period(
    robot: Robot, motion: str | Path | None, period: float | None, seed: int
) -> ExactTrajectory:
    if motion is None:
        return random_fourier(robot, seed=seed, period=period or RANDOM_PERIOD)
    if period is not None:
        raise DataError(
            "a period of the random motion is given together with a motion",
            where="--period with --motion",
            fix="leave out one of the two",
        )
    return read_motion(Path(motion), robot)


def _repeated(trajectory: ExactTrajectory, robot: Robot, periods: int) -> ExactTrajectory:
    """The motion several times without a stop; it must end where and as it starts."""
    for order, (what, unit, close) in enumerate(_REPEATABLE_ENDS):
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


def _check_length(once: float, periods: int, factor: float) -> None:
    """Refuse a run of more than a day of robot time."""
    seconds = once * periods / factor
    if not seconds <= _LONGEST_RUN:
        raise DataError(
            f"the run would be {seconds / 3600.0:.4g} hours long: {periods} times {once:g} s at "
            f"{factor:g} of the speed; a log holds 24 hours at most",
            where="--period, --motion, --periods or --dry-run",
            fix="give fewer periods, a faster dry run, or a shorter motion",
        )


def _payload(
    robot: Robot, mass: float | None, frame: str | None, attach: float, release: float
) -> Payload | None:
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
