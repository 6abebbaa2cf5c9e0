"""Positions that LeRobot has normalised, and units that a robot file states as numbers."""

import json
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from check.test_signals import ROBOT, case_of, sound
from steelyard import load_robot
from steelyard.base.errors import ModelError
from steelyard.check.finding import Severity
from steelyard.check.signals.position_unit_and_columns import position_check
from steelyard.cli.app import app
from steelyard.robot.init.lerobot_calibration import read_calibration

STEP = 2.0 * pi / 4096
RANGES = {"shoulder": (862, 3253), "gripper": (2032, 3288)}
URDF = """<robot name="servos"><link name="base"/><link name="upper"/><link name="finger"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-1.8" upper="1.8" velocity="6" effort="10"/></joint>
  <joint name="gripper" type="revolute"><parent link="upper"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="1.8" velocity="6" effort="10"/></joint>
</robot>"""


def calibration(folder: Path, **ranges: object) -> Path:
    motors: dict[str, Any] = {**RANGES, **ranges}
    path = folder / "my_arm.json"
    one = {"id": 1, "drive_mode": 0, "homing_offset": 7}
    ends = ("range_min", "range_max")
    known = {m: one | dict(zip(ends, r, strict=True)) for m, r in motors.items()}
    path.write_text(json.dumps(known))
    return path


def dataset(folder: Path, shoulder: float, gripper: float) -> Path:
    """Two hundred rows that reach so far."""
    root, t = folder / "teleop", np.arange(200) / 30.0
    q = np.column_stack([shoulder * np.sin(t), gripper * np.abs(np.sin(t))])
    state = pl.Series(q.tolist(), dtype=pl.Array(pl.Float32, 2))
    labels = {"names": ["shoulder.pos", "gripper.pos"], "dtype": "float32", "shape": [2]}
    features = {"action": labels, "observation.state": labels}
    (root / "meta").mkdir(parents=True)
    (root / "data").mkdir()
    (root / "meta" / "info.json").write_text(json.dumps({"features": features, "fps": 30}))
    pl.DataFrame(
        {"action": state, "observation.state": state, "timestamp": t, "episode_index": 0 * t}
    ).write_parquet(root / "data" / "file.parquet")
    (folder / "servos.urdf").write_text(URDF)
    return root


def told(folder: Path, *more: str) -> tuple[int, str]:
    arguments = [str(folder / "servos.urdf"), str(folder / "teleop"), "--no-input", *more]
    done = CliRunner().invoke(app, ["init", *arguments, "-o", str(folder / "servos.toml")])
    return done.exit_code, " ".join(done.output.split())


def test_normalised_positions_get_their_units_from_the_calibration(tmp_path: Path) -> None:
    dataset(tmp_path, 80.0, 60.0)
    code, text = told(tmp_path, "--calibration", str(calibration(tmp_path)))
    assert code == 0 and "normalised units, by the ranges in my_arm.json" in text
    assert "their range allows degrees too" in text
    targets = load_robot(tmp_path / "servos.toml").targets
    assert targets is not None
    wanted = [(3253 - 862) / 200 * STEP, (3288 - 2032) / 100 * STEP]
    np.testing.assert_allclose(targets.scale, wanted)


def test_a_range_that_degrees_do_not_have_is_normalised_without_a_doubt(tmp_path: Path) -> None:
    dataset(tmp_path, 95.0, 60.0)
    short = calibration(tmp_path, shoulder=(1000, 2000))  # 88 deg in all
    code, text = told(tmp_path, "--calibration", str(short))
    assert code == 0 and "allows degrees" not in text


def test_targets_beyond_a_hundred_are_degrees_too(tmp_path: Path) -> None:
    root = dataset(tmp_path, 80.0, 60.0)
    file = root / "data" / "file.parquet"
    table = pl.read_parquet(file)
    far = table["action"].to_numpy().copy()
    far[:, 0] *= 1.5
    action = pl.Series("action", far.tolist(), dtype=table["action"].dtype)
    table.with_columns(action).write_parquet(file)
    assert told(tmp_path, "--calibration", str(calibration(tmp_path)))[0] == 0
    targets = load_robot(tmp_path / "servos.toml").targets
    assert targets is not None and targets.scale[0] == pytest.approx(pi / 180.0)


def test_units_in_names_are_not_overridden(tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    t = np.arange(200) / 30.0
    names = [f"{joint}_{what}_rad" for what in ("q", "target") for joint in RANGES]
    table = pl.DataFrame({"time": t} | {name: np.sin(t) for name in names})
    table.write_csv(tmp_path / "run.csv")
    arguments = [str(tmp_path / "servos.urdf"), str(tmp_path / "run.csv"), "--calibration"]
    done = CliRunner().invoke(app, ["init", *arguments, str(calibration(tmp_path))])
    assert done.exit_code == 2 and "state their unit" in done.output


def test_degrees_beyond_a_hundred_keep_the_grippers_unit(tmp_path: Path) -> None:
    dataset(tmp_path, 120.0, 60.0)
    assert told(tmp_path, "--calibration", str(calibration(tmp_path)))[0] == 0
    targets = load_robot(tmp_path / "servos.toml").targets
    assert targets is not None
    np.testing.assert_allclose(targets.scale, [pi / 180.0, (3288 - 2032) / 100 * STEP])


def test_without_a_calibration_the_unit_is_a_doubt_of_the_file(tmp_path: Path) -> None:
    dataset(tmp_path, 80.0, 60.0)
    code, text = told(tmp_path)
    assert code == 0 and "in degrees or normalised" in text
    assert "# CHECK: LeRobot logs a gripper in 0 to 100" in (tmp_path / "servos.toml").read_text()


@pytest.mark.parametrize(
    ("gripper", "ranges", "wrong"),
    [
        (140.0, {}, "'gripper' are 0 to 140"),
        (60.0, {"gripper": (3288, 2032)}, "no calibration of LeRobot: 'gripper' has no range_min"),
        (60.0, {"gripper": (0, 9000)}, "steps of one turn"),
        (60.0, {"gripper": ("a", None)}, "steps of one turn"),
    ],
)
def test_other_files_and_logs_are_refused(
    tmp_path: Path, gripper: float, ranges: dict[str, object], wrong: str
) -> None:
    dataset(tmp_path, 80.0, gripper)
    code, text = told(tmp_path, "--calibration", str(calibration(tmp_path, **ranges)))
    assert code == 2 and wrong in text
    assert not (tmp_path / "servos.toml").exists()


def test_a_calibration_of_another_arm_is_refused(tmp_path: Path) -> None:
    dataset(tmp_path, 80.0, 60.0)
    path = tmp_path / "other.json"
    path.write_text(json.dumps({"pan": {"range_min": 1, "range_max": 9}}))
    code, text = told(tmp_path, "--calibration", str(path))
    assert code == 2 and "no motor of shoulder, gripper" in text
    path.write_text("[1, 2]")
    with pytest.raises(ModelError, match="no calibration of LeRobot"):
        read_calibration(path)


def test_a_calibration_needs_targets(tmp_path: Path) -> None:
    dataset(tmp_path, 80.0, 60.0)
    (tmp_path / "plain.csv").write_text("t,x\n" + "\n".join(f"{k},1" for k in range(60)))
    arguments = [str(tmp_path / "servos.urdf"), str(tmp_path / "plain.csv"), "--calibration"]
    done = CliRunner().invoke(app, ["init", *arguments, str(calibration(tmp_path))])
    assert done.exit_code == 2 and "--calibration" in done.output


def test_units_that_are_numbers_are_believed(tmp_path: Path) -> None:
    """Counts of an encoder: nothing proposes degrees, and the ranges are those of the joints."""
    table, counts = sound(), 2.0 * pi / 4096
    table[:, 1:4] /= counts
    text = ROBOT.replace('position = "q{}"', f'position = "q{{}}"\nposition_unit = {counts!r}')
    case = case_of(tmp_path, table, text)
    (found,) = position_check(case)
    assert found.severity is Severity.OK and "positions in units of 0.001534" in found.says
    wrong = text.replace(repr(counts), repr(3.0 * counts))
    case = case_of(tmp_path, table, wrong)
    (found,) = position_check(case)
    assert found.severity is Severity.DOUBTFUL and "outside" in found.says
    assert found.fix is not None and not found.fix.edits
