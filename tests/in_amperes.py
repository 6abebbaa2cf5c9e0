"""Runs of the demo arm in memory, logged in amperes."""

from importlib.resources import files
from pathlib import Path

import numpy as np

from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run
from steelyard.simulate.ground_truth import Truth

ROBOT = load_robot(Path(str(files("steelyard.simulate") / "demo_arm.urdf"))).robot
GAINS = np.array([2.0, -3.0, 1.5, 0.5, -1.0, 4.0])
RATE = 200.0
AUTO = Processing()


def run_of(truth: Truth, seed: int, noise: float = 0.03, wanted: Processing = AUTO) -> Run:
    """True torque along a random motion with white noise, logged in amperes."""
    rng = np.random.default_rng(seed)
    trajectory = random_fourier(ROBOT, seed=seed, period=10.0, periods=2)
    t = np.arange(0.0, trajectory.duration, 1.0 / RATE)
    motion = trajectory.sample(t)
    torque = truth.model.at(truth.values).torque(motion)
    torque = torque + noise * torque.std(axis=0) * rng.standard_normal(torque.shape)
    names = [f"{kind}{j}" for kind in "qi" for j in range(ROBOT.n)]
    ones = np.ones(ROBOT.n)
    signals = Signals(
        "t",
        1.0,
        tuple(names[: ROBOT.n]),
        ones,
        None,
        None,
        tuple(names[ROBOT.n :]),
        ones,
        "motor_current",
        ("A",) * ROBOT.n,
        GAINS,
    )
    table = np.column_stack([t, motion.q, torque / GAINS])
    recording = Recording(LogInMemory(Path(f"run{seed}"), ("t", *names), table), signals)
    return prepare(recording, wanted)
