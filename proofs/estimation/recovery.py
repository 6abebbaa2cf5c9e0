"""Recovery of invented robots: do the stated 95 % intervals hold the truth?

White torque noise and encoder noise with quantisation, default filters, weighted least squares; 200
draws over four robots, each draw with a motion and noise of its own.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.base.arrays import Array
from steelyard.base.motion import Trajectory
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import dh_mechanism
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.sections import DHRow
from steelyard.robot.file.signals import Signals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot
from steelyard.robot.robot_from_mechanism import reduced
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.mujoco_model import build
from steelyard.simulate.virtual_robot import typical_torque

RATE, DRAWS = 250.0, 50
Noise = Callable[[np.random.Generator, tuple[int, ...]], Array]
ENCODER = 2.0 * np.pi / 2**20
TORQUE_NOISE = 0.02
"""White torque noise over the typical torque of each joint."""


def robots() -> list[Robot]:
    """The demo arm, and arms with a prismatic joint, few joints and skew axes."""
    from importlib.resources import files

    demo = load_robot(Path(str(files("steelyard.simulate") / "demo_arm.urdf"))).robot
    ball = Inertia.about_com(3.0, (0.1, 0.02, 0.05), np.diag([0.02, 0.03, 0.025]))

    def row(**fields: float | str) -> DHRow:
        com, inertia = ball.com, ball.inertia_com
        six = (inertia[0, 0], 0.0, inertia[1, 1], 0.0, 0.0, inertia[2, 2])
        return DHRow(mass=3.0, com=tuple(com), inertia_com=six, **fields)  # type: ignore[arg-type]

    scara = [row(a=0.3), row(a=0.25), row(kind="prismatic", alpha=np.pi)]
    skew = [row(alpha=0.7, a=0.1), row(alpha=1.1, d=0.3), row(alpha=-0.9, a=0.2), row(a=0.1)]
    single = [row(alpha=np.pi / 2.0, a=0.4)]
    made = [
        reduced(dh_mechanism(rows, "modified", name))[0]
        for name, rows in (("scara", scara), ("skew", skew), ("pair", [row(alpha=1.5), *single]))
    ]
    return [demo, *made]


def white(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Noise of unit size."""
    return rng.standard_normal(shape)


def log_of(
    robot: Robot,
    truth: Truth,
    seed: int,
    noise: Noise = white,
    trajectory: Trajectory | None = None,
) -> Recording:
    """A log in memory: true torque along a motion, a random one if `None`, noise on both sides."""
    rng = np.random.default_rng(seed)
    if trajectory is None:
        trajectory = random_fourier(robot, seed=seed, period=10.0, periods=2)
    t = np.arange(0.0, trajectory.duration, 1.0 / RATE)
    motion = trajectory.sample(t)
    torque = truth.model.at(truth.values).torque(motion)
    scale = typical_torque(robot, build(robot, truth.inertial, truth.rotors))
    torque = torque + TORQUE_NOISE * scale * noise(rng, torque.shape)
    noisy = motion.q + ENCODER * rng.standard_normal(motion.q.shape)
    q = ENCODER * np.round(noisy / ENCODER)
    names = [f"{kind}{j}" for kind in "qe" for j in range(robot.n)]
    ones = np.ones(robot.n)
    signals = Signals(
        time="t",
        time_scale=1.0,
        position=tuple(names[: robot.n]),
        position_scale=ones,
        velocity=None,
        velocity_scale=None,
        effort=tuple(names[robot.n :]),
        effort_scale=ones,
        effort_kind="joint_torque",
        effort_units=robot.effort_units,
        gains=ones,
    )
    table = np.column_stack([t, q, torque])
    return Recording(LogInMemory(Path(f"draw{seed}"), ("t", *names), table), signals)


def coverage_of(robot: Robot, draws: int = DRAWS) -> tuple[int, int]:
    """How many (parameter, draw) pairs lie in their interval, and how many there are."""
    regressor = base_regressor(Model(robot))
    inside = total = 0
    for seed in range(draws):
        truth = random_truth(robot, seed)
        run = prepare(log_of(robot, truth, seed))
        estimate = WeightedLeastSquares()(gather(regressor, run))
        values = regressor.base.base_values(truth.values.values)
        true = dict(zip(regressor.base.base_names, values, strict=True))
        wanted = np.array([true[name] for name in estimate.parameters.names])
        error = np.abs(estimate.parameters.values - wanted)
        inside += int(np.sum(error <= estimate.half_width))
        total += len(error)
    return inside, total


def main() -> list[Claim]:
    """Coverage over all pairs, and per robot."""
    claims, inside, total = [], 0, 0
    for robot in robots():
        good, count = coverage_of(robot)
        inside, total = inside + good, total + count
        share = 100.0 * good / count
        claims.append(Claim(f"intervals hold, {robot.name}", f"{share:.1f} %", "reported", True))
    share = 100.0 * inside / total
    return [
        *claims,
        Claim(
            f"95 % intervals hold, {total} pairs of 200 draws",
            f"{share:.1f} %",
            "90 to 99 %",
            90.0 <= share <= 99.0,
        ),
    ]


if __name__ == "__main__":
    main_of(main)
