import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.errors import OutputError
from steelyard.base.progress import Event, Stopped
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.simulate import DemoFiles, demo_runs
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors, write_run


def interrupted(event: Event) -> bool:
    if event.done > 0.5:
        raise KeyboardInterrupt
    return True


def test_writes_log_truth_and_motion(arm: Robot, tmp_path: Path) -> None:
    truth, motion = random_truth(arm, 0), random_fourier(arm, seed=0, period=2.0)
    sensors = customary_sensors(arm, truth)
    rig = VirtualRobot(arm, truth, sensors, seed=4)
    files = write_run(rig, motion, tmp_path / "deep" / "out")
    table = pl.read_csv(files.log)
    assert len(table) == 1001 and len(table.columns) == 19
    back = Truth.from_dict(json.loads(files.truth.read_text()), arm)
    np.testing.assert_array_equal(back.inertial, truth.inertial)
    t = np.linspace(0, 2, 9)
    again = read_motion(files.trajectory, arm)
    np.testing.assert_array_equal(again.sample(t).q, motion.sample(t).q)
    assert {p.name for p in files.log.parent.iterdir()} == {
        "log.csv",
        "truth.json",
        "trajectory.json",
    }
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["out"]


def test_customary_sensors_scale_with_noise(tree: Robot) -> None:
    truth = random_truth(tree, 0)
    plain, double, none = (customary_sensors(tree, truth, k) for k in (1.0, 2.0, 0.0))
    np.testing.assert_allclose(plain.resolution, [4.79e-5, 1e-5, 4.79e-5, 4.79e-5], rtol=1e-3)
    np.testing.assert_allclose(double.torque_noise, 2.0 * plain.torque_noise)
    assert double.clock_jitter == 1e-4
    assert not none.torque_noise.any() and not none.resolution.any()


@pytest.mark.parametrize("error", [KeyboardInterrupt, Stopped])
def test_nothing_is_left_when_stopped(
    arm: Robot, tmp_path: Path, error: type[BaseException]
) -> None:
    truth, motion = random_truth(arm, 0), random_fourier(arm, seed=0, period=2.0)
    watch = interrupted if error is KeyboardInterrupt else lambda event: event.done < 0.5
    sensors = customary_sensors(arm, truth)
    with pytest.raises(error):
        rig = VirtualRobot(arm, truth, sensors, progress=watch)
        write_run(rig, motion, tmp_path / "out")
    with pytest.raises(error):
        demo_runs(tmp_path / "demo", progress=watch)
    assert not list(tmp_path.iterdir())


def test_a_folder_with_something_in_it_is_refused_before_any_work(
    arm: Robot, tmp_path: Path
) -> None:
    (tmp_path / "precious").write_text("x")
    truth, motion = random_truth(arm, 0), random_fourier(arm, seed=0, period=2.0)
    sensors, events = customary_sensors(arm, truth), []
    rig = VirtualRobot(arm, truth, sensors, progress=lambda e: not events.append(e))
    with pytest.raises(OutputError, match="exists already") as caught:
        write_run(rig, motion, tmp_path)
    assert str(tmp_path) in caught.value.where and not events
    with pytest.raises(OutputError, match="cannot be written|exists already"):
        write_run(rig, motion, tmp_path / "precious" / "sub")
    assert [p.name for p in tmp_path.iterdir()] == ["precious"]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> DemoFiles:
    """Those of a demonstration."""
    return demo_runs(tmp_path_factory.mktemp("demo"), seed=3, period=2.0)


@pytest.mark.slow
def test_demo_writes_what_identification_needs(files: DemoFiles) -> None:
    loaded = load_robot(files.robot)
    assert loaded.robot.n == 6 and loaded.signals is not None
    assert [term.description for term in loaded.terms or ()][1:3] == ["rotor_inertia", "coulomb"]
    first, second = (pl.read_csv(p) for p in (files.identification, files.validation))
    assert set(loaded.signals.columns) == set(first.columns)
    assert (len(first), len(second)) == (1501, 1001)
    assert np.abs(first["q1_rad"].to_numpy()[:1001] - second["q1_rad"].to_numpy()).max() > 0.05
    truth = Truth.from_dict(
        json.loads((files.robot.parent / "truth.json").read_text()), loaded.robot
    )
    assert np.abs(truth.inertial[:, 0] / loaded.robot.nominal[:, 0] - 1.0).max() > 0.1


@pytest.mark.slow
def test_demo_keeps_its_truth_out_of_the_robot_file(files: DemoFiles) -> None:
    nominal = load_robot(files.robot).robot.nominal
    text = files.robot.read_text() + files.robot.with_suffix(".urdf").read_text()
    parameters = json.loads((files.robot.parent / "truth.json").read_text())["parameters"]
    masses = [p["value"] for name, p in parameters.items() if name.startswith("m.")]
    assert len(masses) == len(nominal)
    for mass in masses:
        assert f"{mass:.6g}" not in text
        assert not np.any(np.isclose(nominal[:, 0], mass, rtol=1e-9))


@pytest.mark.slow
def test_demo_motions_stay_clear_of_the_limits(files: DemoFiles) -> None:
    robot = load_robot(files.robot).robot
    for log in (files.identification, files.validation):
        table = pl.read_csv(log)
        for j, joint in enumerate(robot.coordinates):
            q, dq, tau = (
                table[f"{c}{j + 1}_{u}"] for c, u in (("q", "rad"), ("dq", "rad_s"), ("tau", "Nm"))
            )
            assert joint.limits.lower < q.min() and q.max() < joint.limits.upper
            assert np.abs(dq).max() < joint.limits.velocity
            assert np.abs(tau).max() < joint.limits.effort
