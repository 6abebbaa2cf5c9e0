import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oracles import pinocchio_torque
from steelyard.base.errors import ModelError
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.models.xml_and_urdf import read_urdf
from steelyard.robot.robot import Body, Coordinate, Robot
from steelyard.robot.robot_from_mechanism import reduced
from steelyard.simulate.mujoco_model import Rotor, build, inverse_dynamics, mass_matrices

MODELS = (
    "panda_description/urdf/panda.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "kinova_description/robots/kinova.urdf",
    "xarm_description/urdf/xarm7.urdf",
)


def states(n: int, seed: int, count: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return tuple(scale * rng.standard_normal((count, n)) for scale in (2.0, 1.5, 4.0))


def expect_pinocchio(robot: Robot, seed: int) -> None:
    q, dq, ddq = states(robot.n, seed)
    got = inverse_dynamics(build(robot), q, dq, ddq)
    want = [pinocchio_torque(robot, *state) for state in zip(q, dq, ddq, strict=True)]
    np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-8)
    assert np.abs(want).max() > 1e-2


@given(seed=st.integers(0, 2**32 - 1))
@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_tree_with_mimic_equals_pinocchio(tree: Robot, seed: int) -> None:
    expect_pinocchio(tree, seed)


def test_demo_arm_equals_pinocchio(arm: Robot) -> None:
    expect_pinocchio(arm, 0)


@pytest.mark.parametrize("name", MODELS)
def test_published_robots_equal_pinocchio(name: str) -> None:
    data = os.environ.get("STEELYARD_DATA")
    if data is None:
        pytest.skip("STEELYARD_DATA names no folder with robot models")
    path = Path(data).parent / "models" / name
    if not path.exists():
        pytest.skip(f"{path} is not there")
    expect_pinocchio(reduced(read_urdf(path))[0], 1)


def test_rotor_inertia_adds_its_torque(tree: Robot) -> None:
    q, dq, ddq = states(tree.n, 3)
    inertias = np.array([0.2, 3.0, 0.05, 0.4])
    rotors = [Rotor(tuple(row), x) for row, x in zip(np.eye(4), inertias, strict=True)]
    bare = inverse_dynamics(build(tree), q, dq, ddq)
    geared = inverse_dynamics(build(tree, rotors=rotors), q, dq, ddq)
    np.testing.assert_allclose(geared - bare, inertias * ddq, atol=1e-9)


def test_a_rotor_couples_the_joints_it_turns_with(arm: Robot) -> None:
    q, dq, ddq = states(arm.n, 3)
    rows = np.array([[0, 0, 0, 0, 50.0, 50.0], [0, 2.0, -1.5, 0, 0, 0.5], [3.0, 0, 0, 0, 0, 0]])
    inertias = [4e-4, 0.3, 0.1]
    rotors = [Rotor(tuple(row), x) for row, x in zip(rows, inertias, strict=True)]
    bare = inverse_dynamics(build(arm), q, dq, ddq)
    geared = inverse_dynamics(build(arm, rotors=rotors), q, dq, ddq)
    wanted = ddq @ sum(x * np.outer(row, row) for row, x in zip(rows, inertias, strict=True))
    np.testing.assert_allclose(geared - bare, wanted, atol=1e-9)


def test_a_rotor_between_branches_is_refused(tree: Robot) -> None:
    with pytest.raises(ModelError, match="'left_joint' and 'right_joint' of different branches"):
        build(tree, rotors=[Rotor((0.0, 0.0, 1.0, 1.0), 0.1)])


def test_given_inertias_replace_the_nominal_ones(arm: Robot) -> None:
    q, dq, ddq = states(arm.n, 4)
    doubled = inverse_dynamics(build(arm, 2.0 * arm.nominal), q, dq, ddq)
    np.testing.assert_allclose(doubled, 2.0 * inverse_dynamics(build(arm), q, dq, ddq), atol=1e-9)


def test_mass_matrix_is_symmetric_and_gives_inertial_torque(tree: Robot) -> None:
    q, _, ddq = states(tree.n, 6)
    still = np.zeros_like(q)
    model = build(tree)
    masses = mass_matrices(model, q)
    inertial = inverse_dynamics(model, q, still, ddq) - inverse_dynamics(model, q, still, still)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", masses, ddq), inertial, atol=1e-9)
    np.testing.assert_allclose(masses, masses.transpose(0, 2, 1), atol=1e-10)


def test_massless_and_point_bodies_are_taken() -> None:
    point = Inertia.about_com(2.0, [0.3, 0.0, 0.0], np.zeros((3, 3)))
    chain = [
        Body(f"b{k}", f"j{k}", "revolute", k - 1, np.eye(3), np.zeros(3), axis, k, inertia=inertia)
        for k, (axis, inertia) in enumerate(
            [([0.0, 0, 1], Inertia.zero()), ([0.0, 1, 0], point), ([1.0, 0, 0], Inertia.zero())]
        )
    ]
    robot = Robot("odd", tuple(chain), tuple(Coordinate(f"j{k}", "revolute") for k in range(3)))
    expect_pinocchio(robot, 8)


@pytest.mark.parametrize(
    "moments, words",
    [((1.0, 1.0, 3.0), "triangle inequality"), ((-1.0, 1.0, 1.0), "moment of inertia is negative")],
)
def test_impossible_bodies_are_named(
    arm: Robot, moments: tuple[float, float, float], words: str
) -> None:
    tens = arm.nominal.copy()
    tens[2] = Inertia.about_com(1.0, np.zeros(3), np.diag(moments)).ten
    with pytest.raises(ModelError, match=words) as caught:
        build(arm, tens)
    assert "link 'forearm' is not physically consistent" in caught.value.wrong


def test_a_coordinate_without_body_is_refused(pendulum: Robot) -> None:
    extra = (*pendulum.coordinates, Coordinate("ghost", "revolute"))
    with pytest.raises(ModelError, match="joint 'ghost' moves no body"):
        build(Robot("r", pendulum.bodies, extra))
