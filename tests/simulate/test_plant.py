from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from oracles import pinocchio_torque
from steelyard.base.errors import ModelError
from steelyard.model.laws.friction_over_speed import Stribeck
from steelyard.model.laws.laws_without_friction import Offset, RigidBody, RotorInertia
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.mujoco_model import mass_matrices
from steelyard.simulate.virtual_robot import MujocoPlant


def test_pendulum_swings_as_its_equation_says(pendulum: Robot, pendulum_truth: Truth) -> None:
    values = {"rotor_inertia": 0.05, "coulomb": 0.2, "viscous": 0.1, "offset": 0.03}
    truth = pendulum_truth.changed(**{f"{law}.pivot": x for law, x in values.items()})
    plant = MujocoPlant(pendulum, truth)
    plant.place([0.8])
    inertia = 1e-3 + 0.25 + 0.05

    def rate(_: float, x: np.ndarray) -> list[float]:
        friction = 0.2 * np.tanh(x[1] / 0.01) + 0.1 * x[1] + 0.03
        return [x[1], (0.4 - friction - 9.81 * 0.5 * np.sin(x[0])) / inertia]

    exact = solve_ivp(rate, (0.0, 1.0), [0.8, 0.0], rtol=1e-9, atol=1e-11).y[:, -1]
    for _ in range(1000):
        q, dq = plant.step(np.array([0.4]), 1e-3)
    np.testing.assert_allclose([q[0], dq[0]], exact, atol=3e-4)


def test_first_acceleration_of_a_tree_is_pinocchios(tree: Robot) -> None:
    truth = random_truth(tree, 1, terms=(RigidBody(), RotorInertia(), Offset()))
    plant, rng = MujocoPlant(tree, truth), np.random.default_rng(2)
    q0, tau = 0.5 * rng.standard_normal(4), rng.standard_normal(4)
    plant.place(q0)
    _, dq = plant.step(tau, plant.timestep)
    ddq = dq / plant.timestep
    bodies = tuple(
        replace(b, inertia=Inertia.from_ten(t))
        for b, t in zip(tree.bodies, truth.inertial, strict=True)
    )
    real = Robot("real", bodies, tree.coordinates, tree.gravity)
    rotor, offset = (
        np.array([truth.values[f"{law}.{joint}"] for joint in tree.joint_names])
        for law in ("rotor_inertia", "offset")
    )
    want = pinocchio_torque(real, q0, np.zeros(4), ddq) + rotor * ddq + offset
    np.testing.assert_allclose(tau, want, atol=2e-4 * np.abs(want).max())


def test_mimic_bodies_follow(tree: Robot) -> None:
    plant = MujocoPlant(tree, random_truth(tree, 0))
    plant.place(np.zeros(4))
    for k in range(300):
        plant.step(5.0 * np.sin([0.1 * k, 0.2 * k, 0.1 * k, 0.3 * k]), 1e-3)
    positions = plant._data.qpos
    follower = 0.7 * (positions[3] + 0.1) / -2.0 + 0.2
    assert abs(plant.state()[0][3]) > 0.01
    assert positions[4] == pytest.approx(follower, abs=1e-5)


def test_stiff_friction_gets_a_finer_step(
    pendulum: Robot, make_truth: Callable[..., Truth]
) -> None:
    truth = make_truth(pendulum, Stribeck(speed=1.0))
    plant = MujocoPlant(pendulum, truth.changed(**{"stribeck.pivot": 25.0}))
    assert plant.timestep == pytest.approx(6.25e-5)
    plant.place([0.1])
    for _ in range(500):
        _, dq = plant.step(np.zeros(1), 1e-3)
    assert abs(dq[0]) < 1e-3
    with pytest.raises(ModelError, match="too stiff"):
        MujocoPlant(pendulum, truth.changed(**{"stribeck.pivot": 2500.0}))


def test_step_must_be_a_multiple(pendulum: Robot, pendulum_truth: Truth) -> None:
    plant = MujocoPlant(pendulum, pendulum_truth)
    with pytest.raises(ValueError, match="not a multiple"):
        plant.step(np.zeros(1), 4e-4)


def test_truth_of_another_robot_is_refused(arm: Robot, pendulum_truth: Truth) -> None:
    with pytest.raises(ModelError, match="1 links and 1 joints, the robot 6 and 6"):
        MujocoPlant(arm, pendulum_truth)


def test_joint_without_inertia_is_refused(pendulum: Robot, pendulum_truth: Truth) -> None:
    bodies = [name for name in pendulum_truth.values.names if name.endswith(".bob")]
    with pytest.raises(ModelError, match="'pivot' moves almost no inertia"):
        MujocoPlant(pendulum, pendulum_truth.changed(**dict.fromkeys(bodies, 0.0)))


def test_placing_does_not_disturb_the_model(arm: Robot) -> None:
    plant = MujocoPlant(arm, random_truth(arm, 0))
    q = np.linspace(-0.5, 0.5, 6)
    before = mass_matrices(plant.model, q[None])
    plant.place(q)
    plant.step(np.zeros(6), 1e-3)
    np.testing.assert_array_equal(mass_matrices(plant.model, q[None]), before)
