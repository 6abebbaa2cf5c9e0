"""Shapes and SRDF of robots and cells that are xacro files."""

from pathlib import Path

import pytest

from steelyard.excite.collision.pairs_to_keep_apart import find_srdf
from steelyard.excite.collision.robot_and_cell_shapes_from_files import world_shapes
from steelyard.robot.file.robot_file import load_robot

CELL = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="cell">
<xacro:property name="size" value="0.5"/><link name="table"><collision><geometry>
<box size="${size} ${size} 0.1"/></geometry></collision></link></robot>"""
ARM = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm">
<xacro:arg name="x" default="1"/>
<link name="a"/><link name="b"><inertial><mass value="$(arg x)"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STEELYARD_CACHE", str(tmp_path / "cache"))


def test_a_cell(tmp_path: Path) -> None:
    (tmp_path / "cell.urdf.xacro").write_text(CELL)
    assert [shape.name for shape in world_shapes(tmp_path / "cell.urdf.xacro")] == ["table"]


def test_the_srdf_is_beside_the_file_given(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf.xacro").write_text(ARM)
    (tmp_path / "arm.srdf").write_text('<robot name="arm"/>')
    loaded = load_robot(tmp_path / "arm.urdf.xacro")
    assert find_srdf(loaded.sources[-1].path, loaded.model_given) == tmp_path / "arm.srdf"
