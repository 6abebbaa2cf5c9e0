"""Collision shapes of robots and cells, as URDF, MJCF, and their STL and OBJ meshes give them."""

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal
from urllib.parse import unquote, urlsplit

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError, listing, refuse_unknown
from steelyard.excite.collision.solids_and_shapes import (
    WITHOUT_MESH_ADVICE,
    Ball,
    Box,
    Capsule,
    Cylinder,
    Geometry,
    Hull,
    Shape,
    Solid,
    placed,
)
from steelyard.excite.constraints.constraint_and_limits import Declined, Gap
from steelyard.robot.file.model_reading_and_loaded_robot import read_mechanism
from steelyard.robot.inertia_and_placement import Placement
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.models.xacro import expand
from steelyard.robot.models.xml_and_urdf import (
    Element,
    number_of,
    numbers_of,
    placement_of,
    read_xml,
)
from steelyard.robot.robot import Frame, Robot

Kind = Literal["collision", "visual"]  # what a URDF gives shapes for


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
    check_links(skip, [link.name for link in mechanism.links], str(model))
    frames = {frame.name: frame for frame in robot.frames}
    root = read_xml(model)
    if root.tag == "mujoco":
        from steelyard.excite.collision.mjcf_geoms_and_solid_distances import mjcf_shapes

        shapes, never, outside = mjcf_shapes(model, frames, skip)
    else:
        links = root.all("link")
        kept = {name: frame for name, frame in frames.items() if name not in skip}
        shapes = tuple(s for link in links for s in _shapes(link, kept, model))
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


def world_shapes(path: Path) -> tuple[Shape, ...]:
    """The shapes of a cell that stands still, from a URDF or MJCF.

    Its root frame is the robot's base frame; what could move stands where its joints are at zero,
    or at the limit nearest to it.
    """
    if expansion := expand(path, {}):
        path = expansion.path
    root = read_xml(path)
    if root.tag == "mujoco":
        from steelyard.excite.collision.mjcf_geoms_and_solid_distances import mjcf_world

        shapes = mjcf_world(path)
    else:
        mechanism = read_mechanism(path)
        frames = dict[str, Frame]()
        for link in mechanism.links:
            placement = Placement()
            for joint in mechanism.to_link(link.name):
                rest = float(np.clip(0.0, joint.limits.lower, joint.limits.upper))
                placement = placement @ joint.at(rest)
            frames[link.name] = Frame(link.name, -1, placement.rotation, placement.position)
        shapes = tuple(
            replace(shape, origin="world")
            for link in root.all("link")
            for shape in _shapes(link, frames, path)
        )
    if not shapes:
        raise ModelError(
            "the cell's file holds no collision shape",
            where=str(path),
            fix="give a file with <collision> elements (URDF) or colliding geoms (MJCF)",
        )
    return shapes


def check_links(skip: Collection[str], links: Collection[str], where: str) -> None:
    """Refuse a link to be left out that does not exist."""
    for name in skip:
        refuse_unknown(name, links, f"there is no link '{name}' to skip", where, "links")


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
        from steelyard.excite.collision.mjcf_geoms_and_solid_distances import mjcf_shapes

        with suppress(ModelError):
            every = mjcf_shapes(model, frames, ())[0] if kind == "collision" else ()
            found += [shape for shape in every if shape.name in links]
        return tuple(found)
    for link in root.all("link"):
        if link.attributes["name"].strip() in links:
            with suppress(ModelError):
                found += _shapes(link, frames, model, kind=kind)
    return tuple(found)


def _shapes(
    link: Element, frames: dict[str, Frame], model: Path, kind: Kind = "collision"
) -> list[Shape]:
    """The shapes of one link of a URDF, to collide with or to be seen."""
    name = link.attributes["name"].strip()
    if name not in frames:
        return []
    shapes = []
    for collision in link.all(kind):
        at, solid = placement_of(collision), _solid(collision, name, model)
        shapes.append(placed(frames[name], name, solid, at.position, at.rotation))
    return shapes


_SOLIDS: Mapping[str, Callable[[Element], Solid]] = {
    "box": lambda box: Box(tuple(numbers_of(box, "size", 3))),
    "sphere": lambda ball: Ball(number_of(ball, "radius")),
    "cylinder": lambda rod: Cylinder(number_of(rod, "radius"), number_of(rod, "length")),
    "capsule": lambda rod: Capsule(number_of(rod, "radius"), number_of(rod, "length")),
}


def _solid(collision: Element, link: str, model: Path) -> Solid:
    found = [child for geometry in collision.all("geometry") for child in geometry.children]
    if len(found) != 1:
        raise ModelError(
            f"a collision of link '{link}' has {len(found)} shapes",
            where=collision.where,
            fix="write one <geometry> with one shape into each <collision>",
        )
    element = found[0]
    try:
        if element.tag == "mesh":
            return _mesh(element, link, model)
        if element.tag in _SOLIDS:
            return _SOLIDS[element.tag](element)
    except ValueError as error:
        raise ModelError(str(error), where=element.where, fix="give lengths above zero") from None
    raise ModelError(
        f"link '{link}' has a collision shape <{element.tag}>, which is unknown",
        where=element.where,
        fix=listing([*_SOLIDS, "mesh"], "shapes") + f"; or {WITHOUT_MESH_ADVICE}",
    )


def _mesh(element: Element, link: str, model: Path) -> Hull:
    name = element.attributes.get("filename", "").strip()
    path = find_mesh(name, model) if name else None
    if path is None:
        raise ModelError(
            f"the collision mesh '{name}' of link '{link}' does not exist",
            where=element.where,
            fix="put the file where the model names it (a package:// path is looked for in the "
            f"model's folder and those above it), or {WITHOUT_MESH_ADVICE}",
        )
    x, y, z = numbers_of(element, "scale", 3) if "scale" in element.attributes else [1.0] * 3
    return _hull(path, path.stat().st_mtime_ns, (x, y, z), f"{element.where} of link '{link}'")


@lru_cache(maxsize=256)
def _hull(path: Path, changed: int, scale: tuple[float, float, float], where: str) -> Hull:
    """The hull of a mesh's file as it was when it changed last."""
    return Hull(mesh_points(path, where) * scale)


_STL_HEAD_BYTES = 84
_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def find_mesh(name: str, model: Path) -> Path | None:
    """The file that a model means by a mesh's name, or none.

    A name is absolute, relative to the model's folder, or `package://PACKAGE/...`. A package is
    looked for by its name in the model's folder and in those above it, then with leading parts of
    the path left out, but for the file's own folder.
    """
    url = urlsplit(name)
    folder = model.resolve().parent
    if url.scheme in ("package", "model"):
        parts = [part for part in name.split("://", 1)[1].split("/") if part]
        ends = [parts[first:] for first in range(max(len(parts) - 1, 1))]
        places = [above.joinpath(*end) for end in ends for above in (folder, *folder.parents)]
    else:
        places = [Path(unquote(url.path)) if url.scheme == "file" else folder / name]
    return next((path for path in places if path.is_file()), None)


def mesh_points(path: Path, where: str) -> Array:
    """All corners of the faces of an STL or OBJ file, shape `(V, 3)`, each once."""
    if path.suffix.lower() not in (".stl", ".obj"):
        raise ModelError(
            f"the mesh '{path}' is of an unsupported format ('{path.suffix}')",
            where=where,
            fix=f"convert it to .stl or .obj and name that file, or {WITHOUT_MESH_ADVICE}",
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        wrong = f"the mesh '{path}' cannot be read: {error.strerror}"
        raise ModelError(wrong, where=where, fix="check its permissions") from None
    try:
        points = _stl(data) if path.suffix.lower() == ".stl" else _numbers_of_obj(data, b"v")
        what = "a vertex is not finite" if len(points) else "it has no vertices"
    except (ValueError, IndexError) as error:
        points, what = np.empty((0, 3)), str(error)
    if not len(points) or not np.isfinite(points).all():
        raise ModelError(
            f"the mesh '{path}' is not an {path.suffix[1:].upper()} file: {what}",
            where=where,
            fix=f"export it anew from a program that opens it, or {WITHOUT_MESH_ADVICE}",
        )
    return np.unique(points, axis=0)


def _stl(data: bytes) -> Array:
    count = int.from_bytes(data[_STL_HEAD_BYTES - 4 : _STL_HEAD_BYTES], "little")
    if len(data) == _STL_HEAD_BYTES + _STL_FACET.itemsize * count:
        facets = np.frombuffer(data, _STL_FACET, offset=_STL_HEAD_BYTES)
        return facets["corners"].reshape(-1, 3).astype(np.float64)
    if not data.lstrip().startswith(b"solid"):
        raise ValueError("its length does not fit its number of facets")
    return _numbers_of_obj(data, b"vertex")


def _numbers_of_obj(data: bytes, word: bytes) -> Array:
    """Three numbers after a word at the start of lines."""
    lines = (line.split() for line in data.splitlines())
    rows = [[float(w) for w in words[1:4]] for words in lines if words and words[0] == word]
    if any(len(row) != 3 for row in rows):
        raise ValueError("a vertex does not have three numbers")
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
