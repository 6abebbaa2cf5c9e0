"""Simulated logs of the demo arm, and plain fits of them, for checks of fitted models."""

import shutil
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
import polars as pl

from short_arm import WRIST, fix_joints
from steelyard.base.motion import Motion
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    base_regressor,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.robot import Robot
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import log_files, runs_of
from steelyard.simulate.ground_truth import Truth

RATE, SECONDS = 125.0, 20.0


def demo_arm(folder: Path, joints: int = 6) -> LoadedRobot:
    """The demo arm's robot file, written to a folder; joints of its wrist behind that many fixed.

    A fit of three joints takes less than half of the time of six.
    """
    for name, copied in (("demo_arm.urdf", "demo_arm.urdf"), ("demo_arm.toml", "arm.toml")):
        shutil.copy(str(files("steelyard.simulate") / name), folder / copied)
    fix_joints(folder / "demo_arm.urdf", WRIST[joints - 3 :])
    return load_robot(folder / "arm.toml")


def motion(robot: Robot, seed: int) -> Motion:
    """Five harmonics of 0.1 Hz."""
    rng, t = np.random.default_rng(seed), np.arange(int(RATE * SECONDS)) / RATE
    q, dq, ddq = np.zeros((3, len(t), robot.n))
    for k in range(1, 6):
        w = 0.2 * np.pi * k
        a, b = 0.8 * rng.normal(size=(2, robot.n)) / k
        s, c = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q, dq, ddq = q + a * s + b * c, dq + w * (a * c - b * s), ddq - w * w * (a * s + b * c)
    return Motion(t, q, dq, ddq)


def log(path: Path, truth: Truth, seed: int, offset: Sequence[float] = (0.0,)) -> None:
    """A run of the true robot, with 1 % noise on its torques."""
    robot, rng = truth.robot, np.random.default_rng(seed)
    path_of = motion(robot, seed)
    tau = truth.model.at(truth.values).torque(path_of)
    tau = tau + 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    q = path_of.q + 2e-5 * rng.normal(size=tau.shape) - np.array(offset)
    dq = path_of.dq + 1e-3 * rng.normal(size=tau.shape)
    named = {"time_s": path_of.t}
    for k in range(robot.n):
        named |= {
            f"q{k + 1}_rad": q[:, k],
            f"dq{k + 1}_rad_s": dq[:, k],
            f"tau{k + 1}_Nm": tau[:, k],
        }
    pl.DataFrame(named).write_parquet(path)


def case(loaded: LoadedRobot, paths: Sequence[Path]) -> FittedCase:
    """A plain fit of some logs."""
    signals, model = loaded.signals, model_with_open_friction(loaded)
    assert signals is not None
    runs: Sequence[Run] = runs_of(
        loaded, signals, log_files([str(p) for p in paths]), (), lambda _: True
    )[0]
    information = information_from(runs)(base_regressor(model))
    estimate = WeightedLeastSquares()(information)
    cutoffs = Cutoffs(runs[0].motion_cutoff, runs[0].matched_cutoff, runs[0].matched_cutoff)
    origin = Provenance("0", {}, (), ())
    identified = IdentifiedModel(
        model, base_parameters(model), estimate, (), signals, cutoffs, origin
    )
    return FittedCase(identified, tuple(runs), information=information)
