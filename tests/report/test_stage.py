"""What a replay shows: meshes of solids, sticks, poses against Pinocchio."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from closed_chains import five_bar, independent_path, slider_crank, spatial
from steelyard.excite.collision.solids_and_shapes import (
    Ball,
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
)
from steelyard.excite.constraints.tool_workspace import Marker
from steelyard.excite.page.browser_replay import Stage, mesh_of, staged, sticks
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.equations.passive_joints import passive_positions
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.loop_closures import gaps

CORNERS = np.random.default_rng(1).standard_normal((30, 3))
VOLUMES = [
    (Ball(0.5), 4.0 / 3.0 * np.pi * 0.125),
    (Box((0.1, 0.4, 2.0)), 0.08),
    (Ellipsoid((0.1, 0.3, 0.5)), 4.0 / 3.0 * np.pi * 0.015),
    (Cylinder(0.2, 0.7), np.pi * 0.04 * 0.7),
    (Capsule(0.2, 0.7), np.pi * 0.04 * 0.7 + 4.0 / 3.0 * np.pi * 0.008),
    (Hull(CORNERS), ConvexHull(CORNERS).volume),
]
URDF = """<robot name="pair">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
    iyz="0"/></inertial><collision><origin xyz="0.1 0 0.2" rpy="0.3 0.2 0.1"/><geometry>
    <cylinder radius="0.05" length="0.4"/></geometry></collision></link>
  <link name="bare"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
    iyz="0"/></inertial></link>
  <link name="tip"/>
  <joint name="first" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0.1 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="2" effort="10"/></joint>
  <joint name="second" type="prismatic"><parent link="upper"/><child link="bare"/>
    <origin xyz="0.2 0 0.4" rpy="0 0.5 0"/><axis xyz="0 1 0"/>
    <limit lower="-0.2" upper="0.2" velocity="1" effort="10"/></joint>
  <joint name="fixed" type="fixed"><parent link="bare"/><child link="tip"/>
    <origin xyz="0 0 0.3"/></joint>
</robot>"""


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """An arm of which one link has no shape."""
    path = tmp_path / "pair.urdf"
    path.write_text(URDF)
    return path


def stage_of(path: Path) -> Stage:
    loaded = load_robot(path)
    return staged(loaded, random_fourier(loaded.robot, seed=3, period=3.0))


@pytest.mark.parametrize(("solid", "volume"), VOLUMES)
def test_meshes_are_closed_and_have_the_volume(solid, volume) -> None:
    corners, faces = mesh_of(solid)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    enclosed = np.einsum("ij,ij->i", a - corners.mean(axis=0), normal).sum() / 6.0
    assert enclosed == pytest.approx(volume, rel=0.06)
    np.testing.assert_allclose(normal.sum(axis=0), 0.0, atol=1e-9)
    reach = np.linalg.norm(corners - solid.centre, axis=1)
    assert reach.max() <= solid.radius + 1e-9


def test_a_half_space_is_a_square_on_its_plane() -> None:
    corners, faces = mesh_of(HalfSpace())
    assert np.all(corners[:, 2] == 0.0) and len(faces) == 2


def test_shapes_are_where_pinocchio_has_them(pair: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    stage = stage_of(pair)
    model = pin.buildModelFromUrdf(str(pair))
    geometry = pin.buildGeomFromUrdf(model, str(pair), pin.GeometryType.COLLISION)
    data, places = model.createData(), pin.GeometryData(geometry)
    for time in (0.0, 0.77, 2.1):
        q = stage.trajectory.sample([time]).q[0]
        pin.updateGeometryPlacements(model, data, geometry, places, q)
        rotations, origins = stage.at(time)
        for k, name in enumerate(("base", "upper")):
            assert stage.shapes[k].name == name
            other = places.oMg[k]
            np.testing.assert_allclose(origins[k], other.translation, atol=1e-9)
            np.testing.assert_allclose(rotations[k], other.rotation, atol=1e-9)
    pin.framesForwardKinematics(model, data, stage.trajectory.sample(stage.t[-3:-2]).q[0])
    tip = data.oMf[model.getFrameId("tip")].translation
    np.testing.assert_allclose(stage.path[-3], tip, atol=1e-9)


def test_a_link_without_shapes_is_a_stick_to_what_it_carries(pair: Path) -> None:
    stage = stage_of(pair)
    assert [s.name for s in stage.shapes] == ["base", "upper", "bare", "to tip"]
    ball, stick = stage.shapes[2:]
    assert isinstance(ball.solid, Ball) and isinstance(stick.solid, Cylinder)
    assert stick.solid.length == pytest.approx(0.3)
    rotations, origins = stage.at(1.3)
    along = rotations[3] @ np.array([0.0, 0.0, 0.15])
    np.testing.assert_allclose(origins[3] - along, origins[2], atol=1e-9)
    end = stage.path[np.argmin(np.abs(stage.t - 1.3))]
    np.testing.assert_allclose(origins[3] + along, end, atol=0.05)


def test_a_model_whose_shapes_cannot_be_read_is_drawn_as_sticks(pair: Path) -> None:
    pair.write_text(URDF.replace('<box size="0.2 0.2 0.1"/>', '<mesh filename="no.stl"/>'))
    stage = stage_of(pair)
    assert any("links are drawn as sticks" in note and "no.stl" in note for note in stage.notes)
    assert all(isinstance(shape.solid, Ball | Cylinder) for shape in stage.shapes)
    assert len(stage.shapes) == 2 + 3


def test_sticks_hang_together() -> None:
    arm = load_robot(Path(__file__).parents[2] / "src/steelyard/simulate/demo_arm.urdf").robot
    last = arm.bodies[-1].name
    bare = sticks(arm, Marker(last, (0.0, 0.0, 0.2)), set())
    longest = [s for s in bare if isinstance(s.solid, Cylinder)]
    assert len(longest) >= arm.n - 1
    for shape in longest:
        axis = shape.rotation[:, 2]
        near = shape.position - 0.5 * shape.solid.length * axis
        np.testing.assert_allclose(near, 0.0, atol=1e-9)
        np.testing.assert_allclose(shape.rotation.T @ shape.rotation, np.eye(3), atol=1e-12)


def test_walls_and_the_cell_are_drawn(pair: Path) -> None:
    cell = pair.parent / "cell.urdf"
    cell.write_text(
        '<robot name="cell"><link name="table"><collision><origin xyz="0 0 -0.1"/><geometry>'
        '<box size="1 1 0.1"/></geometry></collision></link></robot>'
    )
    file = pair.parent / "pair.toml"
    file.write_text(
        '[robot]\nurdf = "pair.urdf"\n[excitation.workspace]\nframe = "bare"\n'
        "box = { z = [0.0, 1.5] }\nkeep_out = [{ x = [0.5, 0.6], y = [0, 1], z = [0, 1] }]\n"
        '[excitation.collision]\nworld = "cell.urdf"\n'
    )
    stage = stage_of(file)
    assert [s.name for s in stage.shapes if s.origin == "world"] == ["table"]
    assert stage.tool.frame == "bare"
    (inside, room), (outside, box) = stage.walls
    assert (inside, outside) == (False, True)
    assert set(room[..., 2].ravel()) == {0.0, 1.5}, "there is no wall in x or y"
    low, high = stage.path.min(axis=0), stage.path.max(axis=0)
    assert room[..., 0].min() < low[0] and room[..., 0].max() > high[0]
    for line in room:  # none along the end of a wall that goes on
        along = np.argmax(np.abs(line[1] - line[0]))
        across = 1 - along
        assert room[..., across].min() < line[0, across] < room[..., across].max()
    np.testing.assert_allclose(box.min(axis=(0, 1)), [0.5, 0.0, 0.0])
    np.testing.assert_allclose(box.max(axis=(0, 1)), [0.6, 1.0, 1.0])


def test_a_floor_and_planes_are_drawn_where_they_are(pair: Path) -> None:
    file = pair.parent / "floor.toml"
    file.write_text(
        '[robot]\nurdf = "pair.urdf"\n[excitation.workspace]\nfloor = -0.2\n'
        "planes = [{ normal = [0.0, 3.0, 4.0], above = -1.0 }]\n"
    )
    ((forbidden, lines),) = stage_of(file).walls
    floor = np.isclose(lines[..., 2], -0.2).all(axis=1)
    plane = np.isclose(lines @ [0.0, 3.0, 4.0], -1.0).all(axis=1)
    assert not forbidden and floor.any() and plane.any() and np.all(floor | plane)


@pytest.mark.parametrize("make", [five_bar, slider_crank, spatial])
def test_closed_chains_stay_closed(make) -> None:
    robot = make()
    q = independent_path(robot, 40, 0.3).T
    joints = np.hstack([q, passive_positions(robot, q.T).T])
    assert max(gaps(robot, row).max() for row in joints) < 1e-9


def test_panda_has_all_its_links(tmp_path: Path) -> None:
    data = os.environ.get("STEELYARD_DATA")
    if data is None:
        pytest.skip("STEELYARD_DATA does not name the folder of the real logs")
    urdf = Path(data).parent / "models" / "panda_description" / "urdf" / "panda.urdf"
    stage = stage_of(urdf)
    assert len({shape.name for shape in stage.shapes}) >= 10 and stage.notes == ()
