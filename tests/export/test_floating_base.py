"""Models of robots with a floating base as files."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import steelyard
from floating_logs import HAND, IMU, dog, record
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.robot.file.robot_file import load_robot


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    folder = tmp_path_factory.mktemp("dog")
    log, _ = record(folder, noise=0.05)
    return steelyard.identify(dog(folder, IMU + HAND), log, check=False).model


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".xml", ".urdf"])
def test_a_file_has_the_floating_base_and_the_bodies(
    suffix: str, model: IdentifiedModel, tmp_path: Path
) -> None:
    path = tmp_path / f"dog{suffix}"
    lost = steelyard.export(model, path)
    again = load_robot(path, base="floating").robot
    assert again.floating and again.joint_names == model.robot.joint_names
    bodies = steelyard.Model(again, (steelyard.terms.RigidBody(),)).prior
    assert bodies is not None
    q, dq, ddq = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5, again.n))
    wanted = model.torque(q, dq, ddq) - model.friction(q, dq, ddq)
    values = model.valued.values.as_dict()
    for j, name in enumerate(again.joint_names[6:], start=6):
        wanted[:, j] -= values[f"offset.{name}"] + values[f"rotor_inertia.{name}"] * ddq[:, j]
    np.testing.assert_allclose(bodies.torque(q, dq, ddq), wanted, rtol=1e-6, atol=1e-6)
    assert any("offset" in sentence for sentence in lost)


@pytest.mark.slow
def test_mujoco_lets_it_fall(model: IdentifiedModel, tmp_path: Path) -> None:
    steelyard.export(model, tmp_path / "dog.xml")
    simulated = mujoco.MjModel.from_xml_path(str(tmp_path / "dog.xml"))
    assert simulated.nv == 10 and simulated.nu == 4
    assert np.isclose(simulated.body_mass.sum(), 7.2, rtol=1e-3)
    data = mujoco.MjData(simulated)
    mujoco.mj_forward(simulated, data)
    np.testing.assert_allclose(data.qacc[:3], [0.0, 0.0, -9.81], atol=1e-6)


@pytest.mark.slow
def test_the_numbers_go_into_the_robots_own_urdf(model: IdentifiedModel, tmp_path: Path) -> None:
    plain = tmp_path / "plain.urdf"
    steelyard.export(model, plain)
    steelyard.export(model, tmp_path / "own.urdf", plain)
    robots = [load_robot(path, base="floating").robot for path in (plain, tmp_path / "own.urdf")]
    np.testing.assert_allclose(robots[1].nominal, robots[0].nominal, atol=1e-12)
