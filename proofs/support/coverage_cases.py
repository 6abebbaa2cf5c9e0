"""Simulated logs of the demo arm with one disturbance each, to count what intervals cover.

Every draw has a truth, motions and noise of its own: some runs to fit, one of another motion.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.friction_over_speed import Coulomb, Stribeck
from steelyard.model.laws.friction_with_memory import LoadDependent
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.terms.term import Term
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.file.signals import Signals
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.mujoco_model import build
from steelyard.simulate.virtual_robot import typical_torque

NOISE = 0.02
"""Torque noise over the typical torque of each joint."""

FITTED = 3
"""Runs that are fitted."""

FRICTION = ("coulomb", "viscous", "stribeck", "load_dependent")

SMOOTH = tuple(Coulomb(smoothing=0.1) if isinstance(t, Coulomb) else t for t in DEFAULT_TERMS)


@dataclass(frozen=True)
class Row:
    """One disturbance.

    Attributes:
        name: What it is called.
        right: Whether the model that is fitted is the one that made the data.
        terms: Terms of the truth.
        lag: Time constant of torque noise [s]; white if zero.
        encoder: Step of the encoder [rad].
        step: Step of the logged torque over the typical torque.
        warming: Share by which friction falls from the first sample of a log to its last.
        periods: Periods of 10 s per run.
        harmonics: Harmonics of the motion.
        rate: Rows per second [Hz].
        backward: Whether a velocity column holds backward differences of positions.
        thin: Side to which every true body is flattened along a random direction, relative to the
            nominal one; such bodies are at the edge of what can exist.
    """

    name: str
    right: bool = True
    terms: tuple[Term, ...] = DEFAULT_TERMS
    lag: float = 0.0
    encoder: float = 2.0 * np.pi / 2**20
    step: float = 0.0
    warming: float = 0.0
    periods: int = 2
    harmonics: int = 5
    rate: float = 250.0
    backward: bool = False
    thin: float = 1.0


ROWS = (
    Row("white noise"),
    Row("coarse encoder", encoder=2.0 * np.pi / 2**13),
    Row("quantised torque", step=0.05),
    Row("short and poor logs", periods=1, harmonics=3),
    Row("noise correlated over 0.5 s", lag=0.5),
    Row("bodies at the edge of what can exist", thin=0.05),
    Row("the same, short and poor logs", thin=0.05, periods=1, harmonics=3),
    Row("smooth friction", right=False, terms=SMOOTH),
    Row("Stribeck friction outside the model", right=False, terms=(*DEFAULT_TERMS, Stribeck(0.2))),
    Row("load-dependent friction", right=False, terms=(*DEFAULT_TERMS, LoadDependent(1e-3))),
    Row("friction falls by 30 % in every log", right=False, warming=0.3),
    Row("velocity by backward difference", right=False, backward=True, rate=100.0),
)


@dataclass(frozen=True, eq=False)
class Case:
    """Runs of one draw.

    Attributes:
        truth: What made them.
        fitted: Runs to be fitted.
        unseen: A run of another motion.
    """

    truth: Truth
    fitted: tuple[Run, ...]
    unseen: Run


@cache
def robot_file() -> LoadedRobot:
    """The demo arm with nominal values, as a user would give it."""
    from importlib.resources import files

    return load_robot(Path(str(files("steelyard.simulate") / "demo_arm.urdf")))


def case_of(row: Row, seed: int) -> Case:
    """The runs of one draw."""
    robot = robot_file().robot
    truth = flattened(robot, random_truth(robot, seed, terms=row.terms), row.thin, seed)
    logs = [recording_of(robot, truth, row, 100 * seed + k) for k in range(FITTED + 1)]
    first = [prepare(log) for log in logs[:-1]]
    common = Processing(
        motion_cutoff=max(run.motion_cutoff for run in first),
        matched_cutoff=max(run.matched_cutoff for run in first),
    )
    runs = [prepare(log, common) for log in logs]
    named = [replace(run, name=f"run{k}") for k, run in enumerate(runs)]
    return Case(truth, tuple(named[:-1]), named[-1])


def flattened(robot: Robot, truth: Truth, thin: float, seed: int) -> Truth:
    """The truth with every body flattened along a random direction, relative to its prior."""
    rng, values = np.random.default_rng(seed), truth.values.as_dict()
    for body in robot.bodies if thin < 1.0 else ():
        names = [f"{name}.{body.name}" for name in INERTIAL_NAMES]
        root = np.linalg.cholesky(body.inertia.pseudo)
        direction = rng.standard_normal(4)
        direction /= np.linalg.norm(direction)
        press = root @ (np.eye(4) - (1.0 - thin) * np.outer(direction, direction))
        press = press @ np.linalg.inv(root)
        pseudo = press @ Inertia.from_ten([values[name] for name in names]).pseudo @ press.T
        values |= dict(zip(names, Inertia.from_pseudo(pseudo).ten.tolist(), strict=True))
    return replace(truth, values=replace(truth.values, values=np.array(list(values.values()))))


def recording_of(robot: Robot, truth: Truth, row: Row, seed: int) -> Recording:
    """A log in memory; the seed is that of motion and noise."""
    rng = np.random.default_rng(seed)
    trajectory = random_fourier(
        robot, seed=seed, period=10.0, periods=row.periods, harmonics=row.harmonics
    )
    t = np.arange(0.0, trajectory.duration, 1.0 / row.rate)
    motion = trajectory.sample(t)
    scale = typical_torque(robot, build(robot, truth.inertial, truth.rotors))
    torque = truth.model.at(truth.values).torque(motion)
    if row.warming:
        torque = torque - (row.warming * t / t[-1])[:, None] * friction_of(truth, motion)
    torque = torque + NOISE * scale * noise(rng, torque.shape, row)
    if row.step:
        torque = row.step * scale * np.round(torque / (row.step * scale))
    q = motion.q + row.encoder * rng.uniform(-0.5, 0.5, motion.q.shape)
    q = row.encoder * np.round(q / row.encoder)
    return logged(robot, t, q, torque, row)


def logged(robot: Robot, t: Array, q: Array, torque: Array, row: Row) -> Recording:
    """The log of what was measured."""
    n, ones = robot.n, np.ones(robot.n)
    names = [f"{kind}{j}" for kind in "qev" for j in range(n)]
    signals = Signals(
        time="t",
        time_scale=1.0,
        position=tuple(names[:n]),
        position_scale=ones,
        velocity=tuple(names[2 * n :]) if row.backward else None,
        velocity_scale=ones if row.backward else None,
        effort=tuple(names[n : 2 * n]),
        effort_scale=ones,
        effort_kind="joint_torque",
        effort_units=robot.effort_units,
        gains=ones,
    )
    columns = [t, q, torque]
    if row.backward:
        columns.append(np.diff(q, axis=0, prepend=q[:1]) * row.rate)
    table = np.column_stack(columns)
    return Recording(LogInMemory(Path("draw"), ("t", *names[: table.shape[1] - 1]), table), signals)


def friction_of(truth: Truth, motion: Motion) -> Array:
    """The part of the torque that is friction, shape `(N, n)`."""
    values = truth.values.as_dict()
    frozen = {
        name: value if name.split(".")[0] in FRICTION else 0.0 for name, value in values.items()
    }
    known = replace(truth.values, values=np.array(list(frozen.values())))
    return truth.model.at(known).torque(motion)


def noise(rng: np.random.Generator, shape: tuple[int, ...], row: Row) -> Array:
    """Noise of unit size, white or through a first-order lag."""
    from scipy.signal import lfilter

    driven = rng.standard_normal(shape)
    if not row.lag:
        return driven
    keep = float(np.exp(-1.0 / (row.lag * row.rate)))
    driven[1:] *= np.sqrt(1.0 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], driven, axis=0))
