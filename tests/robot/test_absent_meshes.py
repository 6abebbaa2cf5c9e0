from pathlib import Path

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.excite.collision.robot_and_cell_shapes_from_files import robot_shapes
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.models.mjcf import compiled, read_mjcf
from steelyard.robot.robot_from_mechanism import reduced

CORNERS = [(0, 0, 0), (0.3, 0, 0), (0, 0.2, 0), (0, 0, 0.1)]
SURFACE = [(1, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)]
INERTIAL = '<inertial pos=".1 0 .05" mass="2" diaginertia=".02 .03 .04"/>'
ARM = """
<mujoco model="arm">
  <compiler meshdir="meshes" {compiler}/>
  <asset>
    <mesh name="upper" file="upper.obj"/>
    <mesh file="lower.obj" scale="2 2 2"/>
    {assets}
  </asset>
  <worldbody>
    {world}
    <body name="first" pos="0 0 .5">
      <joint name="a" axis="0 1 0"/>
      {first}
      <geom name="hull" type="mesh" mesh="upper" {geom}/>
      <body name="second" pos=".3 0 0">
        <joint name="b" axis="0 1 0"/>
        {second}
        <geom type="box" size=".1 .1 .2" pos="0 .1 0"/>
      </body>
    </body>
  </worldbody>
  {end}
</mujoco>
"""


def written(
    folder: Path,
    *,
    compiler: str = "",
    assets: str = "",
    world: str = "",
    first: str = INERTIAL,
    second: str = "",
    geom: str = 'contype="0" conaffinity="0"',
    end: str = "",
) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "arm.xml"
    text = ARM.format(
        compiler=compiler,
        assets=assets,
        world=world,
        first=first,
        second=second,
        geom=geom,
        end=end,
    )
    path.write_text(text)
    return path


def with_meshes(path: Path) -> Path:
    """Put the meshes that a file names."""
    folder = path.parent / "meshes"
    folder.mkdir()
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {a} {b} {c}" for a, b, c in SURFACE]
    for name in ("upper.obj", "lower.obj"):
        (folder / name).write_text("\n".join(lines) + "\n")
    return path


SAME = {
    "explicit": {},
    "balanced": {"compiler": 'balanceinertia="true" boundmass="1" boundinertia="0.025"'},
    "total": {"compiler": 'settotalmass="7"'},
    "never from geoms": {"compiler": 'inertiafromgeom="false"', "second": INERTIAL},
    "group left out": {
        "compiler": 'inertiafromgeom="true" inertiagrouprange="0 2"',
        "geom": 'group="4"/><geom type="sphere" size=".1"',
    },
    "without mass": {"first": "", "geom": 'mass="0"/><geom type="sphere" size=".1"'},
    "without density": {"first": "", "geom": 'density="0"/><geom type="sphere" size=".1"'},
    "sensed": {"end": '<sensor><framepos objtype="geom" objname="hull"/></sensor>'},
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("case", SAME)
def test_inertias_are_those_with_all_meshes(case: str, tmp_path: Path) -> None:
    there = compiled(with_meshes(written(tmp_path / "there", **SAME[case])))
    absent = compiled(written(tmp_path / "absent", **SAME[case]))
    assert not there.stand_ins and absent.stand_ins and not absent.without_inertia
    for quantity in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        assert np.array_equal(getattr(absent.model, quantity), getattr(there.model, quantity))


NEEDED = {
    "no inertial": {"first": ""},
    "from geoms": {"compiler": 'inertiafromgeom="true"'},
    "beside a box": {"first": "", "geom": '/><geom type="box" size=".1 .1 .1"'},
}


@pytest.mark.parametrize("case", NEEDED)
def test_a_body_whose_inertia_needs_the_mesh_has_none(case: str, tmp_path: Path) -> None:
    path = written(tmp_path / "absent", **NEEDED[case])
    there = read_mjcf(with_meshes(written(tmp_path / "there", **NEEDED[case])))
    mechanism = read_mjcf(path)
    first, second = mechanism.links[1:3]
    assert (first.name, first.inertia, first.lacks) == ("first", None, "upper")
    assert second.inertia is not None and there.links[2].inertia is not None
    assert np.array_equal(second.inertia.inertia_com, there.links[2].inertia.inertia_com)
    robot, notes = reduced(mechanism)
    assert robot.joint_names == ("a", "b")
    assert "nominal mass is zero, as the mesh is missing: first ('upper')" in notes
    assert not any("no inertial" in note for note in notes)


@pytest.mark.filterwarnings("ignore")
def test_a_total_mass_with_an_unknown_part_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, first="", compiler='settotalmass="7"')
    with pytest.raises(ModelError) as caught:
        read_mjcf(path)
    assert "body 'first'" in caught.value.wrong and "mesh 'upper'" in caught.value.wrong


def test_pictures_and_height_fields_do_not_matter(tmp_path: Path) -> None:
    assets = """
    <texture type="skybox" fileup="a.png" filedown="b.png"/>
    <texture name="wood" type="2d" file="wood.png"/>
    <material name="m" texture="wood"/>
    <hfield name="hills" file="hills.png" size="1 1 1 .1"/>
    <skin name="s" file="s.skn"/>"""
    world = '<geom type="hfield" hfield="hills" material="m"/>'
    robot, notes = reduced(read_mjcf(written(tmp_path, assets=assets, world=world)))
    assert robot.joint_names == ("a", "b") and notes == ()


def test_a_pointer_of_git_lfs_is_no_mesh(tmp_path: Path) -> None:
    path = with_meshes(written(tmp_path))
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 684\n"
    (tmp_path / "meshes" / "upper.obj").write_text(pointer)
    assert list(compiled(path).stand_ins.values()) == ["upper"]


def test_what_is_wrong_beside_absent_meshes_is_reported(tmp_path: Path) -> None:
    path = written(tmp_path, end='<sensor><framepos objtype="geom" objname="gone"/></sensor>')
    with pytest.raises(ModelError, match="gone"):
        read_mjcf(path)
    path.write_text('<mujoco><include file="gone.xml"/></mujoco>')
    with pytest.raises(ModelError, match="gone.xml") as caught:
        read_mjcf(path)
    assert caught.value.fix == "put the missing file where the MJCF looks for it"


def test_clearances_do_not_pass_over_absent_collision_meshes(tmp_path: Path) -> None:
    path = written(tmp_path, geom="")
    robot = load_robot(path).robot
    with pytest.raises(ModelError, match="collision mesh 'upper' of link 'first' is not there"):
        robot_shapes(robot, path)
    shapes = robot_shapes(robot, path, skip=("first",)).shapes
    assert [shape.name for shape in shapes] == ["second"]
    drawn = written(tmp_path)
    assert [shape.name for shape in robot_shapes(robot, drawn).shapes] == ["second"]
