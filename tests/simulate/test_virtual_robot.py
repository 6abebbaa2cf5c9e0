from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import CubicSpline

from steelyard.base.errors import DataError, OutputError
from steelyard.base.motion import Rig, run
from steelyard.base.progress import Event, Stopped
from steelyard.estimate.closed_loop.feedback_and_forward_dynamics import tuned_pd
from steelyard.excite.trajectories.fourier import FourierMotion, random_fourier
from steelyard.robot.robot import Robot
from steelyard.simulate.drives_sensors_and_loads import Sensors, TrueRun
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.mujoco_model import build, inverse_dynamics
from steelyard.simulate.virtual_robot import VirtualRobot


def motion_of(robot: Robot, period: float = 4.0) -> FourierMotion:
    return random_fourier(robot, seed=7, period=period, harmonics=3)


def oracle_torque(robot: Robot, truth: Truth, run: TrueRun, shift: float = 0.0) -> np.ndarray:
    """Torque of the truth for the positions of a run, differentiated by a spline."""
    spline = CubicSpline(run.t, run.q)
    q, dq, ddq = (spline(run.t + shift, order) for order in range(3))
    value = {
        law: np.array([truth.values[f"{law}.{joint}"] for joint in robot.joint_names])
        for law in ("coulomb", "viscous", "offset")
    }
    friction = value["coulomb"] * np.sign(dq) + value["viscous"] * dq
    model = build(robot, truth.inertial, truth.rotors)
    return inverse_dynamics(model, q, dq, ddq) + friction + value["offset"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arm", "tree"])
def test_torque_and_motion_are_of_one_moment(name: str, request: pytest.FixtureRequest) -> None:
    robot: Robot = request.getfixturevalue(name)
    truth = random_truth(robot, 0)
    run = VirtualRobot(robot, truth).follow(motion_of(robot))
    inner = slice(20, -20)
    tau = oracle_torque(robot, truth, run)[inner]
    slips = np.abs(run.dq[inner]) > 0.02
    error = np.linalg.norm(slips * (tau - run.tau[inner]), axis=0) / np.linalg.norm(tau, axis=0)
    assert np.all(error < 0.0015)
    later = oracle_torque(robot, truth, run, 5e-4)[inner]
    slope = slips * (later - tau) / 5e-4
    delay = np.sum((run.tau[inner] - tau) * slope) / np.sum(slope**2)
    assert abs(delay) < 1e-4


@pytest.mark.slow
def test_follows_the_motion_and_rests(arm: Robot) -> None:
    motion = motion_of(arm)
    run = VirtualRobot(arm, random_truth(arm, 0), rest=0.8).follow(motion)
    wanted = motion.sample(run.t - 0.8)
    assert run.t[-1] == pytest.approx(5.6)
    assert np.abs(run.q - wanted.q).max() < 0.03
    assert np.sqrt(np.mean((run.q - wanted.q) ** 2, axis=0)).max() < 0.012
    resting = run.t < 0.75
    assert np.abs(run.dq[resting]).max() < 2e-3
    assert np.ptp(run.tau[resting], axis=0).max() < 0.2
    assert np.abs(run.dq[-100:]).max() < 5e-3


def test_gains_are_critically_damped_and_lowered_where_coupled() -> None:
    alone = tuned_pd(np.array([np.diag([2.0, 0.5])]), bandwidth=10.0)
    omega = 20.0 * np.pi
    np.testing.assert_allclose(alone.stiffness, omega**2 * np.array([2.0, 0.5]))
    np.testing.assert_allclose(alone.damping, 2.0 * omega * np.array([2.0, 0.5]))
    coupled = np.array([[[1.0, 0.95], [0.95, 1.0]]])
    soft = tuned_pd(coupled, bandwidth=50.0)
    rates = np.linalg.eigvals(np.linalg.solve(coupled[0], np.diag(soft.damping)))
    assert rates.max() / 1000.0 == pytest.approx(0.5)


@pytest.mark.slow
def test_same_seed_same_log_and_runs_differ(arm: Robot, tmp_path: Path) -> None:
    truth, motion = random_truth(arm, 0), motion_of(arm, 0.5)
    sensors = Sensors(torque_noise=0.1, clock_jitter=1e-4)
    logs = {}
    for name, seed, runs in (("a", 1, 2), ("b", 1, 2), ("c", 2, 1)):
        rig: Rig = VirtualRobot(arm, truth, sensors, seed=seed, rest=0.2)
        for number in range(1, runs + 1):
            run(rig, motion, tmp_path / f"{name}{number}.parquet")
            logs[f"{name}{number}"] = pl.read_parquet(tmp_path / f"{name}{number}.parquet")
    assert logs["a1"].equals(logs["b1"]) and logs["a2"].equals(logs["b2"])
    assert not logs["a1"].equals(logs["a2"]) and not logs["a1"].equals(logs["c1"])


def test_csv_and_parquet_hold_the_same(arm: Robot, tmp_path: Path) -> None:
    truth, motion = random_truth(arm, 0), motion_of(arm, 0.5)
    for suffix in ("csv", "parquet"):
        run(VirtualRobot(arm, truth, seed=1, rest=0.1), motion, tmp_path / f"log.{suffix}")
    table = pl.read_csv(tmp_path / "log.csv")
    assert table.equals(pl.read_parquet(tmp_path / "log.parquet"))
    assert table.columns[:2] == ["time_s", "q1_rad"] and len(table) == 176


def test_other_endings_and_missing_folders_are_refused(arm: Robot, tmp_path: Path) -> None:
    rig = VirtualRobot(arm, random_truth(arm, 0), rest=0.0)
    with pytest.raises(OutputError, match="cannot be written as '.xlsx'"):
        run(rig, motion_of(arm, 1.0), tmp_path / "log.xlsx")
    with pytest.raises(OutputError, match="cannot be written"):
        run(rig, motion_of(arm, 1.0), tmp_path / "none" / "log.csv")
    assert not list(tmp_path.iterdir())


def test_progress_advances_and_stops(arm: Robot, tmp_path: Path) -> None:
    events: list[Event] = []

    def watch(event: Event) -> bool:
        events.append(event)
        return event.done < 1.0

    rig = VirtualRobot(arm, random_truth(arm, 0), progress=watch)
    with pytest.raises(Stopped, match="stopped during simulation, 1 of 6 done"):
        run(rig, motion_of(arm), tmp_path / "log.parquet")
    assert [e.done for e in events] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_recording_holds_the_motion_that_was_sent(arm: Robot, tmp_path: Path) -> None:
    truth, motion = random_truth(arm, 0), motion_of(arm, 1.0)
    watched, plain = (VirtualRobot(arm, truth, seed=4, rest=0.1) for _ in range(2))
    watched.send(motion)
    with watched.record(tmp_path / "by hand.parquet"):
        watched.send(motion)
    run(plain, motion, tmp_path / "run.parquet")
    logs = [pl.read_parquet(tmp_path / f"{name}.parquet") for name in ("by hand", "run")]
    assert logs[0].equals(logs[1])


def test_a_recording_holds_one_motion(arm: Robot, tmp_path: Path) -> None:
    motion, log = motion_of(arm, 0.5), tmp_path / "log.parquet"
    rig = VirtualRobot(arm, random_truth(arm, 0), rest=0.0)
    with pytest.raises(DataError, match="no motion was sent"), rig.record(log):
        pass
    with pytest.raises(DataError, match="this is a second one"), rig.record(log):
        rig.send(motion)
        rig.send(motion)
    with pytest.raises(ZeroDivisionError), rig.record(log):
        rig.send(motion)
        raise ZeroDivisionError
    assert not log.exists()
    run(rig, motion, log)
    assert log.exists()
