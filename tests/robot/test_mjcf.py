from pathlib import Path

import mujoco
import numpy as np
import pytest

from oracles import body_map, body_positions, pinocchio_torque
from steelyard.base.errors import ModelError
from steelyard.robot.models.mjcf import read_mjcf
from steelyard.robot.robot import Robot
from steelyard.robot.robot_from_mechanism import reduced

ARM = """
<mujoco model="two armed">
  <compiler angle="degree"/>
  <option gravity="1 -2 -9"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="post" pos="0 0 1" euler="0 20 0">
      <geom type="box" size=".1 .1 .1" mass="3"/>
      <body name="shoulder" pos=".1 .2 .3" quat=".9 .1 .3 -.2">
        <joint name="pan" axis="0 1 1" pos=".05 0 -.02" ref="30" range="-90 90"/>
        <joint name="tilt" axis="1 0 .2" pos="0 .1 0"/>
        <joint name="reach" type="slide" axis="1 0 0" pos=".3 .2 .1" ref=".1" range="-.2 .4"
               actuatorfrcrange="-50 50"/>
        <inertial pos=".1 0 .05" euler="10 20 30" mass="2" diaginertia=".02 .03 .04"/>
        <body name="pad" pos=".2 0 0" euler="0 0 45">
          <inertial pos="0 0 .1" mass=".5" diaginertia=".001 .001 .001"/>
          <body name="hand" pos="0 .1 .1" euler="90 0 0">
            <joint name="wrist" axis="0 0 1" pos=".02 .03 0"/>
            <geom type="capsule" size=".03 .1" pos=".05 0 0" mass=".7"/>
          </body>
        </body>
      </body>
      <body name="other" pos="-.3 0 0">
        <joint name="follower" axis="0 1 0" ref="10"/>
        <geom type="sphere" size=".1" pos=".2 0 0" mass="1"/>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="follower" joint2="pan" polycoef=".2 -.5 0 0 0"/></equality>
</mujoco>
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    return path


def mujoco_torque(path: Path, robot: Robot, state: np.ndarray) -> np.ndarray:
    """MuJoCo's inverse dynamics, followers brought back to their masters."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    at = [model.joint(b.joint).qposadr[0] for b in robot.bodies]
    s = body_map(robot)
    data.qpos[at] = body_positions(robot, state[0])
    data.qvel[at], data.qacc[at] = s @ state[1], s @ state[2]
    mujoco.mj_inverse(model, data)
    return s.T @ data.qfrc_inverse[at]


def test_torque_is_mujocos(tmp_path: Path) -> None:
    path = written(tmp_path, ARM)
    robot, notes = reduced(read_mjcf(path))
    assert robot.name == "two armed"
    assert robot.joint_names == ("pan", "tilt", "reach", "wrist")
    assert np.array_equal(robot.gravity, [1.0, -2.0, -9.0])
    assert notes == ()  # frames between the joints of one body have no mass by definition
    rng = np.random.default_rng(5)
    for _ in range(5):
        state = rng.uniform(-1.0, 1.0, (3, robot.n))
        expected = mujoco_torque(path, robot, state)
        assert np.allclose(pinocchio_torque(robot, *state), expected, atol=1e-8)


def test_the_follower_is_where_mujocos_equality_puts_it(tmp_path: Path) -> None:
    robot, _ = reduced(read_mjcf(written(tmp_path, ARM)))
    body = next(b for b in robot.bodies if b.joint == "follower")
    pan, ref_pan, ref = 0.7, np.deg2rad(30.0), np.deg2rad(10.0)
    assert body.ratio * pan + body.offset == pytest.approx(ref + 0.2 - 0.5 * (pan - ref_pan))


def test_limits_and_kinds(tmp_path: Path) -> None:
    mechanism = read_mjcf(written(tmp_path, ARM))
    kinds = [mechanism.joint(n).kind for n in ("pan", "tilt", "reach", "pad_fixed")]
    assert kinds == ["revolute", "continuous", "prismatic", "fixed"]
    limits = mechanism.joint("pan").limits
    assert np.allclose([limits.lower, limits.upper], [-np.pi / 2, np.pi / 2])
    assert mechanism.joint("reach").limits.effort == 50.0


def test_locked_joints_are_at_mujocos_positions(tmp_path: Path) -> None:
    path = written(tmp_path, ARM)
    mechanism = read_mjcf(path)
    robot, _ = reduced(mechanism, locked={"tilt": 0.4, "reach": 0.15})
    whole, _ = reduced(mechanism)
    state = np.array([[0.3, -0.5], [1.0, -2.0], [0.4, 3.0]])
    full = np.zeros((3, 4))
    full[:, [0, 3]] = state
    full[0, 1:3] = 0.4, 0.15
    expected = mujoco_torque(path, whole, full)[[0, 3]]
    assert np.allclose(pinocchio_torque(robot, *state), expected, atol=1e-8)


def body(inside: str, after: str = "") -> str:
    geom = '<geom type="sphere" size=".1" mass="1"/>'
    world = f"<worldbody><body name='b'>{inside}{geom}</body></worldbody>"
    return f"<mujoco>\n{world}{after}</mujoco>"


HINGES = '<joint name="h"/><joint name="k" axis="1 0 0"/>'
ERRORS = {
    "urdf": ("<robot/>", "outermost element is <robot>", "line 1"),
    "element": (body("<joynt/>"), "joynt", "robot.xml"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_errors(case: str, tmp_path: Path) -> None:
    text, wrong, where = ERRORS[case]
    path = written(tmp_path, text)
    with pytest.raises(ModelError) as caught:
        read_mjcf(path)
    assert wrong in caught.value.wrong
    assert str(path) in caught.value.where and where in caught.value.where


def test_an_equality_that_is_off_is_passed_over(tmp_path: Path) -> None:
    equality = '<equality><joint joint1="h" joint2="k" active="false"/></equality>'
    robot, _ = reduced(read_mjcf(written(tmp_path, body(HINGES, equality))))
    assert robot.joint_names == ("h", "k")


def test_unnamed_parts_get_names(tmp_path: Path) -> None:
    text = body("<joint/>").replace(" name='b'", "")
    robot, _ = reduced(read_mjcf(written(tmp_path, text)))
    assert (robot.name, robot.joint_names, robot.bodies[0].name) == (
        "robot",
        ("joint_0",),
        "body_1",
    )


def test_a_part_that_other_files_include_is_called_that(tmp_path: Path) -> None:
    path = tmp_path / "part.xml"
    path.write_text("<mujoco><body><joint/><geom size='.1'/></body></mujoco>")
    with pytest.raises(ModelError, match="outside <worldbody>: a part of a model") as caught:
        read_mjcf(path)
    assert "the file that includes it" in caught.value.fix


def test_files_that_attach_each_other_are_refused(tmp_path: Path) -> None:
    for one, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{one}.xml").write_text(
            f'<mujoco><asset><model name="m" file="{other}.xml"/></asset><worldbody>'
            '<body name="base"><geom size=".1"/><frame><attach model="m" body="base" prefix="L"/>'
            "</frame></body></worldbody></mujoco>"
        )
    with pytest.raises(ModelError, match="attaches itself as a model"):
        read_mjcf(tmp_path / "a.xml")
