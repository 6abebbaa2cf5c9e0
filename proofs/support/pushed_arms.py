"""Simulated six-joint arms that are pushed while they move, and models that are slightly off.

Geometry, masses and limits are those of `FILES`, bodies and friction are invented near
them. The arm is simulated by MuJoCo under its joint controller, with sensors as good as usual.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from studies.support.robots import ROBOTS

from steelyard.base.arrays import Array, Parameters
from steelyard.base.motion import run
from steelyard.base.progress import silent
from steelyard.estimate.estimate import Estimate, StandardEstimate
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.estimate.information.filter_and_gram import noise_bandwidth
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.runs_and_notes_of_logs import processing_of
from steelyard.logs.formats import write_table
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import log_files, prepared, recording_of
from steelyard.simulate.drives_sensors_and_loads import AppliedWrench
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors

FILES = {
    "ur10": Path(__file__).parents[1] / "problems" / "ur10.toml",
    "rx160": ROBOTS / "p3_rx160.toml",
}
"""Robot files."""

MATCHED = 8.0
"""Cut-off of the fit that the models seem to come from [Hz]."""

OFF = 0.02
"""Relative standard deviation of every parameter of the model."""

PUSH, EVERY, LASTS, RAMP = 30.0, 4.0, 2.0, 0.5
"""Size of pushes [N], time from one to the next, duration, and time of rise and fall [s]."""

LEVER = 0.1
"""Distance of pushes from the frame's origin [m]."""

RATE = 250.0
"""Rows a second of the logs."""

DURATION, TICK = 20.0, 1e-3
"""Of the motions, and of the controller [s]."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A simulated robot.

    Attributes:
        truth: What it really is.
        signals: Columns of its logs.
        frame: The frame that is pushed.
    """

    truth: Truth
    signals: Signals
    frame: str

    @property
    def noise(self) -> Array:
        """Standard deviation of the torque's noise as it is logged, shape `(n,)` [Nm]."""
        sensors = customary_sensors(self.truth.robot, self.truth)
        return np.broadcast_to(sensors.torque_noise, (self.truth.robot.n,))


def arm_of(problem: str, seed: int) -> Arm:
    """The arm of a problem, such as `ur10`, with invented bodies and friction."""
    loaded = load_robot(FILES[problem])
    truth = random_truth(loaded.robot, seed, terms=model_with_open_friction(loaded).terms)
    n = loaded.robot.n
    q, dq, tau = ([f"{kind}_{j + 1}" for j in range(n)] for kind in ("q", "dq", "tau"))
    ones = np.ones(n)
    signals = Signals(
        "t", 1.0, tuple(q), ones, tuple(dq), ones, tuple(tau), ones, "joint_torque", ("Nm",) * n,
        ones,
    )  # fmt: skip
    return Arm(truth, signals, last_frame(loaded.robot))


def model_off(arm: Arm, seed: int, off: float = OFF) -> IdentifiedModel:
    """A model whose parameters have standard deviations of `OFF` each.

    Args:
        arm: The arm.
        seed: Same seed, same errors.
        off: Standard deviation that its errors really have; 0 for the true parameters.
    """
    model, true = arm.truth.model, arm.truth.values.values
    std = OFF * np.abs(true)
    guess = true + off / OFF * std * np.random.default_rng(seed).standard_normal(len(true))
    known = Parameters(model.names, model.units, guess)
    sigma = arm.noise * np.sqrt(2.0 * noise_bandwidth(MATCHED) / RATE)
    estimate = Estimate(
        "off", Parameters((), (), ()), np.zeros((0, 0)), (), sigma, np.full(len(sigma), 1e4), 10.0,
        2.0, standard=StandardEstimate(known, np.diag(np.square(std)), np.ones(len(true))),
    )  # fmt: skip
    return IdentifiedModel(
        model,
        base_parameters(model),
        estimate,
        (),
        arm.signals,
        Cutoffs(20.0, MATCHED, MATCHED),
        Provenance("0", {}, (), ()),
    )


def applied(arm: Arm, seed: int) -> AppliedWrench:
    """Pushes on the last frame in base axes; forces rise, stay and fall, near its origin."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, DURATION + 2.0, TICK)
    wrench = np.zeros((len(t), 6))
    for start in np.arange(2.0, t[-1] - LASTS - 1.0, EVERY):
        phase = np.minimum(t - start, start + LASTS - t) / RAMP
        size = 0.5 - 0.5 * np.cos(np.pi * np.clip(phase, 0.0, 1.0))
        force, point = rng.standard_normal((2, 3))
        force *= PUSH / np.linalg.norm(force)
        moment = np.cross(LEVER * point / np.linalg.norm(point), force)
        wrench += size[:, None] * np.concatenate([force, moment])
    return AppliedWrench(arm.frame, t, wrench, "base")


def pushed_log(arm: Arm, seed: int, path: Path) -> AppliedWrench:
    """Write a log of a random motion with pushes, see `applied`; the pushes."""
    robot, wrench = arm.truth.robot, applied(arm, seed)
    motion = random_fourier(robot, seed=seed, period=DURATION)
    rig = VirtualRobot(
        robot, arm.truth, customary_sensors(robot, arm.truth), seed=seed, signals=arm.signals,
        wrench=wrench,
    )  # fmt: skip
    run(rig, motion, path)
    return wrench


def sudden(arm: Arm, size: float, lasts: float, every: float, seed: int) -> AppliedWrench:
    """Pushes that begin and end at once, in base axes, from the start of a log.

    Args:
        arm: The arm.
        size: Of their forces [N].
        lasts: Duration of each [s].
        every: From the start of one to that of the next [s].
        seed: Same seed, same directions.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, DURATION + 2.0, TICK)
    wrench = np.zeros((len(t), 6))
    for start in np.arange(0.0, t[-1], every):
        force, point = rng.standard_normal((2, 3))
        force *= size / np.linalg.norm(force)
        moment = np.cross(LEVER * point / np.linalg.norm(point), force)
        wrench[(t >= start) & (t < start + lasts)] = np.concatenate([force, moment])
    return AppliedWrench(arm.frame, t, wrench, "base")


def with_other_pushes(
    arm: Arm, log: Path, before: AppliedWrench, after: AppliedWrench, path: Path
) -> None:
    """Write the log of an arm that follows the same motion under other pushes."""
    names = log.read_text().partition("\n")[0].split(",")
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    t = table[:, names.index(arm.signals.time)]
    q = table[:, [names.index(name) for name in arm.signals.position]]
    jacobian = arm.truth.model.at(arm.truth.values).jacobian(q, arm.frame)
    change = after.at(t - t[0]) - before.at(t - t[0])
    efforts = [names.index(name) for name in arm.signals.effort]
    table[:, efforts] -= np.einsum("tij,ti->tj", jacobian, change)
    write_table(path, dict(zip(names, table.T, strict=True)))


def read(model: IdentifiedModel, log: Path) -> Run:
    """A log as `steelyard wrench` reads it."""
    (found,) = log_files([str(log)])
    recording = recording_of(found, model.signals)
    return prepared([recording], processing_of(model), silent, at_rest=True)[0]
