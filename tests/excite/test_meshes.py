"""Meshes: found, read, or refused in clear words."""

import struct
from pathlib import Path

import numpy as np
import pytest

from excite.colliding import joint, link, urdf, written
from steelyard.base.errors import ModelError
from steelyard.excite.collision.robot_and_cell_shapes_from_files import (
    find_mesh,
    mesh_points,
    robot_shapes,
)
from steelyard.excite.collision.solids_and_shapes import Hull, height
from steelyard.robot.file.robot_file import load_robot

CORNERS = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0], [0, 0, 0.2], [0.05, 0.05, 0.05]])
FACETS = [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3), (0, 1, 4)]


def stl(text: bool) -> bytes:
    """The corners as an STL, written or binary."""
    if not text:
        head = b"solid exported".ljust(80) + struct.pack("<I", len(FACETS))
        facets = (struct.pack("<12f", 0, 0, 0, *CORNERS[list(f)].ravel()) for f in FACETS)
        return head + b"".join(facet + b"\0\0" for facet in facets)
    lines = ["solid thing"]
    for facet in FACETS:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {} {} {}".format(*CORNERS[k]) for k in facet]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid thing"]).encode()


def obj() -> bytes:
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + ["vn 0 0 1", "f 1 2 3"]
    return "\n".join(["# a comment", *lines]).encode()


@pytest.mark.parametrize(
    ("name", "data"), [("a.stl", stl(True)), ("b.STL", stl(False)), ("c.obj", obj())]
)
def test_meshes_are_read(tmp_path: Path, name: str, data: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    points = mesh_points(path, "a test")
    assert len(points) == len(CORNERS)
    np.testing.assert_allclose(points, CORNERS[np.lexsort(CORNERS.T[::-1])], atol=1e-7)
    assert len(Hull(points).vertices) == 4


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.dae", b"<COLLADA/>", "of an unsupported format ('.dae')"),
        ("a.stl", b"nothing of the kind" * 10, "not an STL file: its length does not fit"),
        ("a.stl", b"solid empty\nendsolid", "it has no vertices"),
        ("a.stl", b"solid\nvertex 1 2\n", "does not have three numbers"),
        ("a.obj", b"v 1 2 three", "could not convert"),
        ("a.obj", b"v 1 2 nan", "a vertex is not finite"),
    ],
)
def test_meshes_that_are_none_are_refused(
    tmp_path: Path, name: str, data: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(data)
    mesh = urdf(
        link("base", '<box size="1 1 1"/>'),
        link("arm"),
        link("hand", f'<mesh filename="{name}"/>'),
        joint("base", "arm"),
        joint("arm", "hand"),
    )
    path = written(tmp_path, mesh)
    robot = load_robot(path).robot
    with pytest.raises(ModelError) as error:
        robot_shapes(robot, path)
    assert words in error.value.wrong and name in error.value.wrong
    assert "'hand'" in error.value.where and "line 4" in error.value.where
    assert "`without`" in error.value.fix
    found = robot_shapes(robot, path, skip=["hand"])
    assert [shape.name for shape in found.shapes] == ["base"]
    assert found.notes[0] == "no clearance is kept for the links hand, as specified"


def test_a_missing_mesh_is_named(tmp_path: Path) -> None:
    mesh = '<mesh filename="package://my_robot/meshes/hand.stl"/>'
    path = written(tmp_path, urdf(link("base"), link("hand", mesh), joint("base", "hand")))
    with pytest.raises(ModelError) as error:
        robot_shapes(load_robot(path).robot, path)
    assert "'package://my_robot/meshes/hand.stl' of link 'hand' does not exist" in str(error.value)
    assert "`without`" in error.value.fix
    with pytest.raises(ModelError, match="did you mean 'hand'"):
        robot_shapes(load_robot(path).robot, path, skip=["hnad"])


def test_packages_are_looked_for_above_the_model(tmp_path: Path) -> None:
    model = tmp_path / "robots" / "arm_description" / "urdf" / "arm.urdf"
    mesh = tmp_path / "robots" / "arm_description" / "meshes" / "arm.stl"
    for path in (model, mesh):
        path.parent.mkdir(parents=True)
        path.write_bytes(stl(False))
    near = model.parent / "near.stl"
    near.touch()
    for name, expected in {
        "package://arm_description/meshes/arm.stl": mesh,
        "package://elsewhere/robots/arm_description/meshes/arm.stl": mesh,
        "model://renamed/meshes/arm.stl": mesh,
        "../meshes/arm.stl": model.parent / "../meshes/arm.stl",
        f"file://{mesh}": mesh,
        str(mesh): mesh,
        "near.stl": near,
        "package://arm_description/meshes/none.stl": None,
        "package://other/near.stl": None,
        "file:///none.stl": None,
    }.items():
        assert find_mesh(name, model) == expected, name


def test_meshes_are_scaled(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(stl(False))
    mesh = '<mesh filename="a.stl" scale="1 2 -1"/>'
    path = written(tmp_path, urdf(link("base"), link("hand", mesh), joint("base", "hand")))
    (shape,) = robot_shapes(load_robot(path).robot, path).shapes
    axes = np.vstack([np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(height(shape.solid, axes), [0.4, 0.6, 0, 0, 0, 0.2], atol=1e-7)
