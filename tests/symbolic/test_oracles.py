"""Inverse dynamics and regressor against Pinocchio and MuJoCo, on drawn states."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from invented import ROBOTS
from oracles import pinocchio_regressor, pinocchio_torque
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import standard_regressor
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.robot import Robot
from steelyard.simulate.mujoco_model import build, inverse_dynamics
from steelyard.symbolic import program_and_softening as numpy_backend
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.symbols_and_tracing import symbolic


@pytest.fixture(params=list(ROBOTS))
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return ROBOTS[request.param](tmp_path_factory.mktemp("robot"))


def states(seed: int, robot: Robot, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, robot.n))
    dq, ddq = rng.normal(size=(2, count, robot.n)) * rng.choice([0.0, 1.0, 5.0])
    return q, dq, ddq


@settings(max_examples=12, suppress_health_check=list(HealthCheck), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.sampled_from([1, 3, 4, 5]))
def test_regressor_and_torque_equal_pinocchio(robot: Robot, seed: int, count: int) -> None:
    model = Model(robot, (RigidBody(),))
    q, dq, ddq = states(seed, robot, count)
    phi = np.random.default_rng(seed).normal(size=len(model.names))
    torque = model.at(Parameters(model.names, model.units, phi)).torque(
        Motion(np.arange(count), q, dq, ddq)
    )
    dense = standard_regressor(model).dense(q.T, dq.T, ddq.T)
    for k in range(count):
        wanted = pinocchio_regressor(robot, q[k], dq[k], ddq[k])
        scale = max(1.0, np.abs(wanted).max())
        assert np.abs(dense[:, k] - wanted).max() < 1e-10 * scale
        assert np.abs(torque[k] - wanted @ phi).max() < 1e-10 * scale * np.abs(phi).sum()


@settings(max_examples=8, suppress_health_check=list(HealthCheck), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_nominal_torque_equals_pinocchio_and_mujoco(robot: Robot, seed: int) -> None:
    prior = Model(robot, (RigidBody(),)).prior
    assert prior is not None
    q, dq, ddq = states(seed, robot, 4)
    torque = prior.torque(Motion(np.arange(4), q, dq, ddq))
    wanted = inverse_dynamics(build(robot), q, dq, ddq)
    scale = max(1.0, np.abs(torque).max())
    assert np.abs(torque - wanted).max() < 1e-8 * scale
    for k in range(4):
        oracle = pinocchio_torque(robot, q[k], dq[k], ddq[k])
        assert np.abs(torque[k] - oracle).max() < 1e-10 * scale


def test_backends_agree(robot: Robot) -> None:
    model = Model(robot)
    p = len(model.names)
    inputs = (*model.inputs, Input("parameters", p, True))
    program = symbolic(lambda *x: model.torque_of(JointState(*x[:4]), x[4]), inputs)
    for count in (1, 3, 4, 5, 33):
        arrays = [*(x.T for x in states(count, robot, count)), np.empty((0, count))]
        values = np.random.default_rng(count).normal(size=p)
        reference = numpy_backend.run(program, [*arrays, values])
        fast = model.torque_code([*arrays, values])
        assert np.abs(fast - reference).max() <= 1e-12 * max(1.0, np.abs(reference).max())


def test_memory_order_and_number_of_samples_do_not_matter(robot: Robot) -> None:
    model = Model(robot)
    values = np.random.default_rng(0).normal(size=len(model.names))
    valued = model.at(Parameters(model.names, model.units, values))
    q, dq, ddq = states(1, robot, 40)
    whole = valued.torque(Motion(np.arange(40), q, dq, ddq))
    for count in range(1, 40):
        some = Motion(np.arange(count), q[:count], dq[:count], ddq[:count])
        assert np.array_equal(valued.torque(some), whole[:count])
        f = [np.asfortranarray(x[:count].T) for x in (q, dq, ddq)]
        c = [np.ascontiguousarray(x[:count].T) for x in (q, dq, ddq)]
        assert np.array_equal(valued.block(*f), valued.block(*c))
