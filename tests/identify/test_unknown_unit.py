"""Efforts in a unit that nobody knows: the result is the same whatever that unit is."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from short_arm import without_wrist
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.identify import identify
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import Truth, random_truth


def _log(path: Path, robot: Robot, truth: Truth, seed: int, unit: float) -> Path:
    trajectory = random_fourier(robot, seed=seed, period=8.0)
    t = np.arange(0.0, trajectory.duration, 0.01)
    motion = trajectory.sample(t)
    torque = truth.model.at(truth.values).torque(motion)
    torque += 0.01 * torque.std(axis=0) * np.random.default_rng(seed).standard_normal(torque.shape)
    columns = {"time_s": t}
    for j in range(robot.n_joints):
        columns |= {f"q{j + 1}_rad": motion.q[:, j], f"dq{j + 1}_rad_s": motion.dq[:, j]}
        columns |= {f"tau{j + 1}_Nm": torque[:, j] / unit}
    pl.DataFrame(columns).write_parquet(path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1200.0])
def test_a_gain_of_one_does_not_make_the_prior_too_heavy(tmp_path: Path, unit: float) -> None:
    loaded = without_wrist(tmp_path)
    truth = random_truth(loaded.robot, 5)
    file = tmp_path / "demo_arm.toml"
    text = file.read_text().replace('kind = "joint_torque"', 'kind = "motor_current"')
    file.write_text(text.replace('unit = "Nm"', 'unit = "A"\ngain = ["identify", 1.0, "identify"]'))
    logs = [_log(tmp_path / f"{k}.parquet", loaded.robot, truth, k, unit) for k in range(2)]
    result = identify(file, logs[:1], validate=logs[1:], check=False)
    assert result.scores["percent_of_used"].max() < 3.0
    said = result.report()
    assert "implausibly light" not in said and "common factor" in said
    masses = result.model.model.robot.nominal[:, 0] * unit / loaded.robot.nominal[:, 0]
    assert np.ptp(masses) < 1e-9 * masses.max() and 0.2 < masses[0] < 5.0
