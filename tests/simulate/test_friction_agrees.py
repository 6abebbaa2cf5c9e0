"""Coulomb friction of the virtual robot is that of the law that is fitted."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.virtual_robot import MujocoPlant, VirtualRobot


def test_a_joint_sticks_until_friction_is_overcome(arm: Robot) -> None:
    """Held below its Coulomb friction, the robot does not creep; above, it slips."""
    weightless = replace(arm, gravity=(0.0, 0.0, 0.0))
    truth = random_truth(weightless, 1, terms=[t for t in DEFAULT_TERMS if t.law != "offset"])
    values = truth.values.as_dict()
    level = np.array([values[f"coulomb.{c.name}"] for c in arm.joints])
    plant = MujocoPlant(weightless, truth)
    plant.place(np.zeros(arm.n))
    q, dq = plant.step(0.98 * level, 0.2)
    assert np.abs(dq).max() < 1e-6
    assert np.abs(q).max() < 1e-6
    _, dq = plant.step(1.5 * level, 0.2)
    assert np.abs(dq).max() > 1e-3


@pytest.mark.slow
def test_the_torque_is_that_of_the_model_with_the_plain_sign(arm: Robot) -> None:
    """Slow joints too: where they move, the fitted law explains the torque of the run."""
    truth = random_truth(arm, 2)
    slow = random_fourier(arm, seed=2, period=6.0)
    run = VirtualRobot(arm, truth).follow(slow)
    ddq = np.gradient(run.dq, 1e-3, axis=0)
    wanted = truth.model.at(truth.values).torque(Motion(run.t, run.q, run.dq, ddq))
    values = truth.values.as_dict()
    level = np.array([values[f"coulomb.{c.name}"] for c in arm.joints])
    error = np.abs(run.tau - wanted) / level
    slow_ones = (np.abs(run.dq) > 1e-3) & (np.abs(run.dq) < 2e-2)
    assert slow_ones.any()
    assert np.median(error[slow_ones]) < 0.02
    assert np.median(error[np.abs(run.dq) > 2e-2]) < 2e-3


def test_what_turns_smoothly_is_no_sticking_friction(arm: Robot) -> None:
    """Only the plain sign sticks; a smooth law is evaluated as it is."""
    smooth = tuple(Coulomb(smoothing=0.05) if t.law == "coulomb" else t for t in DEFAULT_TERMS)
    assert len(random_truth(arm, 1).brakes) == arm.n
    assert random_truth(arm, 1, terms=smooth).brakes == ()


def test_stiff_friction_needs_no_finer_step(pendulum: Robot, pendulum_truth: Truth) -> None:
    """However large for the inertia that it stops, and at the same step."""
    plant = MujocoPlant(pendulum, pendulum_truth.changed(**{"coulomb.pivot": 2500.0}))
    assert plant.timestep == 1.25e-4
    plant.place([0.1])
    q, dq = plant.step(np.zeros(1), 0.5)
    assert abs(q[0] - 0.1) < 1e-6 and abs(dq[0]) < 1e-6
