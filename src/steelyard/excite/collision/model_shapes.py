"""Collision shapes as URDF and MJCF files give them, of robots and of cells."""

import math
from collections.abc import Collection
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError, advice, listing
from steelyard.excite.collision.shapes import Geometry, Shape, placed
from steelyard.excite.collision.solids import (
    WITHOUT_MESH_ADVICE,
    Ball,
    Box,
    Capsule,
    Cylinder,
    Hull,
    Solid,
    find_mesh,
    mesh_points,
)
from steelyard.excite.constraints.constraint import Declined, Gap
from steelyard.robot.file.loaded_robot import read_mechanism
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.models.xacro import expand
from steelyard.robot.models.xml_reader import Element, read_xml
from steelyard.robot.rigid_body import Placement, rpy_rotation
from steelyard.robot.robot import Frame, Robot

Kind = Literal["collision", "visual"]
"""What a URDF gives shapes for."""


def robot_shapes(robot: Robot, model: Path, skip: Collection[str] = ()) -> Geometry:
    """The collision shapes that a robot's model file, URDF or MJCF, gives its links but `skip`.

    Fixed and locked links' shapes go to the body that their links merged into. Meshes become
    their convex hulls.
    """
    if robot.loops:
        raise ModelError(
            "clearances are not supported for a robot with closed chains",
            where=f"robot '{robot.name}'",
            fix="leave collision out for this robot, and bound its joints instead",
        )
    mechanism = read_mechanism(model)
    _check_links(skip, mechanism, model)
    frames = {frame.name: frame for frame in robot.frames}
    root = read_xml(model)
    if root.tag == "mujoco":
        from steelyard.excite.collision.mujoco_geometry import mjcf_shapes

        shapes, never, outside = mjcf_shapes(model, frames, skip)
    else:
        links = root.all("link")
        shapes = tuple(s for link in links for s in _shapes(link, frames, model, skip))
        never, shaped = frozenset(), [k for k in links if k.all("collision")]
        outside = frozenset(k.attributes["name"].strip() for k in shaped) - frames.keys()
    if not shapes:
        raise ModelError(
            "the model gives no link of the robot a collision shape",
            where=str(model),
            fix="give a model with <collision> elements (URDF) or colliding geoms (MJCF), or "
            "leave collision out",
        )
    parents = {joint.child: joint.parent for joint in mechanism.joints}
    notes = _notes(mechanism, frames, shapes, outside, skip)
    return Geometry(shapes, parents, never, frozenset(skip), notes)


def world_shapes(path: Path, skip: Collection[str] = ()) -> tuple[Shape, ...]:
    """The shapes of a cell that stands still, from a URDF or MJCF, but for the links `skip`.

    Its root frame is the robot's base frame; what could move stands where its joints are at zero,
    or at the limit nearest to it.
    """
    if expansion := expand(path, {}):
        path = expansion.path
    root = read_xml(path)
    if root.tag == "mujoco":
        from steelyard.excite.collision.mujoco_geometry import mjcf_world

        shapes = mjcf_world(path, skip)
    else:
        mechanism = read_mechanism(path)
        _check_links(skip, mechanism, path)
        frames = dict[str, Frame]()
        for link in mechanism.links:
            placement = Placement()
            for joint in mechanism.to_link(link.name):
                rest = float(np.clip(0.0, joint.limits.lower, joint.limits.upper))
                placement = placement @ joint.at(rest)
            frames[link.name] = Frame(link.name, -1, placement.rotation, placement.position)
        shapes = tuple(
            Shape(s.name, -1, s.rotation, s.position, s.solid, "world")
            for element in root.all("link")
            for s in _shapes(element, frames, path, skip)
        )
    if not shapes:
        raise ModelError(
            "the cell's file holds no collision shape",
            where=str(path),
            fix="give a file with <collision> elements (URDF) or colliding geoms (MJCF)",
        )
    return shapes


def _check_links(skip: Collection[str], mechanism: Mechanism, path: Path) -> None:
    names = [link.name for link in mechanism.links]
    for name in skip:
        if name not in names:
            raise ModelError(
                f"the link '{name}' to be skipped does not exist",
                where=str(path),
                fix=advice(name, names, "links"),
            )


def _notes(
    mechanism: Mechanism,
    frames: Collection[str],
    shapes: tuple[Shape, ...],
    outside: Collection[str],
    skip: Collection[str],
) -> tuple[str, ...]:
    """Links that clearances know nothing of; those outside the robot count if they have shapes."""
    shaped = {shape.name for shape in shapes}
    notes = list[str]()
    if skip:
        notes.append(
            Declined(f"no clearance is kept for the links {', '.join(skip)}, as specified")
        )
    heavy = [k.name for k in mechanism.links if k.inertia is not None and k.inertia.mass > 0.0]
    bare = [name for name in heavy if name in frames and name not in shaped and name not in skip]
    if bare:
        text = f"no collision shape in the model, so no clearance is kept for: {', '.join(bare)}"
        notes.append(Gap(text))
    if outside:
        left = ", ".join(k.name for k in mechanism.links if k.name in outside)
        notes.append(Gap(f"not attached to the base, so left out: {left}"))
    return tuple(notes)


def readable_shapes(
    robot: Robot, model: Path, links: Collection[str], kind: Kind = "collision"
) -> tuple[Shape, ...]:
    """The shapes of some links, of those whose shapes can all be read; an MJCF draws none."""
    root, frames = read_xml(model), {frame.name: frame for frame in robot.frames}
    found = list[Shape]()
    if root.tag == "mujoco":
        from steelyard.excite.collision.mujoco_geometry import mjcf_shapes

        with suppress(ModelError):
            every = mjcf_shapes(model, frames, ())[0] if kind == "collision" else ()
            found += [shape for shape in every if shape.name in links]
        return tuple(found)
    for link in root.all("link"):
        if link.attributes["name"].strip() in links:
            with suppress(ModelError):
                found += _shapes(link, frames, model, (), kind)
    return tuple(found)


def _shapes(
    link: Element,
    frames: dict[str, Frame],
    model: Path,
    skip: Collection[str],
    kind: Kind = "collision",
) -> list[Shape]:
    """The shapes of one link of a URDF, to collide with or to be seen."""
    name = link.attributes["name"].strip()
    if name in skip or name not in frames:
        return []
    shapes = []
    for collision in link.all(kind):
        position, rotation = np.zeros(3), np.eye(3)
        for origin in collision.all("origin"):
            position = _vector(origin, "xyz", 3)
            rotation = rpy_rotation(*_vector(origin, "rpy", 3))
        solid = _solid(collision, name, model)
        shapes.append(placed(frames[name], name, solid, position, rotation))
    return shapes


def _solid(collision: Element, link: str, model: Path) -> Solid:
    """The solid of a `<collision>`."""
    found = [child for geometry in collision.all("geometry") for child in geometry.children]
    if len(found) != 1:
        raise _refused(
            f"a collision of link '{link}' has {len(found)} shapes",
            collision,
            "write one <geometry> with one shape into each <collision>",
        )
    element = found[0]
    try:
        if element.tag == "mesh":
            return _mesh(element, link, model)
        if element.tag == "box":
            x, y, z = _vector(element, "size", 3)
            return Box((float(x), float(y), float(z)))
        if element.tag == "sphere":
            return Ball(_number(element, "radius"))
        if element.tag in ("cylinder", "capsule"):
            kind = Cylinder if element.tag == "cylinder" else Capsule
            return kind(_number(element, "radius"), _number(element, "length"))
    except ValueError as error:
        raise _refused(str(error), element, "give lengths above zero") from None
    known = ["box", "sphere", "cylinder", "capsule", "mesh"]
    raise _refused(
        f"link '{link}' has a collision shape <{element.tag}>, which is unknown",
        element,
        listing(known, "shapes") + f"; or {WITHOUT_MESH_ADVICE}",
    )


def _mesh(element: Element, link: str, model: Path) -> Hull:
    """The hull of a mesh."""
    name = element.attributes.get("filename", "").strip()
    path = find_mesh(name, model) if name else None
    if path is None:
        raise _refused(
            f"the collision mesh '{name}' of link '{link}' does not exist",
            element,
            "put the file where the model names it (a package:// path is looked for in the "
            f"model's folder and those above it), or {WITHOUT_MESH_ADVICE}",
        )
    scale = _vector(element, "scale", 3) if "scale" in element.attributes else np.ones(3)
    x, y, z = (float(factor) for factor in scale)
    return _hull(path, path.stat().st_mtime_ns, (x, y, z), f"{element.where} of link '{link}'")


@lru_cache(maxsize=256)
def _hull(path: Path, changed: int, scale: tuple[float, float, float], where: str) -> Hull:
    """The hull of a mesh's file as it was when it changed last."""
    return Hull(mesh_points(path, where) * scale)


def _vector(element: Element, attribute: str, count: int) -> Array:
    """Numbers of an attribute, shape `(count,)`; zeros without it, where it may lack."""
    text = element.attributes.get(attribute)
    if text is None and attribute in ("xyz", "rpy"):
        return np.zeros(count)
    try:
        values = [float(word) for word in (text or "").split()]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(v) for v in values):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise _refused(
            f"{attribute}={text!r} of <{element.tag}> is not {wanted}",
            element,
            f'write {attribute}="' + " ".join(["1.0"] * count) + '" with your values',
        )
    return np.array(values)


def _number(element: Element, attribute: str) -> float:
    return float(_vector(element, attribute, 1)[0])


def _refused(wrong: str, element: Element, fix: str) -> ModelError:
    return ModelError(wrong, where=element.where, fix=fix)
