"""Closed chains in the simulation."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.robot.loop_closures import gaps
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.typical_torques_and_masses import (
    closed,
    passive_slopes,
    postures_of,
    typical_masses,
)
from steelyard.simulate.virtual_robot import MujocoPlant, VirtualRobot


def joints_of(plant: MujocoPlant) -> np.ndarray:
    return np.asarray(plant._data.qpos - plant.model.offset)


def test_placing_closes_the_loop_and_motion_keeps_it_closed(
    four_bar: Robot, make_truth: Callable
) -> None:
    plant = MujocoPlant(four_bar, make_truth(four_bar))
    plant.place([0.9])
    assert gaps(four_bar, joints_of(plant)).max() < 1e-9
    for _ in range(300):
        q, dq = plant.step(np.array([4.0]), 1e-3)
        assert gaps(four_bar, joints_of(plant)).max() < 1e-7
    assert q.shape == (1,) and abs(q[0] - 0.9) > 0.05


@pytest.mark.slow
def test_a_free_linkage_keeps_its_energy(four_bar: Robot, make_truth: Callable) -> None:
    truth = make_truth(four_bar)
    plant = MujocoPlant(four_bar, truth)
    plant.place([1.1])
    energies = []
    for _ in range(600):
        q, dq = plant.step(np.zeros(1), 1e-3)
        full = closed(four_bar, q, joints_of(plant))
        rates = passive_slopes(four_bar, full) @ dq
        energies.append(_energy(four_bar, full, rates))
    energies = np.array(energies)
    kinetic = energies[:, 0].max()
    assert kinetic > 5.0
    assert np.ptp(energies.sum(axis=1)) < 2e-4 * kinetic


def _energy(robot: Robot, q: np.ndarray, dq: np.ndarray) -> tuple[float, float]:
    """Kinetic and potential energy of planar bodies, from the positions of their centres."""
    kinetic = potential = 0.0
    for index, body in enumerate(robot.bodies):
        chain, k = [], index
        while k >= 0:
            chain.insert(0, k)
            k = robot.bodies[k].parent
        origin, angle, rate, speed = np.zeros(2), 0.0, 0.0, np.zeros(2)
        for k in chain:
            arm = _turned(angle, robot.bodies[k].position[:2])
            origin, speed = origin + arm, speed + rate * _left(arm)
            angle, rate = angle + q[k], rate + dq[k]
        arm = _turned(angle, body.inertia.com[:2])
        centre, speed = origin + arm, speed + rate * _left(arm)
        kinetic += 0.5 * body.inertia.mass * speed @ speed
        kinetic += 0.5 * body.inertia.inertia_com[2, 2] * rate**2
        potential += 9.81 * body.inertia.mass * centre[1]
    return kinetic, potential


def _turned(angle: float, x: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])


def _left(x: np.ndarray) -> np.ndarray:
    return np.array([-x[1], x[0]])


@pytest.mark.slow
def test_torque_is_that_of_the_closed_model(four_bar: Robot) -> None:
    terms = (RigidBody(), RotorInertia(), Viscous(joints=("crank_joint", "rocker_joint")))
    truth = random_truth(four_bar, 0, terms=terms)
    motion = random_fourier(four_bar, seed=1, period=3.0, harmonics=3)
    run = VirtualRobot(four_bar, truth, rest=0.2).follow(motion)
    spline = CubicSpline(run.t, run.q)
    samples = Motion(run.t, *(spline(run.t, k) for k in range(3)))
    torque = truth.model.at(truth.values).torque(samples)
    inner = slice(220, -220)
    error = np.linalg.norm((torque - run.tau)[inner]) / np.linalg.norm(torque[inner])
    assert error < 1e-3 and np.ptp(run.q) > 0.3


def test_masses_are_those_of_the_independent_joint(four_bar: Robot, make_truth: Callable) -> None:
    plant = MujocoPlant(four_bar, make_truth(four_bar))
    masses, postures = typical_masses(four_bar, plant.model), postures_of(four_bar)
    for mass, q, slopes in zip(masses[:5], postures.q, postures.full, strict=False):
        kinetic, _ = _energy(four_bar, q, slopes @ np.ones(1))
        assert mass[0, 0] == pytest.approx(2.0 * kinetic, rel=1e-6)


def test_where_a_loop_cannot_close_is_reported(four_bar: Robot, make_truth: Callable) -> None:
    truth = make_truth(four_bar)
    with pytest.raises(DataError, match="the loops cannot close at positions 3"):
        MujocoPlant(four_bar, truth).place([3.0])

    class Far:
        duration = 2.0

        def sample(self, t: np.ndarray) -> Motion:
            q = 1.2 + 1.4 * t[:, None]
            return Motion(t, q, np.full_like(q, 1.4), np.zeros_like(q))

    with pytest.raises(DataError, match=r"the loops cannot close at \d\.\d\d s of the motion"):
        VirtualRobot(four_bar, truth).follow(Far())
