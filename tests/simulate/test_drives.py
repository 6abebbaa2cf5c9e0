"""Encoders, dead time, lag and saturation between a controller and the joints."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.robot import Robot
from steelyard.simulate.drives_sensors_and_loads import (
    Drives,
    DrivesInUse,
    customary_drives,
)
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot
from steelyard.uses.control.joint_controllers import Cascade

TICK = 1e-3


def seen(drives: Drives, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the controller sees of one joint, tick by tick."""
    used = DrivesInUse(drives, TICK, q[:1])
    found = [used.sense(a[None], b[None]) for a, b in zip(q, dq, strict=True)]
    return np.array(found)[:, 0, 0], np.array(found)[:, 1, 0]


def test_perfect_drives_change_nothing() -> None:
    used = DrivesInUse(Drives(), TICK, np.zeros(2))
    q, dq = np.array([0.1, 0.2]), np.array([1.0, 2.0])
    assert used.sense(q, dq)[0] is q
    np.testing.assert_array_equal(used.actuate(q), q)


def test_the_controller_sees_steps_of_the_encoder_and_old_values() -> None:
    t = TICK * np.arange(100)
    q, dq = np.sin(5.0 * t), 5.0 * np.cos(5.0 * t)
    steps, speeds = seen(Drives(resolution=0.01), q, dq)
    np.testing.assert_allclose(steps, np.round(q / 0.01) * 0.01)
    np.testing.assert_array_equal(speeds, dq)
    late, _ = seen(Drives(delay=3e-3), q, dq)
    np.testing.assert_array_equal(late[3:], q[:-3])
    np.testing.assert_array_equal(late[:3], q[0])


def test_speeds_are_filtered_differences_of_what_the_encoder_says() -> None:
    t = TICK * np.arange(400)
    q, dq = 2.0 * t, np.full(len(t), 2.0)
    _, raw = seen(Drives(speed_filter=0.0), q, dq)
    np.testing.assert_allclose(raw[1:], 2.0)
    _, slow = seen(Drives(speed_filter=0.02), q, dq)
    np.testing.assert_allclose(slow[1:], 2.0 * (1.0 - np.exp(-t[1:] / 0.02)), rtol=1e-9)
    _, coarse = seen(Drives(resolution=0.01, speed_filter=0.0), q, dq)
    np.testing.assert_allclose(np.unique(coarse.round(6)), [0.0, 10.0])


def test_the_motion_as_seen_is_what_a_robot_on_it_shows() -> None:
    t = TICK * np.arange(200)
    q, dq = np.sin(5.0 * t), 5.0 * np.cos(5.0 * t)
    drives = Drives(speed_filter=2e-3, delay=2e-3)
    shown = drives.seen(Motion(t, q[:, None], dq[:, None], dq[:, None]))
    own = seen(drives, q, dq)
    np.testing.assert_allclose(shown.q[:, 0], own[0])
    np.testing.assert_allclose(shown.dq[:, 0], own[1], atol=1e-12)


def test_torque_lags_and_its_impulse_is_exact() -> None:
    used = DrivesInUse(Drives(lag=2e-3), TICK, np.zeros(1))
    held = np.array([used.actuate(np.ones(1))[0] for _ in range(50)])
    edges = TICK * np.arange(51)
    area = edges + 2e-3 * np.exp(-edges / 2e-3)
    np.testing.assert_allclose(held, np.diff(area) / TICK, rtol=1e-9)


def test_torque_saturates_per_joint() -> None:
    used = DrivesInUse(Drives(limits=[1.0, 5.0]), TICK, np.zeros(2))
    np.testing.assert_array_equal(used.actuate(np.array([3.0, -7.0])), [1.0, -5.0])
    np.testing.assert_array_equal(used.command, [1.0, -5.0])


@pytest.mark.parametrize("wrong", [{"lag": -1.0}, {"delay": -1.0}, {"limits": 0.0},
                                   {"resolution": -1.0}, {"speed_filter": -1.0}])  # fmt: skip
def test_impossible_drives_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ModelError, match="drives of the virtual robot"):
        Drives(**wrong)  # type: ignore[arg-type]


@pytest.mark.slow
def test_commands_are_recorded_and_limited(leg: Robot) -> None:
    truth, motion = random_truth(leg, 0), random_fourier(leg, seed=1, period=1.5)
    drives = customary_drives(leg)
    assert drives.dead_time == pytest.approx(4e-3)
    rig = VirtualRobot(leg, truth, control=Cascade(), drives=drives, rest=0.2)
    run = rig.follow(motion)
    goal, speed, command = run.commanded
    wanted = motion.sample(np.clip(run.t - 0.2, 0.0, 1.5))
    np.testing.assert_array_equal(goal, wanted.q)
    assert np.abs(run.q - goal).max() < 0.01
    np.testing.assert_array_equal(speed[run.t < 0.2], 0.0)
    # the response to a command a while ago is forgotten
    used = DrivesInUse(drives, TICK, goal[0])
    held = np.array([used.actuate(one) for one in command])
    np.testing.assert_allclose(run.tau[200:], 0.5 * (held[199:-1] + held[200:]), atol=1e-9)
    bound = 0.6 * np.abs(command).max(axis=0)
    weak = VirtualRobot(leg, truth, control=Cascade(), drives=Drives(limits=bound), rest=0.2)
    np.testing.assert_array_less(np.abs(weak.follow(motion).commanded[2]).max(axis=0), bound + 1e-9)


def test_a_limit_of_zero_in_a_model_file_is_none(leg: Robot) -> None:
    first, second = leg.coordinates
    joints = (replace(first, limits=replace(first.limits, effort=0.0)), second)
    limits = customary_drives(leg.changed(coordinates=joints)).limits
    np.testing.assert_array_equal(limits, [np.inf, second.limits.effort])


def test_friction_drifts_by_a_factor_and_nothing_else(leg: Robot) -> None:
    truth = random_truth(leg, 0)
    drifted = truth.drifted(1.2)
    for name, value in truth.values.as_dict().items():
        factor = 1.2 if name.split(".")[0] in ("coulomb", "viscous") else 1.0
        assert drifted.values[name] == factor * value
