"""A log of periods is fitted as its mean; logs to be predicted are not."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from short_arm import without_wrist
from steelyard.base.motion import run
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors


@pytest.mark.slow
def test_only_fitted_logs_are_averaged(command: Callable[..., Any], tmp_path: Path) -> None:
    robot = without_wrist(tmp_path).robot
    truth = random_truth(robot, 3)
    rig = VirtualRobot(robot, truth, customary_sensors(robot, truth))
    run(rig, random_fourier(robot, seed=1, period=2.0, periods=3), tmp_path / "many.parquet")
    run(rig, random_fourier(robot, seed=2, period=2.0), tmp_path / "once.parquet")
    chosen = "\n[processing]\nrepetitions = {period = 2.0, drop_last = 0}\n"
    text = (tmp_path / "demo_arm.toml").read_text(encoding="utf-8")
    (tmp_path / "robot.toml").write_text(text + chosen, encoding="utf-8")
    many, once = tmp_path / "many.parquet", tmp_path / "once.parquet"
    out = ["-o", tmp_path / "out", "--json"]
    done = command("identify", tmp_path / "robot.toml", many, "--validate", once, *out)
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["validation"][0]["mean_percent_moving"] < 15.0
    assert "mean of 2 repetitions of 2 s" in done.stdout + done.stderr
    again = command("validate", tmp_path / "out", once, "--json")
    assert again.exit_code == 0, again.stderr
    kept = json.loads((tmp_path / "out" / "model.json").read_text())["processing"]
    assert kept["repetitions"] == {"period": 2.0, "drop_first": 1, "drop_last": 0}
