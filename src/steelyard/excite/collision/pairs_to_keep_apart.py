"""Pairs of bodies that must keep clear of each other, and which of them can be kept apart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.excite.collision.solids_and_shapes import Geometry, Hull, Shape
from steelyard.report.words import count
from steelyard.robot.models.xml_and_urdf import Element, read_root, read_xml
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class Pair:
    """Two things that may touch, by name, and numbers of their shapes, one each in every way."""

    first: str
    second: str
    shapes: tuple[tuple[int, int], ...]

    @property
    def names(self) -> frozenset[str]:
        """Both names."""
        return frozenset((self.first, self.second))


def candidate_pairs(
    robot: Robot,
    geometry: Geometry,
    shapes: Sequence[Shape],
    ignore: Sequence[tuple[str, str]] = (),
    bodies: bool = True,
) -> tuple[tuple[Pair, ...], tuple[str, ...], int]:
    """All pairs that move against each other, less those that may touch.

    Also notes on these and their number. Links may touch where the model says so, and where a
    joint, or several in one place, connects their bodies and no third link with shapes lies
    between. Names of pairs to `ignore`: `cell: NAME` is what the cell calls by a name that is
    taken. Without `bodies` only pairs with the cell count.
    """
    groups = _groups(shapes)
    _check_names(groups, shapes, ignore)
    ignored = {frozenset(pair) for pair in ignore}
    names, pairs = list(groups), list[Pair]()
    near, modelled, specified = (
        "links connected by a joint",
        "which may touch according to the model or its SRDF",
        "which may touch as specified",
    )
    left: dict[str, list[str]] = {near: [], modelled: [], specified: []}
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            both = frozenset((first, second))
            mine, theirs = groups[first], groups[second]
            # two shapes move against each other, and one of them ends
            ways = tuple(
                (i, j)
                for i in mine
                for j in theirs
                if shapes[i].body != shapes[j].body and not (shapes[i].flat and shapes[j].flat)
            )
            origins = {shapes[mine[0]].origin, shapes[theirs[0]].origin}
            links = origins == {"link"}
            if not ways or not (bodies or "world" in origins):
                continue
            pair = f"{first} and {second}"
            if both in ignored:
                left[specified].append(pair)
            elif links and both in geometry.never:
                left[modelled].append(pair)
            elif links and _neighbours(robot, geometry, shapes[mine[0]], shapes[theirs[0]]):
                left[near].append(pair)
            else:
                pairs.append(Pair(first, second, ways))
    notes = tuple(
        f"clearance is not checked for {count(len(some), 'pair')}, {why}: {', '.join(some)}"
        for why, some in left.items()
        if some
    )
    return tuple(pairs), notes, sum(map(len, left.values()))


def _groups(shapes: Sequence[Shape]) -> dict[str, list[int]]:
    """Numbers of the shapes by name; what the cell calls like something else is `cell: NAME`."""
    taken = {shape.name for shape in shapes if shape.origin != "world"}
    names = (
        f"cell: {s.name}" if s.origin == "world" and s.name in taken else s.name for s in shapes
    )
    return by_key((name, number) for number, name in enumerate(names))


def _check_names(
    groups: Mapping[str, list[int]], shapes: Sequence[Shape], ignore: Sequence[tuple[str, str]]
) -> None:
    for name, members in groups.items():
        if len({(shapes[k].origin, shapes[k].body) for k in members}) > 1:
            raise ModelError(
                f"two bodies are called '{name}'",
                where=f"collision shapes, '{name}'",
                fix="give tools and payloads names that no link has",
            )
    for pair in ignore:
        for name in pair:
            wrong = f"'{name}', which is to be ignored, has no collision shape"
            where = f"ignored pair '{pair[0]}', '{pair[1]}'"
            refuse_unknown(name, groups, wrong, where, "bodies with shapes")


def _neighbours(robot: Robot, geometry: Geometry, first: Shape, second: Shape) -> bool:
    """Whether a joint connects two links, or several in one place, and no shape lies between."""
    inner, outer = sorted((first.body, second.body))
    carrier = robot.bodies[outer].parent
    # a link with several joints is a chain of bodies that are nothing but frames
    while carrier > inner and (robot.bodies[carrier].massless or not robot.bodies[carrier].known):
        carrier = robot.bodies[carrier].parent
    if carrier != inner:
        return False
    ways = ([first.name], [second.name])
    for links in ways:
        while links[-1] in geometry.parents:
            links.append(geometry.parents[links[-1]])
    way, other = ways
    shared = set(way) & set(other)
    meet = next(name for name in way if name in shared)
    between = [*way[: way.index(meet) + 1], *other[: other.index(meet)]]
    shaped = {shape.name for shape in geometry.shapes} | geometry.skipped
    return not shaped & (set(between) - {first.name, second.name})


def find_srdf(model: Path, given: Path | None = None) -> Path | None:
    """The SRDF of a URDF: in its folder or in `srdf` beside it, for a robot of the same name.

    The folder is that of `given`, the file that the URDF was expanded from, if it was.
    """
    name = read_xml(model).attributes.get("name")
    folder = (given or model).resolve().parent
    places = [*folder.glob("*.srdf"), *(folder.parent / "srdf").glob("*.srdf")]
    for path in sorted(places, key=lambda p: (p.stem != model.stem, str(p))):
        if name and _srdf(path).attributes.get("name") == name:
            return path
    return None


def disabled_pairs(path: Path) -> frozenset[frozenset[str]]:
    """Pairs of links that an SRDF lets touch."""
    pairs = set()
    for element in _srdf(path).all("disable_collisions"):
        links = [element.attributes.get(key, "").strip() for key in ("link1", "link2")]
        if not all(links):
            raise ModelError(
                "<disable_collisions> does not name two links",
                where=element.where,
                fix='write <disable_collisions link1="..." link2="..."/>',
            )
        pairs.add(frozenset(links))
    return frozenset(pairs)


def _srdf(path: Path) -> Element:
    fix = "give an SRDF (<robot> with <disable_collisions> elements)"
    return read_root(path, "robot", "an SRDF", fix)


SEPARABLE_POSTURES = 200  # random postures that decide which pairs can be kept apart at all

_WHERE = "collision of the robot with its cell"


def random_postures(robot: Robot) -> Array:
    """`SEPARABLE_POSTURES` positions within the joints' limits, or within one turn or a metre."""
    rng = np.random.default_rng(0)
    bounds = np.empty((2, robot.n))
    for k, joint in enumerate(robot.coordinates):
        span = np.pi if joint.kind == "revolute" else 1.0
        bounds[0, k] = joint.limits.lower if np.isfinite(joint.limits.lower) else -span
        bounds[1, k] = joint.limits.upper if np.isfinite(joint.limits.upper) else span
    return rng.uniform(bounds.min(axis=0), bounds.max(axis=0), (SEPARABLE_POSTURES, robot.n))


def separable(
    shapes: Sequence[Shape], pairs: Sequence[Pair], farthest: Array, margin: float
) -> tuple[tuple[Pair, ...], Array, tuple[str, ...]]:
    """The pairs that can be kept apart, how far, `(k,)` [m], and notes on those that cannot.

    Links on the fixed base make no pairs with the cell, so whatever does can move. `farthest` are
    the greatest distances that were seen, `(k,)` [m].

    Raises:
        ModelError: The cell overlaps a link in every posture, or is never `margin` away.
    """
    close = [(pair, float(d)) for pair, d in zip(pairs, farthest, strict=True) if d < margin]
    _refuse_inseparable(shapes, close, margin)
    near = {pair.names: distance for pair, distance in close}
    kept = tuple(pair for pair in pairs if near.get(pair.names, 0.0) >= 0.0)
    wanted = np.array([0.0 if pair.names in near else margin for pair in kept])
    stuck = [f"{p.first} and {p.second}" for p, d in close if d < 0.0]
    touching = [
        f"{p.first} and {p.second} (at most {_rounded_down(d)} m)" for p, d in close if d >= 0.0
    ]
    notes = []
    if stuck:
        how = "overlap in every tested posture, so they are left out"
        notes.append(f"these pairs {how}: {', '.join(stuck)}")
    if touching:
        how = f"are never {margin:g} m apart, so only contact is avoided"
        notes.append(f"these pairs {how}: {', '.join(touching)}")
    return kept, wanted, tuple(notes)


def _refuse_inseparable(
    shapes: Sequence[Shape], close: Sequence[tuple[Pair, float]], margin: float
) -> None:
    """Pairs with the cell, if they cannot be kept apart."""
    cell = []
    for pair, distance in close:
        for name, k in zip((pair.first, pair.second), pair.shapes[0], strict=True):
            if shapes[k].origin == "world":
                cell.append((pair, distance, name))
    inside = [(pair, name) for pair, distance, name in cell if distance < 0.0]
    if inside:
        pair, name = inside[0]
        own = {way[pair.second == name] for way in pair.shapes}
        hull = any(isinstance(shapes[k].solid, Hull) for k in own)
        other = ", ".join(f"'{x}'" for p, n in inside if n == name for x in p.names - {n})
        first = "split it into convex pieces" if hull else f"place '{name}' elsewhere"
        raise ModelError(
            f"'{name}' overlaps {other} in every posture tried"
            + (": a mesh counts as its convex hull" if hull else ""),
            where=_WHERE,
            fix=f"{first}, or name the pair in ignore: [{pair.first!r}, {pair.second!r}]",
        )
    if cell:
        pair, distance, _ = min(cell, key=lambda one: one[1])
        raise ModelError(
            f"'{pair.first}' and '{pair.second}' are never {margin:g} m apart: the largest "
            f"possible margin in {SEPARABLE_POSTURES} random postures is "
            f"{_rounded_down(distance)} m",
            where=_WHERE,
            fix=f"give a margin of {_rounded_down(distance)} m or less, move the object in the "
            "cell, or name the pair in ignore",
        )


def _rounded_down(distance: float) -> str:
    return f"{np.floor(max(distance, 0.0) * 1e4) / 1e4:g}"
