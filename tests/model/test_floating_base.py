"""Robots with a floating base against Pinocchio's free flyer, MuJoCo's free joint, a fixed base."""

import numpy as np
import pinocchio as pin
import pytest

from closed_chains import CHAINS, independent_path
from invented import dh_arm, floating, mimic, tree, turned
from oracles import body_map, floating_state, pinocchio_model
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    base_regressor,
    symbols,
)
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.robot import Robot, robot_from_dict, robot_to_dict

ROBOTS = {"tree": lambda _: tree(), "dh arm": lambda _: dh_arm(), "mimic": mimic}
CLOSE = {"rtol": 1e-10, "atol": 1e-10}


@pytest.fixture(params=list(ROBOTS))
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return floating(ROBOTS[request.param](tmp_path_factory.mktemp("robot")))


def bodies(robot: Robot) -> ValuedModel:
    model = Model(robot, (RigidBody(),)).prior
    assert model is not None
    return model


def states(robot: Robot, count: int = 5) -> np.ndarray:
    return np.random.default_rng(1).uniform(-2.0, 2.0, (3, count, robot.n))


def test_torque_regressor_and_inertia_are_pinocchios(robot: Robot) -> None:
    model, oracle, s = bodies(robot), pinocchio_model(robot), body_map(robot)
    data, (q, dq, ddq) = oracle.createData(), states(robot)
    found, regressor, mass = (
        model.torque(q, dq, ddq), model.regressor(q, dq, ddq), model.mass_matrix(q)
    )  # fmt: skip
    momentum, back = model.momentum(q, dq), model.forward_dynamics(q, dq, found)
    for k in range(len(q)):
        state = floating_state(robot, turned(k), q[k], dq[k], ddq[k])
        wanted = s.T @ pin.rnea(oracle, data, *state)
        np.testing.assert_allclose(found[k], wanted, **CLOSE)
        np.testing.assert_allclose(regressor[k] @ robot.nominal.ravel(), wanted, **CLOSE)
        columns = pin.computeJointTorqueRegressor(oracle, data, *state)
        np.testing.assert_allclose(regressor[k], s.T @ columns, **CLOSE)
        at, rest = state[0], np.zeros(oracle.nv)
        weight = pin.computeGeneralizedGravity(oracle, data, at)
        units = [pin.rnea(oracle, data, at, rest, unit) - weight for unit in np.eye(oracle.nv)]
        np.testing.assert_allclose(mass[k], s.T @ np.stack(units, axis=1) @ s, **CLOSE)
        np.testing.assert_allclose(momentum[k], mass[k] @ dq[k], **CLOSE)
        np.testing.assert_allclose(back[k], ddq[k], rtol=1e-8, atol=1e-8)


def test_place_heading_and_velocity_of_the_base_do_not_enter(robot: Robot) -> None:
    model, (q, dq, ddq) = bodies(robot), states(robot)
    other, moved = q.copy(), dq.copy()
    other[:, :6] += 1.0
    moved[:, :3] += 1.0
    assert (model.torque(q, dq, ddq) == model.torque(other, moved, ddq)).all()


def test_base_parameters_have_the_rank_of_pinocchios_regressor(robot: Robot) -> None:
    base = base_parameters(Model(robot, (RigidBody(),)))
    oracle, s = pinocchio_model(robot), body_map(robot)
    data, rng = oracle.createData(), np.random.default_rng(2)
    rows = [
        s.T @ pin.computeJointTorqueRegressor(
            oracle, data, *floating_state(robot, turned(k), *rng.normal(size=(3, robot.n)))
        )
        for k in range(100)
    ]  # fmt: skip
    assert len(base) == np.linalg.matrix_rank(np.vstack(rows), tol=1e-8)
    if all(body.kind != "prismatic" for body in robot.bodies):
        total = base.base_values(robot.nominal.ravel())[base.base_names.index("m.pelvis")]
        assert np.isclose(total, sum(body.inertia.mass for body in robot.bodies))
    assert "M0R" in symbols(robot, base)


def test_frames_are_pinocchios_and_their_forces_are_what_contacts_add() -> None:
    robot = floating(tree())
    model, oracle = bodies(robot), pinocchio_model(robot)
    last, data = len(robot.bodies), oracle.createData()
    (q, dq, ddq), wrench = states(robot), np.array([3.0, -20.0, 60.0, 0.5, -1.0, 2.0])
    positions, axes = model.pose(q, "tip")
    jacobians = model.jacobian(q, "tip")
    torques = model.torque(q, dq, ddq)
    for k in range(len(q)):
        state = floating_state(robot, turned(k), q[k], dq[k], ddq[k])
        pin.computeJointJacobians(oracle, data, state[0])
        base, tip = data.oMi[1], data.oMi[last]
        seen = base.inverse() * tip
        np.testing.assert_allclose(positions[k], seen.translation, **CLOSE)
        np.testing.assert_allclose(axes[k], seen.rotation, **CLOSE)
        local = pin.getJointJacobian(oracle, data, last, pin.ReferenceFrame.LOCAL)
        turn = np.kron(np.eye(2), axes[k])
        np.testing.assert_allclose(jacobians[k], turn @ local, **CLOSE)
        forces = [pin.Force.Zero()] * last + [pin.Force(wrench)]
        wanted = pin.rnea(oracle, data, *state, forces)
        pushed = torques[k] - jacobians[k].T @ turn @ wrench
        np.testing.assert_allclose(pushed, wanted, **CLOSE)


@pytest.mark.parametrize("name", CHAINS)
def test_a_base_at_rest_is_a_fixed_base(name: str) -> None:
    fixed = CHAINS[name]()
    robot = floating(fixed)
    q = independent_path(fixed, 50, 0.25).T
    dq, ddq = np.random.default_rng(0).normal(size=(2, *q.shape))
    rest = np.zeros((len(q), 3))
    motion = Motion.floating(
        np.arange(50.0), q, dq, ddq, proper_acceleration=rest - fixed.gravity,
        angular_velocity=rest, angular_acceleration=rest,
    )  # fmt: skip
    wanted = bodies(fixed).torque(q, dq, ddq)
    np.testing.assert_allclose(bodies(robot).torque(motion)[:, 6:], wanted, rtol=1e-9, atol=1e-9)
    frames = [model.jacobian(x, robot.bodies[-1].name) for model, x in
              ((bodies(fixed), q), (bodies(robot), motion.q))]  # fmt: skip
    np.testing.assert_allclose(frames[1][..., 6:], frames[0], rtol=1e-9, atol=1e-9)


def test_laws_act_on_joints_alone() -> None:
    robot = floating(tree())
    model = Model(robot, (RigidBody(), RotorInertia(), Coulomb(), Viscous()))
    assert "coulomb.trunk_joint" in model.names
    assert not [name for name in model.names if "base_" in name]
    found = base_regressor(model)
    assert found.layout.rows[:6] == ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")
    assert not {found.layout.columns[k].split(".")[0] for k in found.layout.sees[0]} - {
        "m", "mx", "my", "mz"
    }  # fmt: skip


def test_what_needs_a_base_at_rest_is_refused() -> None:
    robot = floating(tree())
    model, q = bodies(robot), np.zeros(robot.n)
    for ask in (lambda: model.gravity(q), lambda: model.momentum_rate(q, q)):
        with pytest.raises(ModelError, match="needs a robot whose base is at rest") as caught:
            ask()
        assert 'base = "pelvis"' in caught.value.fix
    with pytest.raises(ValueError, match="floats, but is not the first"):
        robot.changed(bodies=(*robot.bodies, robot.bodies[0]))


def test_a_floating_robot_is_read_again() -> None:
    robot = floating(tree())
    again = robot_from_dict(robot_to_dict(robot))
    assert again.floating and robot_to_dict(again) == robot_to_dict(robot)
