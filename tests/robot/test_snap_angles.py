"""Rounded angles of a model file: made exact, or taken at their word."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from steelyard.base.motion import Motion
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot

URDF = """<robot name="rounded">
  <link name="base"/>
  {links}
</robot>"""
LINK = """<link name="l{k}"><inertial><origin xyz="0.1 0.02 0.03"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>
    <origin xyz="0.3 0.1 0.2" rpy="{turn} 0 0"/><axis xyz="0 {tilt} 1"/>
    <limit lower="-3" upper="3" effort="10" velocity="1"/></joint>"""


def arm(tmp_path: Path, snap: bool) -> Path:
    links = [
        LINK.format(k=k, parent=f"l{k - 1}" if k else "base", turn=turn, tilt=tilt)
        for k, (turn, tilt) in enumerate([("0", "0"), ("1.5708", "0"), ("0", "1.5e-5")])
    ]
    (tmp_path / "arm.urdf").write_text(URDF.format(links="\n  ".join(links)))
    path = tmp_path / "arm.toml"
    path.write_text(f'[robot]\nurdf = "arm.urdf"\nsnap_angles = {str(snap).lower()}\n')
    return path


@pytest.mark.parametrize(("snap", "least", "most"), [(True, 1e-9, 3e-5), (False, 0.0, 1e-12)])
def test_torque_against_pinocchio(tmp_path: Path, snap: bool, least: float, most: float) -> None:
    robot = load_robot(arm(tmp_path, snap)).robot
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 50, 3))
    model = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    data = model.createData()
    oracle = np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])
    bodies = Model(robot, (RigidBody(),)).prior
    assert bodies is not None
    error = np.abs(bodies.torque(Motion(np.arange(50.0), q, dq, ddq)) - oracle).max()
    assert least <= error / np.abs(oracle).max() <= most


def test_snapped_placements_are_exact_and_others_as_written(tmp_path: Path) -> None:
    snapped, written = (load_robot(arm(tmp_path, snap)).robot for snap in (True, False))
    assert set(np.unique(snapped.bodies[1].rotation)) == {-1.0, 0.0, 1.0}
    assert np.array_equal(snapped.bodies[2].axis, [0.0, 0.0, 1.0])
    assert np.isclose(written.bodies[1].rotation[1, 1], np.cos(1.5708), rtol=1e-6)
    assert np.isclose(written.bodies[2].axis[1], 1.5e-5)
