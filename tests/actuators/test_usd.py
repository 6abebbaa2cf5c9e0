"""Actuators as USD: opened by OpenUSD with Newton's schemas, every value and every pose equal."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from proofs.support.servo_arm import URDF
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import steelyard
from steelyard.actuators.actuator_model import ActuatorModel
from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.cli.app import app
from steelyard.export.model_files.actuators_usd import actuators_usd
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import bodies_along

pytest.importorskip("newton_usd_schemas", reason="needs newton-usd-schemas and usd-core")
from pxr import Gf, Usd, UsdGeom, UsdPhysics  # noqa: E402

FINGER = """<link name="1 'odd' link"><inertial><origin xyz="0.01 0.02 0.03"/><mass value="0.01"/>
<inertia ixx="1e-6" iyy="2e-6" izz="2.5e-6" ixy="1e-7" ixz="0" iyz="2e-7"/></inertial></link>
<joint name="follower" type="revolute"><parent link="lower"/><child link="1 'odd' link"/>
<origin xyz="0.1 0 0.02" rpy="0.3 -0.4 1.2"/><axis xyz="-1 0 0"/>
<mimic joint="elbow" multiplier="-0.5" offset="0.2"/></joint></robot>"""


@pytest.fixture
def model(small_arm: Path, tmp_path: Path) -> ActuatorModel:
    """With a finger that follows the elbow, a delay, a torque limit, and motion beyond limits."""
    known = steelyard.load_actuators(small_arm / "servo-model")
    (tmp_path / "arm.urdf").write_text(URDF.replace("</robot>", FINGER))
    values = known.values.changed(
        back_emf=(0.2, 0.1), stribeck=0.02, torque_limit=(1e9, 3.0), delay=(0.0, 0.012)
    )
    robot, reach = load_robot(tmp_path / "arm.urdf").robot, np.array([[-1.9, 0.0], [-1.0, 1.95]])
    return replace(known, robot=robot, values=values, reach=reach)


def opened(model: ActuatorModel, folder: Path) -> Any:
    path = folder / "arm.usda"
    path.write_text(actuators_usd(model).text)
    return Usd.Stage.Open(str(path))


def test_every_value_is_read_again_by_its_schema(model: ActuatorModel, tmp_path: Path) -> None:
    stage = opened(model, tmp_path)
    root = stage.GetDefaultPrim()
    assert root.HasAPI(UsdPhysics.ArticulationRootAPI) and UsdGeom.GetStageUpAxis(stage) == "Z"
    for prim in stage.Traverse():
        known = set(prim.GetPrimDefinition().GetPropertyNames()) | {"xformOp:orient"}
        given = {p.GetName() for p in prim.GetAuthoredProperties()}
        assert given <= known | {"xformOp:translate"}, (prim.GetPath(), given - known)
    v = model.values
    for j, joint in enumerate(model.joints):
        motor = root.GetChild(f"actuator_{joint}")
        (driven,) = motor.GetRelationship("newton:targets").GetTargets()
        assert driven == root.GetPath().AppendChild(joint)
        own = stage.GetPrimAtPath(driven)
        for prim, name, value in (
            (motor, "newton:kp", v["stiffness"][j]),
            (motor, "newton:kd", v["damping"][j]),
            (own, "newton:armature", v["armature"][j]),
            (own, "newton:friction", v["coulomb"][j] + v["stribeck"][j]),
            (own, "newton:damping", np.deg2rad(v["back_emf"][j])),
            (own, "physics:lowerLimit", np.rad2deg((-1.9, -1.8)[j])),
            (own, "physics:upperLimit", np.rad2deg((1.8, 1.95)[j])),
        ):
            assert prim.GetAttribute(name).Get() == pytest.approx(value, rel=1e-6), name
    first, second = (root.GetChild(f"actuator_{joint}") for joint in model.joints)
    assert not first.HasAPI("NewtonActuatorDelayAPI")
    assert second.GetAttribute("newton:delaySteps").Get() == 12
    assert second.GetAttribute("newton:maxEffort").Get() == pytest.approx(3.0)
    follower = root.GetChild("follower")
    assert follower.GetAttribute("newton:mimicCoef1").Get() == pytest.approx(-0.5)
    assert follower.GetRelationship("newton:mimicJoint").GetTargets()[0].name == "elbow"
    assert root.GetChild("_1__odd__link").GetDisplayName() == "1 'odd' link"


def pose(position: Any, rotation: Any) -> Array:
    found = np.eye(4)
    quaternion = [*rotation.GetImaginary(), rotation.GetReal()]
    found[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    found[:3, 3] = position
    return found


def test_joints_and_bodies_are_where_the_robot_has_them(
    model: ActuatorModel, tmp_path: Path
) -> None:
    robot, stage = model.robot, opened(model, tmp_path)
    q = np.array([0.7, -1.1])
    rotations, origins = bodies_along(robot, q[None])
    at = {"": np.eye(4)}
    for k, body in enumerate(robot.bodies):
        joint = UsdPhysics.Joint(stage.GetDefaultPrim().GetChild(body.joint))
        carrier, child = (
            [path.name for path in rel.GetTargets()]
            for rel in (joint.GetBody0Rel(), joint.GetBody1Rel())
        )
        turned = np.eye(4)
        angle = body.ratio * q[body.coordinate]
        turned[:3, :3] = Rotation.from_euler("x", angle).as_matrix()
        outer = pose(joint.GetLocalPos0Attr().Get(), joint.GetLocalRot0Attr().Get())
        inner = pose(joint.GetLocalPos1Attr().Get(), joint.GetLocalRot1Attr().Get())
        found = at["".join(carrier)] @ outer @ turned @ np.linalg.inv(inner)
        at[child[0]] = found
        np.testing.assert_allclose(found[:3, :3], rotations[k + 1][0], atol=1e-6)
        np.testing.assert_allclose(found[:3, 3], origins[k + 1][0], atol=1e-7)
        prim = stage.GetDefaultPrim().GetChild(child[0])
        mass = UsdPhysics.MassAPI(prim)
        assert mass.GetMassAttr().Get() == pytest.approx(body.inertia.mass, rel=1e-6)
        axes = pose(Gf.Vec3f(0.0), mass.GetPrincipalAxesAttr().Get())[:3, :3]
        about = axes @ np.diag(mass.GetDiagonalInertiaAttr().Get()) @ axes.T
        np.testing.assert_allclose(about, body.inertia.inertia_com, atol=1e-10)
        np.testing.assert_allclose(mass.GetCenterOfMassAttr().Get(), body.inertia.com, atol=1e-7)
    rest, places = bodies_along(robot, np.zeros((1, 2)))
    cache = UsdGeom.XformCache()
    for k in range(len(robot.bodies)):
        world = np.array(
            cache.GetLocalToWorldTransform(stage.GetDefaultPrim().GetChildren()[1 + k])
        )
        np.testing.assert_allclose(world[3, :3], places[k + 1][0], atol=1e-9)
        np.testing.assert_allclose(world[:3, :3].T, rest[k + 1][0], atol=1e-9)


def test_the_command_writes_it_and_a_link_without_mass_is_refused(
    model: ActuatorModel, small_arm: Path, tmp_path: Path
) -> None:
    file = tmp_path / "out.usda"
    done = CliRunner().invoke(app, ["export", str(small_arm / "servo-model"), "-o", str(file)])
    assert done.exit_code == 0, done.output
    assert Usd.Stage.Open(str(file)).GetDefaultPrim().GetName() == "servos"
    text = (tmp_path / "arm.urdf").read_text()
    bare = (
        text[: text.index('<inertial><origin xyz="0.01')]
        + text[text.index('</link>\n<joint name="follower') :]
    )
    (tmp_path / "arm.urdf").write_text(bare)
    light = replace(model, robot=load_robot(tmp_path / "arm.urdf").robot)
    with pytest.raises(ModelError, match="has no mass or no inertia, which USD takes"):
        actuators_usd(light)


def test_names_that_meet_and_joints_that_slide(model: ActuatorModel, tmp_path: Path) -> None:
    text = URDF.replace('"elbow" type="revolute"', '"elbow" type="prismatic"')
    text = text.replace('name="upper"', 'name="actuator_shoulder"')
    text = text.replace('link="upper"', 'link="actuator_shoulder"')
    (tmp_path / "slide.urdf").write_text(text)
    robot = load_robot(tmp_path / "slide.urdf").robot
    stage = opened(replace(model, robot=robot), tmp_path)
    root = stage.GetDefaultPrim()
    assert root.GetChild("actuator_shoulder").IsA(UsdGeom.Xform)
    assert root.GetChild("actuator_shoulder_2").GetTypeName() == "NewtonActuator"
    slide = UsdPhysics.PrismaticJoint(root.GetChild("elbow"))
    assert slide.GetLowerLimitAttr().Get() == pytest.approx(-1.8)
    damping = slide.GetPrim().GetAttribute("newton:damping").Get()
    assert damping == pytest.approx(model.values["back_emf"][1])
    axis = Rotation.from_quat(
        [*slide.GetLocalRot0Attr().Get().GetImaginary(), slide.GetLocalRot0Attr().Get().GetReal()]
    ).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(axis, [0.0, 1.0, 0.0], atol=1e-6)


def test_binary_endings_are_refused(small_arm: Path, tmp_path: Path) -> None:
    file = tmp_path / "arm.usdc"
    arguments = ["export", str(small_arm / "servo-model"), "--to", "usd", "-o", str(file)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2 and "written as text" in done.output and not file.exists()
