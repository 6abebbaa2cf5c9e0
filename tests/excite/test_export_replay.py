"""Programs for ROS 2 and UR, replayed by independent interpreters."""

import re
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from excite.exportable import NAMES, TOLERANCE, Jumps, Swings, arm, motions
from excite.interpreters import Follower, URController, moments
from steelyard.base.errors import OutputError
from steelyard.excite.controller_file_formats import PEANO_BOUND, exported
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.fourier import random_fourier


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_joint_trajectories_are_followed_at_all_times(name: str) -> None:
    robot = arm(4, 0)
    motion = motions(robot)[name]
    follower = Follower(exported(motion, robot, "ros2"))
    t = moments(motion.duration)
    error = np.abs(follower.at(t + follower.start) - motion.derivative(t, 0))
    assert error.max() < TOLERANCE
    assert len(follower.states) < 400 * motion.duration


def test_points_beside_jumps_are_needed() -> None:
    motion = Jumps()
    follower = Follower(exported(motion, arm(), "ros2"))
    jumps = motion.breaks[1:-1]
    near = np.abs(np.array(follower.nanoseconds) * 1e-9 - follower.start - jumps[:, None]).min(1)
    assert near.max() < 2e-6
    pairs = np.flatnonzero(np.diff(follower.nanoseconds) < 3000)
    assert len(pairs) == len(jumps)
    follower.states[pairs, 2] = follower.states[pairs + 1, 2]
    t = moments(motion.duration)
    moved = np.abs(follower.at(t + follower.start) - motion.derivative(t, 0)).max()
    assert moved > 1e-5


def test_joint_trajectories_are_messages_of_ros() -> None:
    robot = arm(3, 1)
    text = exported(Swings(3), robot, "ros2", rate=50.0)
    message = YAML(typ="safe").load(text)
    store = get_typestore(Stores.ROS2_HUMBLE)
    whole = made(store.types, "trajectory_msgs/msg/JointTrajectory", message)
    again = store.deserialize_cdr(store.serialize_cdr(whole, whole.__msgtype__), whole.__msgtype__)
    assert again.joint_names == ["joint 1", "joint 2", "joint 3"]
    assert len(again.points) >= 4.71 * 50
    assert again.points[0].time_from_start.sec == 10
    # YAML 1.1, which ROS reads, takes some numbers with exponents for words
    rows = re.findall(r"(?:positions|velocities|accelerations): \[(.*)\]", text)
    numbers = [number for row in rows for number in row.split(", ")]
    assert len(numbers) > 1000
    assert all(re.fullmatch(r"-?\d+\.\d+", number) for number in numbers)
    assert "-0.000000000" not in numbers and "0.000000000" in numbers and text.isascii()


def made(types: Any, name: str, values: dict[str, Any]) -> Any:
    """A message of ROS from a mapping, each field by its type."""
    of = {
        "trajectory_msgs/msg/JointTrajectory": {
            "header": lambda v: made(types, "std_msgs/msg/Header", v),
            "points": lambda v: [
                made(types, "trajectory_msgs/msg/JointTrajectoryPoint", p) for p in v
            ],
        },
        "std_msgs/msg/Header": {
            "stamp": lambda v: made(types, "builtin_interfaces/msg/Time", v),
        },
        "trajectory_msgs/msg/JointTrajectoryPoint": {
            "time_from_start": lambda v: made(types, "builtin_interfaces/msg/Duration", v),
            **dict.fromkeys(("positions", "velocities", "accelerations"), np.array),
        },
    }.get(name, {})
    extra = {"effort": np.zeros(0)} if name.endswith("Point") else {}
    return types[name](**{k: of.get(k, lambda v: v)(v) for k, v in values.items()}, **extra)


def test_the_bound_of_the_error_of_splines() -> None:
    s = (np.arange(4000) + 0.5) / 4000
    x = np.linspace(0.0, 1.0, 201)[:, None]
    q = 10 * x**3 - 15 * x**4 + 6 * x**5
    v = -4 * x**3 + 7 * x**4 - 3 * x**5
    a = 0.5 * (x**3 - 2 * x**4 + x**5)
    kernel = np.maximum(x - s, 0) ** 2 / 2 - q * (1 - s) ** 2 / 2 - v * (1 - s) - a
    greatest = np.abs(kernel).mean(axis=1).max()
    assert 0.99 * PEANO_BOUND < greatest < PEANO_BOUND


def driven(motion: ExactTrajectory, rate: float, period: float) -> tuple[URController, np.ndarray]:
    """A UR that ran the program, and the times of its set points after the first."""
    away = motion.derivative([0.0], 0)[0] + 0.8
    robot = URController(exported(motion, arm(), "urscript", rate), away, period)
    t = np.array([time for time, _ in robot.set_points])
    return robot, t - t[0]


@pytest.mark.parametrize("rate, period", [(125.0, 0.008), (500.0, 0.002), (125.0, 0.002)])
@pytest.mark.parametrize("name", NAMES)
def test_urscript_is_followed(name: str, rate: float, period: float) -> None:
    motion = motions(arm())[name]
    robot, t = driven(motion, rate, period)
    points = np.array([q for _, q in robot.set_points])
    assert motion.duration - 1e-9 < t[-1] < motion.duration + 1.0 / rate
    wanted = motion.derivative(np.minimum(t, motion.duration), 0)
    assert np.abs(points - wanted).max() < TOLERANCE
    np.testing.assert_allclose(np.diff(t), 1.0 / rate, rtol=1e-9)
    assert robot.fastest <= 0.25


def test_urscript_stands_at_the_start_before_it_serves() -> None:
    robot, _ = driven(Swings(), 500.0, 0.002)
    np.testing.assert_allclose(robot.set_points[0][1], np.zeros(6), atol=1e-9)
    # 0.8 rad at 0.2 rad/s, and a second of rest
    assert 5.0 < robot.set_points[0][0] < 6.0


def test_what_a_ur_cannot_do_is_refused() -> None:
    for robot, wrong in (
        (arm(7), "six revolute joints, this one has 7 joints"),
        (arm(6, 2), "6 joints, 1 of them prismatic"),
    ):
        with pytest.raises(OutputError, match=wrong):
            exported(Swings(robot.n), robot, "urscript")
    with pytest.raises(OutputError, match="do not accept 100 set points") as caught:
        exported(Swings(), arm(), "urscript", rate=100.0)
    assert "125" in caught.value.fix and "500" in caught.value.fix


@pytest.mark.parametrize("form", ["ros2", "urscript", "krl", "rapid"])
def test_controllers_start_and_end_at_rest(form: str) -> None:
    class Running(Swings):
        """Starts at rest, ends in motion."""

        def derivative(self, t: Any, order: int) -> np.ndarray:
            return super().derivative(np.asarray(t) * 0.9, order) * 0.9**order

    with pytest.raises(OutputError, match="ends with .* rad/s") as caught:
        exported(Running(), arm(), form)
    assert caught.value.where == "joint 'joint 6'"
    assert exported(Running(), arm(), "csv").count("\n") > 2000


def test_a_still_motion_can_be_sent() -> None:
    motion = random_fourier(arm(), seed=0)
    still = type(motion)(motion.start, 0 * motion.sine, 0 * motion.cosine, 3.0)
    follower = Follower(exported(still, arm(), "ros2"))
    assert np.ptp(follower.states[:, 0], axis=0).max() == 0.0
