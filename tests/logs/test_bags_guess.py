"""Columns of message logs are distinguished by the joints' names in them."""

from pathlib import Path

import numpy as np
import pytest

from bag_writers import floats, in_order, joint_state, write_mcap
from steelyard.logs.formats import open_log
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_clock_positions_and_velocities import guess_time
from steelyard.robot.init.guess_columns import guess_columns
from steelyard.robot.robot import Coordinate

NAMES = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint")
JOINTS = tuple(Coordinate(name, "revolute") for name in NAMES)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("/joint_states/stamp", "time"),
        ("/joint_states/log_time", "time"),
        ("/effort_controller/joint_states/velocity/elbow_joint", "velocity"),
        ("/velocity/joint_states/effort/elbow_joint", "effort"),
        ("/joint_states/position/torque_tube", "position"),
        ("/cmd/position/elbow_joint", None),
        ("/wrench/wrench/force/x", "effort"),
    ],
)
def test_the_field_counts_and_not_the_topic(name: str, quantity: str | None) -> None:
    assert Column(name).quantity == quantity


def test_a_bag_is_distinguished_by_names(tmp_path: Path) -> None:
    """Another topic has a shorter name of its time, and the gripper's one the same joints."""
    rng = np.random.default_rng(1)
    joints = [joint_state(k * 10**7, NAMES[::-1], *rng.normal(size=(3, 4))) for k in range(50)]
    command = [floats(k * 10**7, [1.0, 2.0], "/a") for k in range(50)]
    log = open_log(write_mcap(tmp_path / "run.mcap", in_order([*joints, *command])))
    table = next(log.parts(log.columns))
    sample = dict(zip(log.columns, table.T, strict=True))
    guess = guess_columns(JOINTS, log.columns, sample)
    assert guess.section.time == "/joint_states/stamp"
    assert guess.section.time_unit == "s"
    assert guess.section.position == tuple(f"/joint_states/position/{n}" for n in NAMES)
    assert guess.section.effort.columns == tuple(f"/joint_states/effort/{n}" for n in NAMES)
    assert guess.joints == NAMES
    assert guess_time(log.columns, sample) == ("/joint_states/stamp", "s")


def test_numbers_in_the_topic_are_not_the_joints() -> None:
    columns = ["/t/stamp", "/ur10/joint_states/stamp"]
    columns += [
        f"/ur10/joint_states/{quantity}/{name}"
        for quantity in ("position", "velocity", "effort")
        for name in ("wrist_2", "elbow", "wrist_1")
    ]
    names = ("elbow", "wrist_1", "wrist_2")
    guess = guess_columns([Coordinate(name, "revolute") for name in names], columns)
    assert guess.section.time == "/ur10/joint_states/stamp"
    assert guess.section.position == tuple(f"/ur10/joint_states/position/{n}" for n in names)
    assert guess.velocity == tuple(f"/ur10/joint_states/velocity/{n}" for n in names)
