"""Torques along a motion: smoothing, joints by name, models that give no torques."""

import numpy as np
import pytest

from law_cases import LawCase, name_of, spanning
from moving import geared
from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.model import Model, ValuedModel
from steelyard.model.torque_and_quantities import FRICTION
from steelyard.uses.control.feedforward import feedforward_torque, in_joint_order
from uses.conftest import valued_of

ROBOT = geared()


def slow(speed: float, n: int) -> Motion:
    """One sample at a speed of all joints."""
    return Motion([0.0], np.zeros((1, n)), np.full((1, n), speed), np.zeros((1, n)))


@pytest.mark.slow
@pytest.mark.parametrize("case", spanning(), ids=name_of)
def test_it_is_the_torque_of_every_law_where_joints_move(case: LawCase) -> None:
    law = case.on(ROBOT)
    model = Model(ROBOT, (law,))
    valued = model.at(Parameters(model.names, model.units, np.ones(len(model.names))))
    t = np.linspace(0.0, 1.0, 50)[:, None]
    rates = np.array([2.0, 3.0, 4.0, 5.0])
    motion = Motion(
        t[:, 0],
        0.3 * np.sin(rates * t),
        2.0 + rates * np.cos(rates * t) / 5.0,
        -rates * np.sin(rates * t),
    )
    for width in (0.0, 1e-6):
        found = feedforward_torque(valued, motion, width)
        np.testing.assert_allclose(found, valued.torque(motion), rtol=1e-6, atol=1e-9)


def test_friction_by_the_plain_sign_turns_within_a_speed(valued: ValuedModel) -> None:
    n = valued.model.robot.n
    only = valued_of(Coulomb())
    for speed in (-2e-3, -1e-17, 0.0, 1e-3):
        found = feedforward_torque(only, slow(speed, n), quantity=FRICTION)[0]
        np.testing.assert_allclose(found, 0.5 * np.tanh(speed / 1e-3), atol=1e-12)
    plain = feedforward_torque(only, slow(1e-17, n), 0.0, FRICTION)[0]
    np.testing.assert_array_equal(plain, 0.5)


def test_a_smoothing_of_the_robot_file_is_kept() -> None:
    only = valued_of(Coulomb(smoothing=0.05))
    found = feedforward_torque(only, slow(0.05, only.model.robot.n), quantity=FRICTION)[0]
    np.testing.assert_allclose(found, 0.5 * np.tanh(1.0))


def test_joints_are_matched_by_name(valued: ValuedModel, motion: Motion) -> None:
    robot = valued.model.robot
    back = list(reversed(robot.joint_names))
    turned = Motion(motion.t, motion.q[:, ::-1], motion.dq[:, ::-1], motion.ddq[:, ::-1])
    found = in_joint_order(turned, back, robot, "here")
    np.testing.assert_array_equal(found.q, motion.q)
    np.testing.assert_array_equal(found.ddq, motion.ddq)
    assert in_joint_order(motion, None, robot, "here") is motion


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda names: None, "joints without names"),
        (lambda names: names[:-1], "names are given for the"),
        (lambda names: [names[0], *names[:-1]], "one twice"),
        (lambda names: ["other", *names[1:]], "the motion has no joint"),
    ],
)
def test_joints_that_do_not_fit_are_refused(
    valued: ValuedModel, motion: Motion, change: object, words: str
) -> None:
    robot = valued.model.robot
    names = change(list(robot.joint_names))  # type: ignore[operator]
    given = motion
    if names is None:
        given = Motion(motion.t, motion.q[:, 1:], motion.dq[:, 1:], motion.ddq[:, 1:])
    with pytest.raises(DataError, match=words) as caught:
        in_joint_order(given, names, robot, "here")
    assert caught.value.where == "here"


def test_a_joint_that_the_model_lacks_is_refused(valued: ValuedModel, motion: Motion) -> None:
    robot = valued.model.robot
    more = [np.column_stack([x, x[:, 0]]) for x in (motion.q, motion.dq, motion.ddq)]
    with pytest.raises(DataError, match="the model has no joint 'gripper'"):
        in_joint_order(Motion(motion.t, *more), [*robot.joint_names, "gripper"], robot, "here")
