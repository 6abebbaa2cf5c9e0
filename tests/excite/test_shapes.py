"""Collision shapes: what model files and users say of them."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import closed_chains
from excite.colliding import SNAKE, joint, link, panda, snake, urdf, written
from steelyard.base.errors import ModelError
from steelyard.excite.collision.clearance import self_clearance
from steelyard.excite.collision.robot_and_cell_shapes_from_files import robot_shapes, world_shapes
from steelyard.excite.collision.solids_and_shapes import Ball, placed, wall
from steelyard.robot.file.robot_file import load_robot

BOMB = """<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>
<{0} name="&b;"/>"""


def test_locked_links_move_with_the_body_they_merged_into(tmp_path: Path) -> None:
    path = written(tmp_path, SNAKE)
    text = f"[robot]\nurdf = '{path}'\nlocked = {{three_joint = 0.7, slider_joint = 0.2}}\n"
    free, locked = load_robot(path).robot, load_robot("robot.toml", text=text).robot
    loose, fixed = robot_shapes(free, path), robot_shapes(locked, path)
    assert [shape.body for shape in fixed.shapes] == [-1, 0, 1, 1, 1, 1, 1, 2]
    q = np.array([[0.3, -0.4]])
    all_of = self_clearance(load_robot(path))
    some = self_clearance(load_robot("robot.toml", text=text))
    mine = dict(zip((p.names for p in some.pairs), some.distances(q)[0], strict=True))
    whole = all_of.distances(np.hstack([q, [[0.7, 0.2]]]))[0]
    theirs = dict(zip((p.names for p in all_of.pairs), whole, strict=True))
    assert len(loose.shapes) == len(fixed.shapes)
    assert frozenset(("base", "slider")) in mine and frozenset(("two", "slider")) not in mine
    for names, distance in mine.items():
        assert distance == pytest.approx(theirs[names], abs=1e-9), names


def test_shared_arm_has_a_shape_for_every_link_with_a_mesh() -> None:
    loaded = panda()
    found = robot_shapes(loaded.robot, loaded.sources[-1].path)
    names = {shape.name for shape in found.shapes}
    links = {f"panda_link{k}" for k in range(8)}
    assert names == links | {"panda_hand", "panda_leftfinger", "panda_rightfinger"}
    on_flange = {shape.body for shape in found.shapes if "finger" in shape.name}
    assert on_flange == {6}


MJCF = """<mujoco><compiler angle="radian"/><worldbody>
  <geom name="floor" type="plane" size="1 1 1" pos="0 0 -0.2" euler="0.1 0 0"/>
  <body name="arm" pos="0 0 0.1" euler="0 0.2 0.3">
    <joint name="shoulder" pos="0.02 0.01 0" axis="0 0 1" range="-2 2"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0.05" size="0.04"/>
    <geom type="box" size="0.5 0.5 0.5" contype="0" conaffinity="0"/>
    <body name="mid" pos="0.35 0 0"><geom type="ellipsoid" size="0.05 0.04 0.06"/>
      <joint name="lift" pos="0 0 0.02" axis="0 1 0" range="-2 2"/>
      <joint name="slide" type="slide" pos="0.1 0 0.02" axis="0 1 1" range="-0.1 0.3" ref="0.05"/>
      <body name="tool" pos="0.2 0.02 0"><joint name="wrist" axis="1 1 0" range="-3 3"/>
        <geom type="cylinder" size="0.03 0.1" pos="0.05 0 0" euler="0.5 0 0"/>
        <geom type="mesh" mesh="wedge" pos="0 0.1 0"/></body>
      <body name="ghost"><joint name="drift"/>
        <geom type="sphere" size="0.1" contype="2" conaffinity="2"/></body>
    </body></body></worldbody>
  <asset><mesh name="wedge" vertex="0 0 0  0.2 0 0  0 0.1 0  0 0 0.15"/></asset>
  <contact><exclude body1="arm" body2="tool"/></contact></mujoco>"""


def test_mjcf_distances_are_those_of_mujoco_itself(tmp_path: Path) -> None:
    path = written(tmp_path, MJCF, "arm.xml")
    loaded = load_robot(path)
    found = self_clearance(loaded)
    assert {tuple(sorted(pair.names)) for pair in found.pairs} == {
        ("mid", "world"),
        ("tool", "world"),
    }
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    geoms = {
        name: np.flatnonzero(model.geom_bodyid == model.body(name).id) for name in ("mid", "tool")
    }
    plane = model.geom("floor").id
    for q in np.random.default_rng(0).uniform(-0.1, 0.3, (20, 5)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for pair, distance in zip(found.pairs, found.distances(q[None])[0], strict=True):
            name = next(iter(pair.names - {"world"}))
            theirs = [
                mujoco.mj_geomDistance(model, data, plane, int(g), 10.0, None) for g in geoms[name]
            ]
            assert distance == pytest.approx(min(theirs), abs=1e-6)


def test_mjcf_shapes_that_are_not_convex_are_refused(tmp_path: Path) -> None:
    field = (
        '<asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 0 1"/></asset>'
    )
    text = f"""<mujoco>{field}<worldbody><geom type="hfield" hfield="hills"/>
      <body name="arm"><joint/><geom size="0.1"/></body></worldbody></mujoco>"""
    path = written(tmp_path, text, "arm.xml")
    with pytest.raises(ModelError, match="link 'world' has a colliding geom of kind hfield"):
        robot_shapes(load_robot(path).robot, path)
    assert len(robot_shapes(load_robot(path).robot, path, skip=["world"]).shapes) == 1
    with pytest.raises(ModelError, match="of kind hfield"):
        world_shapes(path)


def test_a_cell_is_read_from_both_kinds_of_files(tmp_path: Path) -> None:
    shelf = urdf(
        link("room"),
        link("table", '<box size="1 0.5 0.02"/>', xyz="0 0 -0.01"),
        link("door", '<box size="0.1 0.5 0.02"/>', '<sphere radius="0.03"/>'),
        joint("room", "table", "0.5 0.2 0.3", kind="fixed", rpy="0 0 0.5"),
        joint("table", "door", "0.4 0 0"),
    )
    mjcf = """<mujoco><compiler angle="radian"/><worldbody>
      <body name="table" pos="0.5 0.2 0.3" euler="0 0 0.5">
        <geom type="box" size="0.5 0.25 0.01" pos="0 0 -0.01"/>
        <body name="door" pos="0.4 0 0"><joint/><geom type="box" size="0.05 0.25 0.01"/>
          <geom size="0.03"/></body></body></worldbody></mujoco>"""
    both = [world_shapes(written(tmp_path, shelf, "cell.urdf"))]
    both.append(world_shapes(written(tmp_path, mjcf, "cell.xml")))
    for first, second in zip(*both, strict=True):
        assert first.name == second.name and first.solid == second.solid
        assert first.origin == second.origin == "world" and first.body == second.body == -1
        np.testing.assert_allclose(first.rotation, second.rotation, atol=1e-12)
        np.testing.assert_allclose(first.position, second.position, atol=1e-12)
    with pytest.raises(ModelError, match="holds no collision shape"):
        world_shapes(written(tmp_path, urdf(link("empty")), "empty.urdf"))


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ('<cone radius="1"/>', "a collision shape <cone>, which is unknown"),
        ('<sphere radius="-1"/>', "a sphere of -1 m is not a solid"),
        ("<sphere/>", "<sphere> has no attribute 'radius'"),
        ('<box size="1 2"/>', 'size="1 2" of <box> is not 3 finite numbers'),
        ('<box size="1 2 nan"/>', "is not 3 finite numbers"),
        ('<box size="1 1 1"/><sphere radius="1"/>', "a collision of link 'hand' has 2 shapes"),
        ('<mesh filename=""/>', "the collision mesh '' of link 'hand' does not exist"),
    ],
)
def test_shapes_that_cannot_be_read_are_refused(tmp_path: Path, shape: str, words: str) -> None:
    path = written(tmp_path, urdf(link("base"), link("hand", shape), joint("base", "hand")))
    with pytest.raises(ModelError) as error:
        robot_shapes(load_robot(path).robot, path)
    assert words in error.value.wrong
    assert "line" in error.value.where


def test_xml_that_grows_is_refused(tmp_path: Path) -> None:
    loaded = snake(tmp_path)
    for name, kind in (("bomb.urdf", "robot"), ("bomb.xml", "mujoco")):
        path = written(tmp_path, BOMB.format(kind), name)
        with pytest.raises(ModelError, match="defines XML entities"):
            world_shapes(path)
        with pytest.raises(ModelError, match="defines XML entities"):
            robot_shapes(loaded.robot, path)
    written(tmp_path, BOMB.format("robot"), "snake.srdf")
    with pytest.raises(ModelError, match="defines XML entities"):
        self_clearance(loaded)


def test_an_srdf_says_what_it_must(tmp_path: Path) -> None:
    loaded = snake(tmp_path)
    path = written(
        tmp_path, '<robot name="snake"><disable_collisions link1="one"/></robot>', "a.srdf"
    )
    with pytest.raises(ModelError, match="does not name two links"):
        self_clearance(loaded)
    path.write_text("<semantics/>")
    with pytest.raises(ModelError, match="the file is not an SRDF"):
        self_clearance(loaded)


def test_a_robot_without_shapes_or_with_loops_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, urdf(link("base"), link("arm"), joint("base", "arm")))
    with pytest.raises(ModelError, match="gives no link of the robot a collision shape"):
        robot_shapes(load_robot(path).robot, path)
    with pytest.raises(ModelError, match="clearances are not supported"):
        robot_shapes(closed_chains.five_bar(), path)


def test_links_without_shapes_and_outside_the_base_are_noted(tmp_path: Path) -> None:
    path = written(tmp_path, SNAKE.replace('<sphere radius="0.07"/>', '<box size="1 1 1"/>'))
    text = f"[robot]\nurdf = '{path}'\nbase = 'one'\n"
    notes = robot_shapes(load_robot("robot.toml", text=text).robot, path).notes
    assert notes == ("not attached to the base, so left out: base",)
    dog = tmp_path / "dog.xml"
    for world, gap in ("", ()), ("<geom size='1 1 1' type='box'/>", (f"{notes[0][:-4]}world",)):
        dog.write_text(f"""<mujoco><worldbody>{world}<body name="trunk"><freejoint/>
        <geom size=".1"/><body><joint name="hip"/><geom size=".1"/></body></body></worldbody>
        </mujoco>""")
        assert robot_shapes(load_robot(dog, base="trunk").robot, dog).notes == gap
    bare = urdf(
        link("base"),
        link("arm"),
        link("hand", '<box size="1 1 1"/>'),
        joint("base", "arm"),
        joint("arm", "hand"),
    )
    path = written(tmp_path, bare)
    notes = robot_shapes(load_robot(path).robot, path).notes
    assert notes == ("no collision shape in the model, so no clearance is kept for: base, arm",)


def test_things_are_attached_where_they_are_stated_to_be(tmp_path: Path) -> None:
    robot = snake(tmp_path).robot
    frame = next(frame for frame in robot.frames if frame.name == "plate")
    load = placed(frame, "load", Ball(0.1), (0.1, 0.0, 0.0), origin="tool")
    np.testing.assert_allclose(load.position, frame.position + frame.rotation[:, 0] * 0.1)
    assert (load.body, load.origin) == (frame.body, "tool")
    with pytest.raises(ModelError, match="has no direction"):
        wall("floor", (0.0, 0.0, 0.0), 1.0)
    slope = wall("slope", (3.0, 0.0, 4.0), 2.0)
    np.testing.assert_allclose(slope.rotation[:, 2], (0.6, 0.0, 0.8))
    np.testing.assert_allclose(slope.position @ (0.6, 0.0, 0.8), 0.4)
    np.testing.assert_allclose(slope.rotation @ slope.rotation.T, np.eye(3), atol=1e-12)
