"""Robots that can collide, motions that make them, and coal as an oracle of distances."""

import os
from collections.abc import Sequence
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from oracles import body_positions, pinocchio_model
from steelyard.base.arrays import Array
from steelyard.excite.collision.solids_and_shapes import (
    Ball,
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    Shape,
    Solid,
)
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.robot import Robot

LINK = """<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0"
  iyy="0.1" iyz="0" izz="0.1"/></inertial>{collision}</link>"""
COLLISION = '<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></collision>'
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
  <limit lower="-2.5" upper="2.5" effort="10" velocity="3"/>{mimic}</joint>"""


def link(name: str, *shapes: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    """A link with shapes, all at one place."""
    return LINK.format(
        name=name,
        collision="".join(COLLISION.format(xyz=xyz, rpy=rpy, shape=shape) for shape in shapes),
    )


def joint(
    parent: str,
    child: str,
    xyz: str = "0 0 0",
    axis: str = "0 0 1",
    kind: str = "revolute",
    rpy: str = "0 0 0",
    mimic: str = "",
) -> str:
    """A joint that is named after its child."""
    return JOINT.format(
        name=f"{child}_joint",
        kind=kind,
        parent=parent,
        child=child,
        xyz=xyz,
        rpy=rpy,
        axis=axis,
        mimic=mimic,
    )


def urdf(*parts: str, name: str = "arm") -> str:
    """A URDF."""
    return f'<robot name="{name}">{"".join(parts)}</robot>'


SNAKE = urdf(
    link("base", '<box size="0.3 0.2 0.1"/>'),
    link("one", '<capsule radius="0.05" length="0.3"/>', xyz="0.2 0 0", rpy="0 1.5708 0"),
    link("two", '<cylinder radius="0.05" length="0.3"/>', xyz="0.2 0 0", rpy="0 1.5708 0.2"),
    link("plate", '<box size="0.02 0.2 0.1"/>', '<sphere radius="0.06"/>', rpy="0.3 0.1 0"),
    link("three", '<box size="0.2 0.06 0.08"/>', xyz="0.12 0 0.02", rpy="0 0 0.3"),
    link("slider", '<sphere radius="0.07"/>', xyz="0.3 0 0"),
    link("twin", '<box size="0.1 0.04 0.04"/>', xyz="0.1 0.02 0"),
    joint("base", "one", "0 0 0.06"),
    joint("one", "two", "0.4 0 0.02", "0 0.1 1"),
    joint("two", "plate", "0.4 0.02 0", kind="fixed", rpy="0 0.2 0"),
    joint("plate", "three", "0.05 0 0", "0.2 0.3 1"),
    joint("three", "slider", axis="1 0 0", kind="prismatic"),
    joint("plate", "twin", "0 0.1 0", mimic='<mimic joint="two_joint" multiplier="-0.7"/>'),
    name="snake",
)
"""A chain with a slide, a follower and two shapes on one link."""


ARM_WITHOUT = urdf(
    link("base"),
    link("tower"),
    link("boom"),
    link("stick"),
    '<link name="tool"/>',
    joint("base", "tower", "0 0 0.12"),
    joint("tower", "boom", "0 0.15 0.2", "0 1 0"),
    joint("boom", "stick", "0.3 0 0", "0 1 0"),
    joint("stick", "tool", "0.35 0 0.02", kind="fixed", rpy="0 0.5 0"),
)
"""An arm of three joints that has no shapes."""


def written(folder: Path, text: str, name: str = "arm.urdf") -> Path:
    """A file with that text."""
    path = folder / name
    path.write_text(text)
    return path


def snake(folder: Path) -> LoadedRobot:
    """The chain."""
    return load_robot(written(folder, SNAKE))


def panda() -> LoadedRobot:
    """Franka's arm with its hand; skips without the shared models."""
    return shared("panda_description/urdf/panda.urdf", "locked = {panda_finger_joint1 = 0.0}")


def ur10() -> LoadedRobot:
    """Universal Robots' arm; skips without the shared models."""
    return shared("ur_description/urdf/ur10_robot.urdf")


def shared(model: str, lines: str = "") -> LoadedRobot:
    """A robot of the shared models."""
    data = os.environ.get("STEELYARD_DATA")
    path = Path(data or "").parent / "models" / model
    if not data or not path.is_file():
        pytest.skip(f"STEELYARD_DATA has no sibling folder models with {model}")
    return load_robot("robot.toml", text=f"[robot]\nurdf = '{path.resolve()}'\n{lines}\n")


def span(robot: Robot) -> tuple[Array, Array]:
    """Lower and upper positions, within 3 rad or m."""
    limits = [joint.limits for joint in robot.coordinates]
    lower = np.array([max(limit.lower, -3.0) for limit in limits])
    return lower, np.array([min(limit.upper, 3.0) for limit in limits])


def postures(robot: Robot, count: int, seed: int = 0) -> Array:
    """Random positions, shape `(count, n)`."""
    return np.random.default_rng(seed).uniform(*span(robot), (count, robot.n))


def waves(robot: Robot, seed: int, size: float = 0.2, period: float = 10.0) -> FourierMotion:
    """A random motion about the middle of the joints' ranges."""
    lower, upper = span(robot)
    free = np.random.default_rng(seed).normal(size=(robot.n, 8)) * size / 4.0
    return FourierMotion.from_free(0.5 * (lower + upper), free * (upper - lower)[:, None], period)


def distances(robot: Robot, shapes: Sequence[Shape], way: tuple[int, int], q: Array) -> Array:
    """Signed distances of two shapes at positions `(N, n)`, by pinocchio and coal."""
    model = pinocchio_model(robot)
    data = model.createData()
    bodies = [_coal(shapes[k].solid) for k in way]
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance = request.epa_tolerance = 1e-9
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    found = []
    for sample in q:
        pin.forwardKinematics(model, data, body_positions(robot, sample))
        places = []
        for k in way:
            shape = shapes[k]
            carrier = data.oMi[shape.body + 1]
            at = carrier * pin.SE3(np.array(shape.rotation), np.array(shape.position))
            places.append(coal.Transform3s(at.rotation, at.translation))
        result = coal.DistanceResult()
        pairs = (bodies[0], places[0], bodies[1], places[1])
        found.append(coal.distance(*pairs, request, result))
    return np.array(found)


def _coal(solid: Solid) -> coal.ShapeBase:
    """The same solid as coal knows it."""
    if isinstance(solid, Ball):
        return coal.Sphere(solid.radius)
    if isinstance(solid, Box):
        return coal.Box(*solid.size)
    if isinstance(solid, Ellipsoid):
        return coal.Ellipsoid(*solid.semi)
    if isinstance(solid, Cylinder):
        return coal.Cylinder(solid.disc, solid.length)
    if isinstance(solid, Capsule):
        return coal.Capsule(solid.disc, solid.length)
    if isinstance(solid, HalfSpace):
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    assert isinstance(solid, Hull)
    points = coal.StdVec_Vec3s()
    for vertex in solid.vertices:
        points.append(np.array(vertex))
    return coal.Convex.convexHull(points, False, None)
