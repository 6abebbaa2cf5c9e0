"""A body with several joints: the frames between them have no mass and no parameters."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    full_regressor,
)
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.prior.body_priors import body_index, default_knowledge
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.models.mjcf import read_mjcf
from steelyard.robot.robot import Robot, robot_from_dict, robot_to_dict
from steelyard.robot.robot_from_mechanism import reduced
from steelyard.simulate.ground_truth import random_truth

HIP = """
<mujoco model="leg">
  <worldbody><body name="thigh">
    <joint name="hip_x" axis="1 0 0"/><joint name="hip_y" axis="0 1 0"/>
    <joint name="hip_z" axis="0 0 1"/>
    <inertial pos=".1 .02 -.2" mass="3" diaginertia=".05 .05 .01"/>
    <body name="shin" pos="0 0 -.4"><joint name="knee" axis="0 1 0"/>
      <inertial pos="0 .01 -.2" mass="2" diaginertia=".03 .03 .005"/></body>
  </body></worldbody>
</mujoco>
"""


def leg(tmp_path: Path, locked: dict[str, float] | None = None) -> Robot:
    path = tmp_path / "leg.xml"
    path.write_text(HIP)
    return reduced(read_mjcf(path), locked=locked)[0]


def test_base_parameters_are_those_of_the_two_bodies(tmp_path: Path) -> None:
    robot = leg(tmp_path)
    assert [body.name for body in robot.bodies if not body.massless] == ["thigh", "shin"]
    model = Model(robot, (RigidBody(),))
    base = base_parameters(model)
    assert {name.split(".")[1] for name in base.base_names} == {"thigh", "shin"}
    # ten of the thigh but its mass, seven of the shin beyond those grouped with it
    assert len(base) == 16
    assert np.linalg.matrix_rank(full_regressor(model, 5), tol=1e-6) == 16


def test_a_frame_whose_joint_is_locked_moves_with_a_body(tmp_path: Path) -> None:
    robot = leg(tmp_path, {"hip_z": 0.1})
    assert [body.massless for body in robot.bodies] == [True, False, False]
    assert robot.bodies[1].inertia.mass == pytest.approx(3.0)


def test_nobody_gives_them_mass(tmp_path: Path) -> None:
    robot = leg(tmp_path)
    frames = [k for k, body in enumerate(robot.bodies) if body.massless]
    truth = random_truth(robot, 1)
    assert not truth.inertial[frames].any() and truth.inertial[[2, 3]].any(axis=1).all()
    assert default_knowledge(Model(robot)).bodies == ("thigh", "shin")
    with pytest.raises(ModelError) as caught:
        body_index(robot, robot.bodies[0].name, "[prior]")
    assert "is a frame between two joints of one body" in caught.value.wrong


def test_they_carry_no_payload(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="lies between two joints of one body"):
        carrier(leg(tmp_path), "thigh/hip_x")
    assert carrier(leg(tmp_path), "thigh").body == 2


def test_saved_and_read_again(tmp_path: Path) -> None:
    robot = leg(tmp_path)
    again = robot_from_dict(robot_to_dict(robot))
    assert [b.massless for b in again.bodies] == [b.massless for b in robot.bodies]
