from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from steelyard.base.arrays import Array
from steelyard.base.progress import silent
from steelyard.check.all_checks import Diagnosis, examine
from steelyard.check.case_from_files_and_precheck import case_of, subject_of
from steelyard.check.finding import Finding, Severity
from steelyard.check.findings_text_and_page import check_headline
from steelyard.check.signals.movement_rests_and_moving_base import moving_base_check, of_base
from steelyard.cli.app import app
from steelyard.runs.runs_of_named_logs import log_files

MODEL = """
<mujoco><worldbody>
  <body name="trunk" pos="0 0 .5">{free}<geom type="box" size=".2 .1 .05" mass="5"/>
    <body name="thigh" pos=".2 0 0"><joint name="hip" axis="0 1 0"/>
      <geom type="sphere" size=".05" pos=".1 .02 0" mass=".7"/>
      <body name="calf" pos="0 0 -.2"><joint name="knee" axis="0 1 0"/>
        <geom type="sphere" size=".05" pos=".1 .02 0" mass=".4"/></body></body>
  </body>
</worldbody></mujoco>"""
TIME = np.arange(0.0, 10.0, 0.01)
NOISE = np.random.default_rng(0).standard_normal((6, len(TIME)))


def logged(folder: Path, free: str, **more: Array) -> tuple[Path, Path]:
    folder.mkdir(exist_ok=True)
    model, log = folder / "robot.xml", folder / "run.parquet"
    model.write_text(MODEL.format(free=free))
    q = np.array([0.4 * np.sin(2.0 * TIME), 0.3 * np.cos(3.1 * TIME)])
    columns = {"time": TIME, "q_hip": q[0], "q_knee": q[1]}
    columns |= {"tau_hip": np.cos(q[0]) + 0.01 * NOISE[0], "tau_knee": np.cos(q[1])}
    pl.DataFrame({**columns, **more}).write_parquet(log)
    return model, log


def found(model: Path, log: Path) -> tuple[Finding, ...]:
    files = log_files([str(log)])
    case, _ = case_of(subject_of(str(model), files[0]), files, None, silent)
    return examine(case, checks=[moving_base_check]).findings


def test_a_base_that_floats_in_the_model_is_reported_as_assumed_at_rest(tmp_path: Path) -> None:
    model, log = logged(tmp_path, "<freejoint/>")
    (finding,) = found(model, log)
    assert check_headline(Diagnosis((finding,))).endswith(
        "1 of 1 check could not be decided: moving base; base 'trunk' floats in the model, and is "
        "assumed to be at rest: not tested"
    )
    assert not finding.severity and not finding.answered
    assert finding.says == (
        "base 'trunk' floats in the model, and is assumed to be at rest: not tested"
    )
    assert "no gyroscope or accelerometer" in finding.figure


def test_a_base_that_is_fixed_in_the_model_is_not_reported(tmp_path: Path) -> None:
    assert found(*logged(tmp_path, "", imu_gyro_x=np.sin(TIME))) == ()


def imu(turn: float, pull: float) -> Mapping[str, Array]:
    sway = np.sin(2.0 * np.pi * 0.7 * TIME)
    gyro = {f"imu_gyro_{axis}": turn * sway + 0.03 * NOISE[k] for k, axis in enumerate("xyz")}
    acc = {f"imu_acc_{axis}": pull * sway + 0.1 * NOISE[3 + k] for k, axis in enumerate("xyz")}
    return {**gyro, **acc, "imu_acc_z": acc["imu_acc_z"] + 9.81}


@pytest.mark.parametrize(("turn", "pull"), [(0.2, 0.0), (0.0, 0.8)])
def test_an_inertial_sensor_tells_that_the_base_moves(
    turn: float, pull: float, tmp_path: Path
) -> None:
    model, log = logged(tmp_path, "<freejoint/>", **imu(turn, pull))
    (finding,) = found(model, log)
    assert finding.severity is Severity.DOUBTFUL and finding.fix is not None
    assert "'trunk' is assumed to be at rest, but its sensor measures motion" in finding.says
    assert ("gyro" if turn else "acc") in finding.figure
    assert "base fixed" in finding.fix.says


def test_a_noisy_sensor_at_rest_says_so(tmp_path: Path) -> None:
    model, log = logged(tmp_path, "<freejoint/>", **imu(0.0, 0.0))
    (finding,) = found(model, log)
    assert not finding.severity and finding.answered and "at rest" in finding.says
    files = log_files([str(log)])
    loaded = subject_of(str(model), files[0]).loaded
    assert of_base(loaded, (finding,)) == ()
    (assumed,) = of_base(loaded, ())
    assert assumed.headline and "assumed to be at rest: not tested" in assumed.says


def test_degrees_are_distinguished_by_the_name(tmp_path: Path) -> None:
    slow = {"imu_gyro_deg_x": np.sin(TIME)}
    (finding,) = found(*logged(tmp_path, "<freejoint/>", **slow))
    assert not finding.severity


@pytest.mark.slow
def test_the_good_verdict_says_that_a_question_is_open(tmp_path: Path) -> None:
    model, log = logged(tmp_path, "<freejoint/>")
    shown = CliRunner().invoke(app, ["check", str(model), str(log), "--quick"])
    assert "base 'trunk' floats in the model" in shown.output
    fixed = CliRunner().invoke(app, ["check", str(model), str(log), "--fixed-base", "calf"])
    assert fixed.exit_code == 2 and "no joint is left to identify" in fixed.output
