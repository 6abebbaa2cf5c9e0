import numpy as np
import pytest

from closed_chains import CHAINS, Oracle, five_bar, independent_path, parallelogram, slider_crank
from invented import ball
from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    full_regressor,
    standard_regressor,
)
from steelyard.model.equations import inverse_dynamics as small_systems
from steelyard.model.equations.inverse_dynamics import JointState, completed
from steelyard.model.equations.passive_joints import (
    Follower,
    all_joints,
    newton_code,
    random_positions,
)
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.loop_closures import gaps, loop_equations
from steelyard.robot.robot import Coordinate, Limits, LoopClosure, Robot
from steelyard.symbolic import program_and_softening as numpy_backend
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.symbols_and_tracing import symbolic

REACH = 0.25


def states(robot: Robot, count: int = 12) -> tuple[Array, Array, Array, Array]:
    """Random speeds at places of a smooth path, and its passive positions."""
    path = independent_path(robot, 600, REACH)
    passive, closed = Follower(robot)(path)
    assert closed.all()
    pick = np.linspace(0, 599, count).astype(int)
    dq, ddq = np.random.default_rng(3).normal(size=(2, robot.n, count)) * 2.0
    return path[:, pick], dq, ddq, passive[:, pick]


@pytest.mark.parametrize("name", CHAINS)
def test_torques_velocities_and_accelerations_are_mujocos(name: str) -> None:
    robot = CHAINS[name]()
    q, dq, ddq, passive = states(robot)
    oracle, whole = Oracle(robot), all_joints(robot, q, dq, ddq, passive)
    code = Model(robot, (RigidBody(),)).torque_code
    torque = code([q, dq, ddq, passive, robot.nominal.ravel()])
    for k in range(q.shape[1]):
        wanted, all_dq, all_ddq = oracle.torque(whole[0][:, k], dq[:, k], ddq[:, k])
        assert oracle.gap(whole[0][:, k]) < 1e-9
        assert np.allclose(whole[1][:, k], all_dq, rtol=1e-9, atol=1e-9)
        assert np.allclose(whole[2][:, k], all_ddq, rtol=1e-7, atol=1e-7)
        assert np.allclose(torque[:, k], wanted, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", CHAINS)
def test_velocities_are_the_derivative_of_followed_positions(name: str) -> None:
    robot = CHAINS[name]()
    t, step = np.linspace(0.0, 1.0, 2001), 1.0 / 2000
    start = loop_equations(robot).assembly[: robot.n, None]
    speeds = np.linspace(0.5, 1.0, robot.n)[:, None]
    q, dq = start + 0.2 * np.sin(speeds * t), 0.2 * speeds * np.cos(speeds * t)
    ddq = -0.2 * speeds**2 * np.sin(speeds * t)
    passive, _ = Follower(robot)(q)
    _, all_dq, all_ddq = all_joints(robot, q, dq, ddq, passive)
    rate = np.gradient(passive, step, axis=1)
    change = np.gradient(all_dq[robot.n :], step, axis=1)
    inner = slice(5, -5)
    assert np.allclose(all_dq[robot.n :, inner], rate[:, inner], atol=1e-6)
    assert np.allclose(all_ddq[robot.n :, inner], change[:, inner], atol=1e-5)


@pytest.mark.parametrize("name", CHAINS)
def test_machine_code_and_numpy_agree(name: str) -> None:
    robot = CHAINS[name]()
    model = Model(robot)
    q, dq, ddq, passive = states(robot)
    values = np.random.default_rng(0).normal(size=len(model.names))
    inputs = (*model.inputs, Input("parameters", len(values), shared=True))
    program = symbolic(lambda *x: model.torque_of(JointState(*x[:4]), x[4]), inputs)
    reference = numpy_backend.run(program, [q, dq, ddq, passive, values])
    got = model.torque_code([q, dq, ddq, passive, values])
    assert np.allclose(got, reference, rtol=1e-12, atol=1e-12 * np.abs(reference).max())


@pytest.mark.parametrize("name", CHAINS)
def test_the_regressor_times_parameters_is_the_torque(name: str) -> None:
    robot = CHAINS[name]()
    model = Model(robot, (RigidBody(), Viscous(joints=tuple(c.name for c in robot.joints))))
    path = independent_path(robot, 300, REACH).T
    speed = np.gradient(path, 0.01, axis=0)
    motion = Motion(0.01 * np.arange(300), path, speed, np.gradient(speed, 0.01, axis=0))
    values = Parameters(
        model.names, model.units, np.random.default_rng(1).normal(size=len(model.names))
    )
    dense = standard_regressor(model).dense(motion.q.T, motion.dq.T, motion.ddq.T)
    torque = model.at(values).torque(motion)
    assert np.allclose((dense @ values.values).T, torque, rtol=1e-10, atol=1e-10)


def test_friction_on_a_passive_joint_loads_the_motors() -> None:
    """Virtual power: tau . dq is what friction takes, whichever joint it sits on."""
    robot = five_bar()
    model = Model(robot, (Viscous(joints=tuple(c.name for c in robot.passive)),))
    q, dq, ddq, passive = states(robot)
    torque = model.torque_code([q, dq, ddq, passive, np.array([0.3, 0.7])])
    _, all_dq, _ = all_joints(robot, q, dq, ddq, passive)
    taken = 0.3 * all_dq[2] ** 2 + 0.7 * all_dq[3] ** 2
    assert np.allclose((torque * dq).sum(axis=0), taken, rtol=1e-10)


def test_larger_blocks_are_solved_like_small_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in CHAINS:
        robot = CHAINS[name]()
        q, dq, ddq, passive = states(robot)
        first = all_joints(robot, q, dq, ddq, passive)
        monkeypatch.setattr(small_systems, "COFACTORS", 0)
        second = all_joints(robot, q, dq, ddq, passive)
        monkeypatch.undo()
        for a, b in zip(first, second, strict=True):
            assert np.allclose(a, b, rtol=1e-9, atol=1e-9)


def test_a_slider_crank_by_hand() -> None:
    """In line and without offsets: x = r cos(q) + sqrt(l^2 - r^2 sin^2(q))."""
    robot = slider_crank()
    crank, rod, piston = robot.bodies
    flat = type(piston)(**{**vars(piston), "position": (0.0, 0.0, 0.0), "axis": (0.0, -1.0, 0.0)})
    robot = robot.changed(
        bodies=(crank, rod, flat),
        loops=(LoopClosure("pin", (1, 2), [[0.35, 0.0, 0.0], [0.0, 0.0, 0.0]]),),
        assembly=(0.4, 0.2, 0.4),
    )
    q = np.linspace(0.4, 6.0, 400)
    (_, x), closed = Follower(robot)(q[None])
    assert closed.all()
    assert np.allclose(x, 0.1 * np.cos(q) + np.sqrt(0.35**2 - (0.1 * np.sin(q)) ** 2), atol=1e-12)


@pytest.mark.parametrize("name", CHAINS)
def test_any_split_of_a_motion_gives_the_same(name: str) -> None:
    robot = CHAINS[name]()
    path = independent_path(robot, 500, REACH)
    whole, _ = Follower(robot)(path)
    follower = Follower(robot)
    parts = [follower(path[:, a:b])[0] for a, b in ((0, 1), (1, 130), (130, 131), (131, 500))]
    assert np.array_equal(np.concatenate(parts, axis=1), whole)


def test_a_far_start_is_reached_on_the_way_the_mechanism_is_assembled() -> None:
    robot = five_bar()
    far = np.array([[2.9, 1.9], [0.1, 1.1]])
    passive, closed = Follower(robot)(far)
    assert closed.all() and np.all(passive[0] < 0.0) and np.all(passive[1] > 0.0)
    slow = np.linspace(robot.assembly[:2], far[:, 0], 400).T
    assert np.allclose(Follower(robot)(slow)[0][:, -1], passive[:, 0], atol=1e-12)


def opening() -> tuple[Robot, Array, Array]:
    """A five-bar whose elbows go too far apart and come back; the gap of every sample [m]."""
    tip = LoopClosure("tip", (1, 3), [[0.3, 0.0, 0.0], [0.32, 0.0, 0.0]])
    robot = five_bar().changed(loops=(tip,), assembly=(2.0, 1.1, -1.0, 1.0))
    spread = np.sin(np.linspace(0.0, np.pi, 301)) ** 2
    left, right = path = np.stack([2.0 + 0.9 * spread, 1.1 - 1.1 * spread])
    elbows = 0.3 * np.exp(1j * left) - (0.25 + 0.05j) - 0.28 * np.exp(1j * right)
    return robot, path, np.abs(elbows) - 0.62


def test_samples_that_do_not_close_are_reported_and_the_rest_is_found() -> None:
    robot, path, apart = opening()
    follower = Follower(robot)
    passive, closed = follower(path)
    assert np.array_equal(closed, apart < 0.0)
    assert not closed.all() and closed[:50].all() and closed[-50:].all()
    assert np.allclose(passive[:, -1], passive[:, 0], atol=1e-9)
    name, gap = follower.gap(path[:, 150])
    assert name == "tip" and gap == pytest.approx(apart[150], abs=1e-9)


def test_a_torque_along_an_open_loop_tells_time_and_gap() -> None:
    robot, path, _ = opening()
    t = 0.01 * np.arange(path.shape[1])
    zero = np.zeros_like(path.T)
    with pytest.raises(DataError) as caught:
        Model(robot.changed(open_loops="drop")).prior.torque(Motion(t, path.T, zero, zero))  # type: ignore[union-attr]
    first = int(np.argmin(Follower(robot)(path)[1]))
    assert f"loop 'tip' does not close at t = {t[first]:.4f} s" in caught.value.wrong
    assert "closure error" in caught.value.wrong and 'open_loops = "drop"' in caught.value.fix
    stepper = Model(robot).prior.start()  # type: ignore[union-attr]
    with pytest.raises(DataError, match="does not close at this sample"):
        stepper.step(path[:, 150], zero[0], zero[0])


def test_steps_are_the_torque_of_the_whole() -> None:
    robot = five_bar()
    path = independent_path(robot, 50, REACH).T
    speed = np.gradient(path, 0.01, axis=0)
    valued = Model(robot).prior
    assert valued is not None
    whole = valued.torque(Motion(0.01 * np.arange(50), path, speed, speed))
    stepper = valued.start()
    steps = [stepper.step(*x) for x in zip(path, speed, speed, strict=True)]
    assert np.allclose(steps, whole, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", CHAINS)
def test_random_positions_close_within_the_limits(name: str) -> None:
    robot = CHAINS[name]()
    q, passive = random_positions(robot, 40, np.random.default_rng(0))
    assert q.shape == (robot.n, 40)
    assert max(gaps(robot, x).max() for x in np.concatenate([q, passive]).T) < 1e-9
    start = loop_equations(robot).assembly[: robot.n, None]
    for x, c, s in zip(q, robot.coordinates, start, strict=True):
        assert min(c.limits.lower, s[0]) <= x.min() and x.max() <= max(c.limits.upper, s[0])
    assert np.ptp(q, axis=1).min() > 0.1


@pytest.mark.slow
def test_a_random_walk_of_a_parallelogram_stays_one() -> None:
    """Its ranges hold postures with all bars in one line, beyond which it could be crossed."""
    robot = parallelogram(tuple(ball(k) for k in range(4)), 0.3, 0.4)  # type: ignore[arg-type]
    wide = (Limits(-0.6, 1.4, 3.0, 20.0), Limits(1.4, 3.3, 3.0, 20.0))
    joints = tuple(
        Coordinate(c.name, c.kind, limits)
        for c, limits in zip(robot.coordinates, wide, strict=True)
    )
    robot = robot.changed(coordinates=joints, assembly=(0.3, 2.0, -1.7, 1.7))
    q, passive = random_positions(robot, 60, np.random.default_rng(0))
    np.testing.assert_allclose(passive[0], q[0] - q[1], atol=1e-9)
    assert len(base_parameters(Model(robot, (RigidBody(),)))) == 4


@pytest.mark.slow
@pytest.mark.parametrize("name", CHAINS)
def test_base_parameters_hold_the_whole_torque(name: str) -> None:
    robot = CHAINS[name]()
    model = Model(robot)
    base, other = base_parameters(model), full_regressor(model, seed=5)
    values = np.random.default_rng(2).normal(size=len(model.names))
    assert np.linalg.matrix_rank(other, 1e-9 * np.linalg.norm(other, 2)) == len(base)
    lifted = other[:, list(base.independent)] @ base.base_values(values)
    assert np.allclose(lifted, other @ values, atol=1e-7 * np.abs(other @ values).max())


@pytest.mark.slow
def test_a_parallelogram_has_four_base_parameters_and_three_when_bars_are_straight() -> None:
    bars = tuple(ball(k) for k in range(4))
    model = Model(parallelogram(bars, 0.2, 0.3), (RigidBody(),))  # type: ignore[arg-type]
    base = base_parameters(model)
    assert len(base) == 4
    straight = [k for k, name in enumerate(model.names) if not name.startswith("my.")]
    regressor = full_regressor(model)[:, straight]
    assert np.linalg.matrix_rank(regressor, 1e-9 * np.linalg.norm(regressor, 2)) == 3


def test_a_tree_is_left_alone() -> None:
    tree = five_bar().changed(
        coordinates=five_bar().joints, passive=(), loops=(), assembly=np.zeros(4)
    )
    state = JointState([0.0] * 4, [0.0] * 4, [0.0] * 4)
    assert completed(tree, state) == (state, None)


def test_newton_code_converges_quadratically() -> None:
    robot = five_bar()
    code, assembly = newton_code(robot), loop_equations(robot).assembly
    wrong = assembly[2:, None] + np.array([[0.02], [-0.03]])
    errors = []
    for _ in range(4):
        wrong = code([assembly[:2, None], wrong])[:2]
        errors.append(float(np.abs(wrong[:, 0] - assembly[2:]).max()))
    assert errors[1] < 30.0 * errors[0] ** 2 and errors[2] < 1e-10 and errors[3] < 1e-14
