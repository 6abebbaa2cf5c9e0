"""An outside wrench: at rest the joints hold it, in either axes; its columns and its table."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.errors import DataError, ModelError
from steelyard.base.motion import run
from steelyard.excite.trajectories.exact_trajectories import SampledMotion
from steelyard.model.equations.frame_and_point_kinematics import frame_kinematics
from steelyard.robot.robot import Robot
from steelyard.simulate.drives_sensors_and_loads import (
    WRENCH_COLUMNS,
    AppliedWrench,
    Axes,
    Payload,
    Sensors,
    read_wrench,
)
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.virtual_robot import VirtualRobot

PUSH = np.array([3.0, -2.0, 4.0, 0.3, -0.2, 0.5])


def still(q: np.ndarray) -> SampledMotion:
    return SampledMotion([0.0, 1.0], np.array([q, q]))


def frictionless(robot: Robot) -> Truth:
    return random_truth(robot, 0).drifted(0.0)


@pytest.mark.slow
@pytest.mark.parametrize("axes", ["base", "frame"])
@pytest.mark.parametrize("payload", [None, Payload.ball(2.0, "tool")])
def test_at_rest_the_joints_hold_it(arm: Robot, axes: Axes, payload: Payload | None) -> None:
    truth, q = frictionless(arm), np.array([0.3, -0.4, 0.8, 0.5, -0.6, 0.2])
    wrench = AppliedWrench("tool", [0.5], [PUSH], axes)
    bare, pushed = (
        VirtualRobot(arm, truth, rest=0.2, wrench=w, payload=payload).follow(still(q))
        for w in (None, wrench)
    )
    # at the posture that the robot sags to
    _, rotation, jacobian = frame_kinematics(arm, "tool")(pushed.q[-1:])
    turned = np.kron(np.eye(2), rotation[0])
    base = PUSH if axes == "base" else turned @ PUSH
    gravity = pushed.gravity[-1] - bare.gravity[-1]
    held = pushed.tau[-1] - bare.tau[-1]
    if payload is None:
        np.testing.assert_allclose(held - gravity, -jacobian[0].T @ base, atol=2e-3)
    else:
        np.testing.assert_allclose(held, -jacobian[0].T @ base, atol=0.05)
    assert bare.wrench is None and pushed.wrench is not None
    own = turned.T @ PUSH if axes == "base" else PUSH
    np.testing.assert_allclose(pushed.wrench[-1], own, atol=1e-6)
    before = pushed.t < 0.5
    np.testing.assert_array_equal(pushed.wrench[before], 0.0)
    np.testing.assert_allclose(pushed.tau[before], bare.tau[before], atol=1e-9)


def test_a_row_of_the_table_holds_until_the_next_one(tmp_path: Path) -> None:
    file = tmp_path / "push.csv"
    rows = [[0.5, *PUSH], [0.7, *(0.0 * PUSH)]]
    pl.DataFrame(rows, schema=["time_s", *WRENCH_COLUMNS], orient="row").write_csv(file)
    found = read_wrench(file, "tool", "frame")
    assert (found.frame, found.axes) == ("tool", "frame")
    np.testing.assert_array_equal(
        found.at(np.array([0.0, 0.5, 0.69, 0.7, 5.0]))[:, 0], [0.0, 3.0, 3.0, 0.0, 0.0]
    )


@pytest.mark.slow
def test_the_log_has_what_a_sensor_says_of_it(arm: Robot, tmp_path: Path) -> None:
    truth, wrench = frictionless(arm), AppliedWrench("tool", [0.0], [PUSH], "frame")
    sensors = Sensors(rate=1000.0, wrench_noise=0.1)
    rig = VirtualRobot(arm, truth, sensors, rest=0.2, wrench=wrench)
    run(rig, still(np.zeros(6)), tmp_path / "log.csv")
    table = pl.read_csv(tmp_path / "log.csv")
    assert table.columns[-6:] == list(WRENCH_COLUMNS)
    noise = table.select(WRENCH_COLUMNS).to_numpy() - PUSH
    assert np.abs(noise.mean(axis=0)).max() < 0.02
    np.testing.assert_allclose(noise.std(axis=0), 0.1, rtol=0.1)
    plain = VirtualRobot(arm, truth, sensors, rest=0.2)
    run(plain, still(np.zeros(6)), tmp_path / "plain.csv")
    assert not set(WRENCH_COLUMNS) & set(pl.read_csv(tmp_path / "plain.csv").columns)


def test_unusable_wrenches_are_refused(arm: Robot, tmp_path: Path) -> None:
    truth = frictionless(arm)
    with pytest.raises(ModelError, match="no frame 'tol'"):
        VirtualRobot(arm, truth, wrench=AppliedWrench("tol", [0.0], [PUSH]))
    with pytest.raises(DataError, match="times do not increase"):
        AppliedWrench("tool", [0.5, 0.5], [PUSH, PUSH])
    with pytest.raises(DataError, match="no finite number"):
        AppliedWrench("tool", [0.5], [[np.nan, *PUSH[1:]]])
    (tmp_path / "push.csv").write_text("time_s,fx_N,fy_N,fz_N,tx_Nm,ty_Nm\n0,1,2,3,4,5\n")
    with pytest.raises(DataError, match="no column 'tz_Nm'"):
        read_wrench(tmp_path / "push.csv", "tool")
    with pytest.raises(DataError):
        read_wrench(tmp_path / "none.csv", "tool")


def test_a_wrench_on_the_base_is_refused(arm: Robot) -> None:
    from steelyard.estimate.external.wrench_methods_and_observer_step import moved_frame
    from steelyard.robot.robot import Frame

    fixed = arm.changed(frames=(*arm.frames, Frame("table", -1, np.eye(3), np.zeros(3))))
    with pytest.raises(ModelError, match="fixed to the base"):
        moved_frame(fixed, "table")
