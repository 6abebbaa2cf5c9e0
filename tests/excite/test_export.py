"""Tables and keyframes of motions, and what all exports have in common."""

from pathlib import Path

import mujoco
import numpy as np
import polars as pl
import pytest

from excite.exportable import NAMES, TOLERANCE, Swings, arm, motions
from invented import mimic, tree
from steelyard.base.errors import OutputError
from steelyard.excite.controller_file_formats import EXPORTS, exported, write_export
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.robot.robot import LoopClosure, Robot

TREE = """<mujoco><include file="trajectory.xml"/><worldbody>
  <body name="trunk"><joint name="trunk_joint"/><geom size="1"/>
    <body name="slider"><joint name="slider_joint" type="slide"/><geom size="1"/>
      <body name="tip"><joint name="tip_joint"/><geom size="1"/></body></body>
    <body name="left"><joint name="left_joint"/><geom size="1"/></body>
  </body></worldbody></mujoco>"""

MIMIC = """<mujoco><include file="trajectory.xml"/><worldbody>
  <body><joint name="shoulder"/><geom size="1"/>
    <body><joint name="twin"/><geom size="1"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("rate", [None, 125.0, 33.3])
@pytest.mark.parametrize("name", NAMES)
def test_tables_have_all_digits_and_are_read_again(
    name: str, rate: float | None, tmp_path: Path
) -> None:
    robot = arm(3, 1)
    motion = motions(robot)[name]
    path = write_export(motion, robot, "csv", tmp_path, rate)
    table = pl.read_csv(path)
    assert table.columns == ["time_s"] + [
        f"{what}_joint {k}" for what in ("q", "dq", "ddq") for k in (1, 2, 3)
    ]
    t = table["time_s"].to_numpy()
    assert t[0] == 0.0 and t[-1] == pytest.approx(motion.duration, abs=1e-12)
    np.testing.assert_allclose(np.diff(t)[:-1], 1.0 / (rate or 500.0), rtol=1e-9)
    for order, what in enumerate(("q", "dq", "ddq")):
        values = table.select([f"{what}_joint {k}" for k in (1, 2, 3)]).to_numpy()
        np.testing.assert_array_equal(values, motion.derivative(t, order))
    again = read_motion(path, robot)
    assert np.abs(again.sample(t).q - motion.derivative(t, 0)).max() < TOLERANCE


def keyframes(folder: Path, model: str, joints: list[str]) -> tuple[np.ndarray, ...]:
    """Times, positions and velocities of all keyframes, as MuJoCo has them."""
    (folder / "model.xml").write_text(model)
    loaded = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    data = mujoco.MjData(loaded)
    t, q, dq = [], [], []
    for key in range(loaded.nkey):
        mujoco.mj_resetDataKeyframe(loaded, data, key)
        t.append(data.time)
        q.append([data.joint(name).qpos[0] for name in joints])
        dq.append([data.joint(name).qvel[0] for name in joints])
    return np.array(t), np.array(q), np.array(dq)


@pytest.mark.parametrize("name", NAMES)
def test_keyframes_are_loaded_by_mujoco(name: str, tmp_path: Path) -> None:
    robot = tree()
    motion = motions(robot)[name]
    write_export(motion, robot, "mujoco", tmp_path, rate=20.0)
    t, q, dq = keyframes(tmp_path, TREE, list(robot.joint_names))
    assert t[0] == 0.0 and t[-1] == pytest.approx(motion.duration)
    assert np.diff(t).max() <= 0.05 + 1e-9
    np.testing.assert_allclose(q, motion.derivative(t, 0), atol=1e-12)
    np.testing.assert_allclose(dq, motion.derivative(t, 1), atol=1e-12)


def test_joints_that_follow_others_have_their_own_positions(tmp_path: Path) -> None:
    robot, motion = mimic(tmp_path), Swings(1)
    write_export(motion, robot, "mujoco", tmp_path)
    t, q, dq = keyframes(tmp_path, MIMIC, ["shoulder", "twin"])
    np.testing.assert_allclose(q[:, 1], -1.5 * motion.derivative(t, 0)[:, 0] + 0.2, atol=1e-12)
    np.testing.assert_allclose(dq[:, 1], -1.5 * motion.derivative(t, 1)[:, 0], atol=1e-12)


def test_loops_have_no_keyframes() -> None:
    robot = arm(2)
    pinned = robot.changed(loops=(LoopClosure("pin", (-1, 1), np.zeros((2, 3))),))
    with pytest.raises(OutputError, match="loops determine some of them"):
        exported(Swings(2), pinned, "mujoco")


@pytest.mark.parametrize("form", EXPORTS)
def test_files_are_never_overwritten(form: str, tmp_path: Path) -> None:
    robot = arm()
    path = write_export(Swings(), robot, form, tmp_path)
    assert path == tmp_path / EXPORTS[form].file
    assert path.read_text(encoding="utf-8") == exported(Swings(), robot, form)
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        write_export(Swings(), robot, form, tmp_path)
    assert path.read_text() == "mine" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(OutputError, match="cannot be written"):
        write_export(Swings(), robot, form, tmp_path / "none")


def test_formats_have_files_of_their_own() -> None:
    assert len({export.file for export in EXPORTS.values()}) == len(EXPORTS)


@pytest.mark.parametrize("form", EXPORTS)
@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_rates_that_cannot_be_are_refused(form: str, rate: float) -> None:
    wrong = r"not a valid rate|are more than 2000000 points|do not accept 1e\+09 set points"
    with pytest.raises(OutputError, match=wrong):
        exported(Swings(), arm(), form, rate)


def test_unknown_formats_are_refused(tmp_path: Path) -> None:
    robot: Robot = arm()
    with pytest.raises(OutputError, match="no format 'rapit'") as caught:
        write_export(Swings(), robot, "rapit", tmp_path)
    assert "did you mean 'rapid'" in caught.value.fix
