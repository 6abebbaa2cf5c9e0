"""Forward dynamics against Pinocchio, MuJoCo and SciPy."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from closed_chains import five_bar
from invented import ROBOTS, dh_arm, tree
from oracles import body_map, body_positions, pinocchio_model
from steelyard.base.errors import DataError
from steelyard.estimate.closed_loop.feedback_and_forward_dynamics import (
    LEAST_WIDTH,
    Forward,
    Integration,
)
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.robot.robot import Robot
from steelyard.simulate.mujoco_model import Rotor, build, mass_matrices

NAMES = ["single", "tree", "dh arm", "mimic", "ur10e", "panda"]


def drawn(robot: Robot, count: int = 5, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    return tuple(np.random.default_rng(seed).normal(size=(2, robot.n, count)))  # type: ignore[return-value]


def based(model: Model, **others: float) -> tuple[Forward, np.ndarray]:
    """Forward dynamics in base parameters of the nominal bodies."""
    base = base_parameters(model)
    known = {p.name: p.prior for p in RigidBody().parameters(model.robot)} | others
    values = base.base_values([known.get(name, 0.0) for name in model.names])
    return Forward(model, base.independent), values


@pytest.mark.parametrize("name", NAMES)
def test_mass_and_bias_are_those_of_pinocchio(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name](tmp_path)
    dynamics, values = based(Model(robot, (RigidBody(),)))
    q, dq = drawn(robot)
    mass, bias = dynamics.mass_and_bias(q, dq, values, np.ones(robot.n))
    model, s = pinocchio_model(robot), body_map(robot)
    data = model.createData()
    for k in range(q.shape[1]):
        at = body_positions(robot, q[:, k])
        still = np.zeros(model.nv)
        gravity = pin.rnea(model, data, at, still, still).copy()
        unit = np.eye(model.nv)
        wanted = np.column_stack([pin.rnea(model, data, at, still, e) - gravity for e in unit])
        assert np.allclose(mass[k], s.T @ wanted @ s, rtol=1e-9, atol=1e-9)
        torque = s.T @ pin.nonLinearEffects(model, data, at, s @ dq[:, k])
        assert np.allclose(bias[k], torque, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["single", "tree", "dh arm"])
def test_a_short_step_accelerates_as_pinocchio_says(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name](tmp_path)
    dynamics, values = based(Model(robot, (RigidBody(),)))
    q, dq = drawn(robot)
    effort = np.random.default_rng(1).normal(size=q.shape)
    moving = Integration(dynamics, np.repeat(values[:, None], q.shape[1], 1), np.ones(robot.n))
    moving.q[:], moving.dq[:], moving.effort[:] = q, dq, effort
    moving.advance(1e-6)
    model = pinocchio_model(robot)
    for k in range(q.shape[1]):
        wanted = pin.aba(model, model.createData(), q[:, k], dq[:, k], effort[:, k])
        assert np.allclose((moving.dq[:, k] - dq[:, k]) / 1e-6, wanted, rtol=1e-4, atol=1e-4)


def test_rotors_are_felt_as_mujoco_feels_them() -> None:
    robot = tree()
    model = Model(robot, (RigidBody(), RotorInertia()))
    rotors = {f"rotor_inertia.{c.name}": 0.1 * (k + 1) for k, c in enumerate(robot.coordinates)}
    dynamics, values = based(model, **rotors)
    q, dq = drawn(robot)
    mass, _ = dynamics.mass_and_bias(q, 0.0 * dq, values, np.ones(robot.n))
    armature = [
        Rotor(tuple(row), i) for row, i in zip(np.eye(robot.n), rotors.values(), strict=True)
    ]
    wanted = mass_matrices(build(robot, rotors=armature), q.T)
    assert np.allclose(mass, wanted, rtol=1e-6, atol=1e-9)


def test_many_steps_end_where_scipy_ends() -> None:
    robot = dh_arm()
    model = Model(robot, (RigidBody(), Viscous(), Coulomb(smoothing=0.1)))
    laws = {f"{law}.{c.name}": 0.4 for law in ("viscous", "coulomb") for c in robot.coordinates}
    dynamics, values = based(model, **laws)
    effort, widths = np.array([1.0, -20.0, 3.0]), np.full(3, 0.005)

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        q, dq = state[:3, None], state[3:, None]
        mass, bias = dynamics.mass_and_bias(q, dq, values, widths)
        return np.concatenate((state[3:], np.linalg.solve(mass[0], effort - bias[0])))

    wanted = solve_ivp(slope, (0.0, 0.3), np.zeros(6), rtol=1e-11, atol=1e-12).y[:, -1]
    moving = Integration(dynamics, np.repeat(values[:, None], 5, axis=1), widths)
    moving.effort[:] = effort[:, None]
    for _ in range(300):
        moving.advance(1e-3)
    for lane in range(5):
        ends = np.concatenate((moving.q[:, lane], moving.dq[:, lane]))
        assert np.allclose(ends, wanted, rtol=0.0, atol=1e-5)


def test_lanes_have_their_own_parameters() -> None:
    dynamics, values = based(Model(dh_arm(), (RigidBody(), RotorInertia())))
    last = dynamics.model.robot.coordinates[2].name
    rotor = dynamics.model.names.index(f"rotor_inertia.{last}")
    lanes = np.repeat(values[:, None], 3, axis=1)
    lanes[dynamics.columns.index(rotor)] += [0.0, 0.5, 1.0]
    moving = Integration(dynamics, lanes, np.ones(3))
    moving.effort[2] = 1.0
    moving.advance(1e-3)
    assert moving.dq[2, 0] > moving.dq[2, 1] > moving.dq[2, 2]


def test_friction_turns_within_widths_that_steps_follow() -> None:
    model = Model(dh_arm(), (RigidBody(), Coulomb()))
    weak, strong = (
        based(model, **{f"coulomb.{c.name}": f for c in model.robot.coordinates})
        for f in (1e-3, 50.0)
    )
    q = drawn(model.robot)[0]
    assert np.all(weak[0].widths(q, weak[1]) == LEAST_WIDTH["revolute"])
    widths = strong[0].widths(q, strong[1])
    assert np.all(widths > LEAST_WIDTH["revolute"])
    moving = Integration(strong[0], strong[1][:, None], widths)
    moving.q[:], moving.dq[:] = q[:, :1], 0.2
    for _ in range(2000):
        moving.advance(1e-3)
    assert np.abs(moving.dq).max() < 0.05


def test_an_impossible_mass_matrix_is_named() -> None:
    dynamics, values = based(Model(dh_arm(), (RigidBody(),)))
    with pytest.raises(DataError, match="mass matrix is not positive definite"):
        dynamics.widths(np.zeros((3, 4)), -values)
    moving = Integration(dynamics, -values[:, None], np.ones(3))
    moving.advance(1e-3)
    assert moving.least[0] < 0.0


def test_what_cannot_be_simulated_is_refused() -> None:
    with pytest.raises(DataError, match="its friction has internal states"):
        Forward(Model(dh_arm(), (RigidBody(), Dahl(length=1e-3))), (0,))
    with pytest.raises(DataError, match="it has closed loops"):
        Forward(Model(five_bar(), (RigidBody(),)), (0,))
