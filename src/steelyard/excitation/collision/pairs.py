"""Which pairs of things must keep clear of each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import ModelError
from steelyard.excitation.shapes.shapes import Geometry, Shape
from steelyard.excitation.shapes.solids import HalfSpace
from steelyard.robot.robot import Body, Robot
from steelyard.robot.xml_reader import Element, read_xml
from steelyard.suggest import advice


@dataclass(frozen=True)
class Pair:
    """Two things that may touch.

    Attributes:
        first: Name of a link, tool or obstacle.
        second: Name of another.
        shapes: Numbers of their shapes, one of each in every way.
    """

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

    Links may touch where the model says so, and where a joint, or several in one place, connects
    their bodies and no third link with shapes lies between.

    Args:
        robot: The robot.
        geometry: The robot's own shapes.
        shapes: All shapes: the robot's, tools and the cell.
        ignore: Pairs of names that may touch; `cell: NAME` is what the cell calls by a name that
            is taken.
        bodies: Whether pairs count that are no part of the cell.

    Returns:
        The pairs, notes on those left out, and how many these are.

    Raises:
        ModelError: A name in `ignore` does not exist, or two things have one name.
    """
    groups = _groups(shapes)
    _check(groups, shapes, ignore)
    ignored = {frozenset(pair) for pair in ignore}
    names, pairs = list(groups), list[Pair]()
    modelled, near, specified = list[str](), list[str](), list[str]()
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            both = frozenset((first, second))
            mine, theirs = groups[first], groups[second]
            ways = tuple((i, j) for i in mine for j in theirs if _can_touch(shapes[i], shapes[j]))
            origins = {shapes[mine[0]].origin, shapes[theirs[0]].origin}
            links = origins == {"link"}
            if not ways or not (bodies or "world" in origins):
                continue
            pair = f"{first} and {second}"
            if both in ignored:
                specified.append(pair)
            elif links and both in geometry.never:
                modelled.append(pair)
            elif links and _neighbours(robot, geometry, shapes[mine[0]], shapes[theirs[0]]):
                near.append(pair)
            else:
                pairs.append(Pair(first, second, ways))
    reasons = {
        "links connected by a joint": near,
        "which may touch according to the model or its SRDF": modelled,
        "which may touch as specified": specified,
    }
    notes = tuple(
        f"clearance is not checked for {len(left)} pair{'s' * (len(left) > 1)}, {why}: "
        f"{', '.join(left)}"
        for why, left in reasons.items()
        if left
    )
    return tuple(pairs), notes, len(near) + len(modelled) + len(specified)


def _groups(shapes: Sequence[Shape]) -> dict[str, list[int]]:
    """Numbers of the shapes by name; what the cell calls like something else is `cell: NAME`."""
    taken = {shape.name for shape in shapes if shape.origin != "world"}
    groups: dict[str, list[int]] = {}
    for number, shape in enumerate(shapes):
        clashes = shape.origin == "world" and shape.name in taken
        name = f"cell: {shape.name}" if clashes else shape.name
        groups.setdefault(name, []).append(number)
    return groups


def _check(
    groups: Mapping[str, list[int]],
    shapes: Sequence[Shape],
    ignore: Sequence[tuple[str, str]],
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
            if name not in groups:
                raise ModelError(
                    f"'{name}', which is to be ignored, has no collision shape",
                    where=f"ignored pair '{pair[0]}', '{pair[1]}'",
                    fix=advice(name, groups, "bodies with shapes"),
                )


def _can_touch(first: Shape, second: Shape) -> bool:
    """Whether two shapes move against each other, and one of them ends."""
    planes = isinstance(first.solid, HalfSpace) and isinstance(second.solid, HalfSpace)
    return first.body != second.body and not planes


def _neighbours(robot: Robot, geometry: Geometry, first: Shape, second: Shape) -> bool:
    """Whether a joint connects two links, or several in one place, and no shape lies between."""
    inner, outer = sorted((first.body, second.body))
    carrier = robot.bodies[outer].parent
    # a link with several joints is a chain of bodies that are nothing but frames
    while carrier > inner and _only_a_frame(robot.bodies[carrier]):
        carrier = robot.bodies[carrier].parent
    if carrier != inner:
        return False
    way, other = (_ancestry(geometry.parents, shape.name) for shape in (first, second))
    shared = set(way) & set(other)
    meet = next(name for name in way if name in shared)
    between = [*way[: way.index(meet) + 1], *other[: other.index(meet)]]
    shaped = {shape.name for shape in geometry.shapes} | geometry.skipped
    return not shaped & (set(between) - {first.name, second.name})


def _only_a_frame(body: Body) -> bool:
    return body.massless or not body.known


def _ancestry(parents: Mapping[str, str], link: str) -> list[str]:
    """A link and all that carry it."""
    way = [link]
    while way[-1] in parents:
        way.append(parents[way[-1]])
    return way


def find_srdf(model: Path, given: Path | None = None) -> Path | None:
    """The SRDF of a URDF: in its folder or in `srdf` beside it, for a robot of the same name.

    Args:
        model: The URDF.
        given: The file it was expanded from, if it was: its folder is the one.
    """
    name = read_xml(model).attributes.get("name")
    folder = (given or model).resolve().parent
    places = [*folder.glob("*.srdf"), *(folder.parent / "srdf").glob("*.srdf")]
    for path in sorted(places, key=lambda p: (p.stem != model.stem, str(p))):
        if name and _srdf(path).attributes.get("name") == name:
            return path
    return None


def disabled_pairs(path: Path) -> frozenset[frozenset[str]]:
    """Pairs of links that an SRDF lets touch.

    Raises:
        ModelError: The file is no SRDF.
    """
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
    """The outermost element of an SRDF."""
    root = read_xml(path)
    if root.tag != "robot":
        raise ModelError(
            f"the file is not an SRDF: its outermost element is <{root.tag}>",
            where=root.where,
            fix="give an SRDF (<robot> with <disable_collisions> elements)",
        )
    return root
