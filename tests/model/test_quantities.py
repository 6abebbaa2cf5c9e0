"""Quantities of trees against Pinocchio and MuJoCo, and of closed chains against MuJoCo."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from closed_chains import CHAINS, Oracle, independent_path
from invented import ROBOTS, tree, turned
from law_cases import CASES
from oracles import body_map, body_positions, pinocchio_model
from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import DataError, ModelError
from steelyard.base.motion import Motion
from steelyard.model.equations.passive_joints import passive_positions
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import Offset, RigidBody, RotorInertia
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.geometry_and_effort_errors import EffortReadingErrors
from steelyard.model.torque_and_quantities import QUANTITIES, Quantity
from steelyard.robot.robot import Frame, LoopClosure, Robot
from steelyard.symbolic import program_and_softening as numpy_backend

PLACE = np.array([0.2, -0.1, 0.3])


def valued(robot: Robot) -> ValuedModel:
    """The nominal bodies, with rotors, friction and offsets."""
    model = Model(robot, (RigidBody(), RotorInertia(), Coulomb(), Viscous(), Offset()))
    rest = np.random.default_rng(4).uniform(0.1, 0.4, len(model.names) - 10 * len(robot.bodies))
    values = np.concatenate([robot.nominal.ravel(), rest])
    return model.at(Parameters(model.names, model.units, values))


def rotors(robot: Robot, model: ValuedModel) -> Array:
    values = model.values.as_dict()
    return np.diag([values[f"rotor_inertia.{name}"] for name in robot.joint_names])


@pytest.fixture(params=list(ROBOTS))
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return ROBOTS[request.param](tmp_path_factory.mktemp("robot"))


@pytest.mark.slow
def test_trees_are_pinocchios(robot: Robot) -> None:
    model, oracle, s = valued(robot), pinocchio_model(robot), body_map(robot)
    data, rotor = oracle.createData(), rotors(robot, model)
    q, dq, tau = np.random.default_rng(1).uniform(-2.0, 2.0, (3, 9, robot.n))
    mass, momentum = model.mass_matrix(q), model.momentum(q, dq)
    bias, gravity, rate = model.bias(q, dq), model.gravity(q), model.momentum_rate(q, dq)
    found, friction = model.forward_dynamics(q, dq, tau), model.friction(q, dq, np.zeros_like(q))
    values = model.values.as_dict()
    offsets = np.array([values[f"offset.{name}"] for name in robot.joint_names])
    close = {"rtol": 1e-9, "atol": 1e-9}
    for k in range(len(q)):
        at, speed = body_positions(robot, q[k]), s @ dq[k]
        rest = np.zeros(oracle.nv)
        weight = pin.computeGeneralizedGravity(oracle, data, at)
        columns = [pin.rnea(oracle, data, at, rest, unit) - weight for unit in np.eye(oracle.nv)]
        bodies = np.stack(columns, axis=1)
        wanted = s.T @ bodies @ s + rotor
        np.testing.assert_allclose(mass[k], wanted, **close)
        np.testing.assert_allclose(momentum[k], wanted @ dq[k], **close)
        effects = s.T @ pin.nonLinearEffects(oracle, data, at, speed)
        np.testing.assert_allclose(bias[k], effects, **close)
        np.testing.assert_allclose(gravity[k], s.T @ weight, **close)
        if robot.name != "tree":  # Pinocchio's matrix is wrong where branches are not in one piece
            coriolis = pin.computeCoriolisMatrix(oracle, data, at, speed)
            np.testing.assert_allclose(rate[k], s.T @ (coriolis.T @ speed - weight), **close)
        sides = tau[k] - effects - friction[k] - offsets
        np.testing.assert_allclose(found[k], np.linalg.solve(wanted, sides), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("frame", ["tip", Frame("tool", 3, turned(3), PLACE)])
def test_frames_of_trees_are_pinocchios(frame: str | Frame) -> None:
    robot = tree()
    place = (
        pin.SE3.Identity()
        if isinstance(frame, str)
        else pin.SE3(np.array(frame.rotation), np.array(frame.position))
    )
    oracle = pinocchio_model(robot)
    number = oracle.addFrame(pin.Frame("f", 4, place, pin.FrameType.OP_FRAME))
    data, model = oracle.createData(), valued(robot)
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (5, robot.n))
    positions, axes = model.pose(q, frame)
    jacobians = model.jacobian(q, frame)
    for k, row in enumerate(q):
        pin.computeJointJacobians(oracle, data, row)
        pin.updateFramePlacements(oracle, data)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        np.testing.assert_allclose(positions[k], data.oMf[number].translation, atol=1e-12)
        np.testing.assert_allclose(axes[k], data.oMf[number].rotation, atol=1e-12)
        wanted = pin.getFrameJacobian(oracle, data, number, aligned)
        np.testing.assert_allclose(jacobians[k], wanted, atol=1e-12)


def followed(robot: Robot, count: int = 8) -> tuple[Array, Array, Array]:
    """Independent positions and velocities along a path, and positions of all joints, by rows."""
    if not robot.loops:
        q, dq = np.random.default_rng(3).normal(size=(2, count, robot.n))
        return q, dq, q
    q = independent_path(robot, 600, 0.25)[:, :: 600 // count]
    dq = np.random.default_rng(3).normal(size=q.shape)
    return q.T, dq.T, np.vstack([q, passive_positions(robot, q)]).T


@pytest.mark.parametrize("name", CHAINS)
def test_closed_chains_are_mujocos(name: str) -> None:
    robot = CHAINS[name]()
    model, oracle, n = valued(robot), Oracle(robot), robot.n
    q, dq, whole = followed(robot)
    mass, rotor = model.mass_matrix(q), rotors(robot, model)
    momentum, bias, gravity = model.momentum(q, dq), model.bias(q, dq), model.gravity(q)
    still, full = np.zeros(n), np.zeros((oracle.model.nv, oracle.model.nv))
    last = len(robot.bodies) - 1
    frame = Frame("tool", last, turned(3), PLACE)
    positions, axes = model.pose(q, frame)
    jacobians = model.jacobian(q, frame)
    for k in range(len(q)):
        basis = oracle.map @ oracle.basis(whole[k])
        for row, unit in zip(full, np.eye(len(full)), strict=True):
            mujoco.mj_mulM(oracle.model, oracle.data, row, unit)
        wanted = basis.T @ full @ basis + rotor
        np.testing.assert_allclose(mass[k], wanted, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(momentum[k], wanted @ dq[k], rtol=1e-9, atol=1e-9)
        body = oracle.model.body(f"{last} {robot.bodies[last].name}").id
        turn = oracle.data.xmat[body].reshape(3, 3)
        point = oracle.data.xpos[body] + turn @ PLACE
        np.testing.assert_allclose(positions[k], point, atol=1e-9)
        np.testing.assert_allclose(axes[k], turn @ frame.rotation, atol=1e-9)
        parts = np.zeros((2, 3, oracle.model.nv))
        mujoco.mj_jac(oracle.model, oracle.data, *parts, point, body)
        np.testing.assert_allclose(jacobians[k], parts.reshape(6, -1) @ basis, atol=1e-9)
        np.testing.assert_allclose(bias[k], oracle.torque(whole[k], dq[k], still)[0], atol=1e-7)
        np.testing.assert_allclose(gravity[k], oracle.torque(whole[k], still, still)[0], atol=1e-8)


@pytest.mark.parametrize("name", CHAINS)
def test_jacobians_behind_passive_joints_are_derivatives_of_poses(name: str) -> None:
    robot = CHAINS[name]()
    model, step = valued(robot), 1e-6
    q, _, _ = followed(robot)
    for body in range(len(robot.bodies)):
        frame = Frame("tool", body, turned(body), PLACE)
        jacobian, (_, axes) = model.jacobian(q, frame), model.pose(q, frame)
        for j, way in enumerate(step * np.eye(robot.n)):
            ahead, behind = model.pose(q + way, frame), model.pose(q - way, frame)
            speed = (ahead[0] - behind[0]) / (2.0 * step)
            np.testing.assert_allclose(jacobian[:, :3, j], speed, atol=1e-7)
            spin = (ahead[1] - behind[1]) / (2.0 * step) @ axes.swapaxes(1, 2)
            turning = spin[:, [2, 0, 1], [1, 2, 0]]
            np.testing.assert_allclose(jacobian[:, 3:, j], turning, atol=1e-7)


@pytest.mark.parametrize("name", [*CHAINS, "tree"])
def test_the_rate_of_the_momentum_is_that_of_the_motion(name: str) -> None:
    r"""$\dot M \dot q = C \dot q + C^T \dot q$, as $\dot M - 2 C$ is skew."""
    robot = CHAINS[name]() if name in CHAINS else tree()
    model, step = valued(robot), 1e-6
    q, dq, _ = followed(robot)
    ahead, behind = model.mass_matrix(q + step * dq), model.mass_matrix(q - step * dq)
    change = np.einsum("kij,kj->ki", (ahead - behind) / (2.0 * step), dq)
    found = model.bias(q, dq) + model.momentum_rate(q, dq)
    np.testing.assert_allclose(found, change, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", [*CHAINS, "tree"])
def test_parts_make_the_torque(name: str) -> None:
    robot = CHAINS[name]() if name in CHAINS else tree()
    model = valued(robot)
    q, dq, _ = followed(robot)
    ddq = np.random.default_rng(5).normal(size=q.shape)
    motion = Motion(np.arange(len(q)), q, dq, ddq)
    torque = model.torque(motion)
    inertial = np.einsum("kij,kj->ki", model.mass_matrix(q), ddq) + model.bias(q, dq)
    values = model.values.as_dict()
    offsets = [values[f"offset.{joint}"] for joint in robot.joint_names]
    parts = inertial + model.friction(motion) + offsets
    np.testing.assert_allclose(torque, parts, rtol=1e-10, atol=1e-10)
    by_columns = model.regressor(motion) @ model.values.values
    np.testing.assert_allclose(torque, by_columns, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(model.forward_dynamics(q, dq, torque), ddq, rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(model.torque(q, dq, ddq), torque)


@pytest.mark.parametrize("quantity", QUANTITIES, ids=lambda q: q.name)
@pytest.mark.parametrize("name", ["five-bar", "tree"])
def test_one_sample_and_steps_are_the_rows_of_a_motion(name: str, quantity: Quantity) -> None:
    robot = CHAINS[name]() if name in CHAINS else tree()
    model = valued(robot)
    q, dq, _ = followed(robot)
    given = [q, dq, 0.5 * q][: len(quantity.arguments)]
    whole, stepper = model.evaluate(quantity, *given), model.start()
    for k in range(len(q)):
        sample = [x[k] for x in given]
        step = stepper.evaluate(quantity, *sample)
        assert step.shape == whole.shape[1:]
        np.testing.assert_allclose(step, whole[k], rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(model.evaluate(quantity, *sample), whole[k], rtol=1e-9)


@pytest.mark.parametrize("quantity", QUANTITIES, ids=lambda q: q.name)
def test_machine_code_and_numpy_agree(quantity: Quantity) -> None:
    model = valued(tree())
    found, q = model.model.compiled(quantity), np.random.default_rng(6).normal(size=(3, 4, 5))
    given = list(q[: len(quantity.arguments)])
    values = model.values.values[found.columns]
    entries = numpy_backend.run(quantity.program(found.part), [*given, np.empty((0, 5)), values])
    wanted = entries.T.reshape(5, *quantity.shape(found.part))
    got = model.evaluate(quantity, *(x.T for x in given))
    np.testing.assert_allclose(got, wanted, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("law", ["dahl", "maxwell_slip", "lugre", "load_dependent"])
def test_friction_with_memory_remembers_along_a_motion_and_from_step_to_step(law: str) -> None:
    robot = tree()
    term = next(case for case in CASES if case.law == law).on(robot)
    model = Model(robot, (RigidBody(), Viscous(), term))
    numbers = np.concatenate([robot.nominal.ravel(), np.full(len(model.names) - 40, 0.3)])
    slipping = model.at(Parameters(model.names, model.units, numbers))
    t = np.linspace(0.0, 1.0, 60)[:, None]
    rates = np.array([2.0, 3.0, 4.0, 5.0])
    q, dq, ddq = np.sin(rates * t), rates * np.cos(rates * t), -rates * rates * np.sin(rates * t)
    torque, friction = slipping.torque(q, dq, ddq), slipping.friction(q, dq, ddq)
    rigid = np.einsum("kij,kj->ki", slipping.mass_matrix(q), ddq) + slipping.bias(q, dq)
    np.testing.assert_allclose(torque, rigid + friction, atol=1e-9)
    stepper = slipping.start()
    for k in range(len(q)):
        np.testing.assert_allclose(stepper.step(q[k], dq[k], ddq[k]), torque[k], atol=1e-9)
        np.testing.assert_allclose(stepper.friction(q[k], dq[k], ddq[k]), friction[k], atol=1e-9)
    if law == "load_dependent":
        with pytest.raises(ModelError, match="depends on the acceleration"):
            slipping.forward_dynamics(q, dq, torque)
    else:
        np.testing.assert_allclose(slipping.forward_dynamics(q, dq, torque), ddq, atol=1e-7)


def test_friction_with_memory_in_a_closed_chain_goes_from_step_to_step() -> None:
    robot = CHAINS["palletizer"]()
    model = Model(robot, (RigidBody(), Viscous(), Dahl(length=0.02)))
    numbers = np.concatenate([robot.nominal.ravel(), np.full(2 * robot.n, 0.3)])
    slipping = model.at(Parameters(model.names, model.units, numbers))
    q = independent_path(robot, 200, 0.25).T
    dq = np.gradient(q, axis=0)
    torque, stepper = slipping.torque(q, dq, 0.0 * q), slipping.start()
    for k in range(len(q)):
        np.testing.assert_allclose(stepper.step(q[k], dq[k], 0.0 * q[k]), torque[k], atol=1e-9)
    again = stepper.start()
    np.testing.assert_allclose(again.step(q[0], dq[0], 0.0 * q[0]), torque[0], atol=1e-9)


def test_terms_without_one_step_equations_are_stepped_by_their_scan() -> None:
    robot = tree()
    names = Model(robot, (RigidBody(),)).names
    reference = tuple(zip(names, robot.nominal.ravel().tolist(), strict=True))
    model = Model(robot, (EffortReadingErrors(reference), Dahl()))
    misread = model.at(Parameters(model.names, model.units, np.full(len(model.names), 0.1)))
    q, dq, ddq = np.random.default_rng(7).normal(size=(3, 9, 4))
    torque, stepper = misread.torque(q, dq, ddq), misread.start()
    for k in range(len(q)):
        np.testing.assert_allclose(stepper.step(q[k], dq[k], ddq[k]), torque[k], atol=1e-9)
    with pytest.raises(ModelError, match="'misread' depends on the acceleration"):
        misread.forward_dynamics(q, dq, torque)


def test_a_mass_matrix_that_no_mechanism_has_is_named_with_its_posture() -> None:
    model = Model(tree(), (RigidBody(),))
    lacking = model.at(Parameters(["m.tip", "Izz.trunk"], ["kg", "kg m²"], [2.0, -3.0]))
    q, still = np.array([[0.1, 0.25, -0.3, 0.4]]), np.zeros((1, 4))
    words = r"not positive definite at q = \[0.1, 0.25, -0.3, 0.4\]"
    with pytest.raises(DataError, match=words) as caught:
        lacking.forward_dynamics(q, still, still)
    assert "consistent" in caught.value.fix
    with pytest.raises(DataError, match=words):
        lacking.start().forward_dynamics(q[0], still[0], still[0])


def test_frames_are_named() -> None:
    for model in (valued(tree()), valued(tree()).start()):
        with pytest.raises(ModelError, match="no frame 'tipp'") as caught:
            model.pose(np.zeros(4), "tipp")
        assert "'tip'" in caught.value.fix


def test_a_singular_chain_is_not_called_open() -> None:
    bodies = tuple(
        replace(body, position=(x, 0.0, 0.0))
        for body, x in zip(CHAINS["five-bar"]().bodies, (-0.1, 0.3, 0.1, 0.3), strict=True)
    )
    tip = LoopClosure("tip", (1, 3), [[0.4, 0.0, 0.0], [0.4, 0.0, 0.0]])
    assembly = (2.4, 0.7, -1.79362145, 1.80640383)
    robot = CHAINS["five-bar"]().changed(bodies=bodies, loops=(tip,), assembly=assembly)
    with pytest.raises(DataError, match="loop 'tip' closes at this sample, but") as caught:
        valued(robot).gravity([np.pi, 0.0])
    assert "singular" in caught.value.fix


def test_loops_that_cannot_close_are_named() -> None:
    model = valued(CHAINS["five-bar"]())
    q = np.array([[2.4, 0.6], [1.2437, 2.1515]])
    for call in (model.gravity, lambda q: model.jacobian(q, "left_fore")):
        with pytest.raises(DataError, match="loop 'tip' does not close"):
            call(q)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((np.zeros(4),), "ndarray alone is no motion"),
        ((np.zeros(4), np.zeros(4)), "in part"),
        ((Motion([0.0], *np.zeros((3, 1, 4))), np.zeros(4)), "in part"),
        ((np.zeros(4), np.zeros(4), np.zeros(3)), r"'ddq' has shape \(3,\)"),
        ((np.zeros((2, 3)),) * 3, r"'q' has shape \(2, 3\)"),
    ],
)
def test_motions_in_part_are_refused(arguments: tuple[object, ...], words: str) -> None:
    with pytest.raises(DataError, match=words):
        valued(tree()).torque(*arguments)  # type: ignore[arg-type]


def test_no_samples_are_no_rows() -> None:
    model, none = valued(tree()), np.empty((0, 4))
    assert model.mass_matrix(none).shape == (0, 4, 4)
    assert model.forward_dynamics(none, none, none).shape == (0, 4)
