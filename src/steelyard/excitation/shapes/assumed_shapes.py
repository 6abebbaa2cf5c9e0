r"""Shapes for links that a model gives none: capsules from the geometry of the joints.

A link reaches from its joint to the joints and frames that it carries and, where its mass is known,
to twice its centre of mass, as an even rod does. The radius is that of the even cylinder with the
link's least moment of inertia, $r = \sqrt{2 I / m}$, or a share of the robot's reach.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.shapes.shapes import Origin, Shape
from steelyard.excitation.shapes.solids import Ball, Capsule
from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import Frame, Robot

SLENDER = 0.05
"""Radius of a link of unknown mass, over the length of the robot from base to end."""

WIDEST = 3.0
"""Radii from inertias stay within this factor of that, either way."""

SHORT = 1e-3
"""Reaches below this [m] are those of frames in one place."""


@dataclass(frozen=True, eq=False)
class LinkTree:
    """The links of a robot, whether they move or are merged into others.

    Attributes:
        frames: Where each link is.
        parents: The link that carries a link, for all but the root.
        inertias: Of links whose mass is known, in their own frames.
    """

    frames: Mapping[str, Frame]
    parents: Mapping[str, str]
    inertias: Mapping[str, Inertia]


def assumed_shapes(
    robot: Robot, links: LinkTree, shaped: Collection[str], ends: Mapping[str, Sequence[Array]]
) -> tuple[Shape, ...]:
    """Capsules and balls for moving links without shapes that must have some.

    Those are links with a mass, and links that carry a joint, a real link, or one of `ends`.

    Args:
        robot: The robot.
        links: Its links.
        shaped: Links that have shapes, or are to go without.
        ends: Frames that something real is fixed to, such as the tool's, and where on their
            bodies, each of shape `(3,)` [m]; a link that is more than a frame reaches there.
    """
    real = _carrying(robot, links, {*shaped, *links.inertias, *ends})
    usual, bodies = SLENDER * reach(robot), {body.name for body in robot.bodies}
    found = []
    for name, frame in links.frames.items():
        if frame.body >= 0 and name in real and name not in shaped:
            more = ends.get(name, ()) if name in bodies else ()
            found += _link_shapes(robot, links, name, real, usual, more)
    return tuple(found)


def reach(robot: Robot) -> float:
    """Greatest length from the base over joint after joint to an end, slides at their longest."""
    lengths = np.zeros(len(robot.bodies) + 1)
    for k, body in enumerate(robot.bodies):
        span = max(float(np.linalg.norm(end)) for end in _origins(robot, k))
        lengths[k + 1] = lengths[body.parent + 1] + span
    tips = [lengths[f.body + 1] + float(np.linalg.norm(f.position)) for f in robot.frames]
    return float(max([*lengths, *tips]))


def _origins(robot: Robot, number: int) -> list[Array]:
    """Where a body's origin may be in its parent's frame: once, or at both ends of a slide."""
    body = robot.bodies[number]
    if body.kind == "revolute":
        return [body.position]
    limits = robot.joints[body.coordinate].limits
    ends = [body.ratio * x + body.offset for x in (limits.lower, limits.upper) if np.isfinite(x)]
    return [body.position + body.rotation @ body.axis * x for x in ends or [0.0]]


def _carrying(robot: Robot, links: LinkTree, real: Collection[str]) -> set[str]:
    """Real links, links that joints move, and all that carry them."""
    found = set[str]()
    for name in (*real, *(body.name for body in robot.bodies)):
        link: str | None = name
        while link is not None and link not in found:
            found.add(link)
            link = links.parents.get(link)
    return found


def _link_shapes(
    robot: Robot,
    links: LinkTree,
    name: str,
    real: Collection[str],
    usual: float,
    more: Sequence[Array],
) -> list[Shape]:
    """A capsule to every end of a link; a ball at its origin if it has a mass and no end."""
    frame, inertia = links.frames[name], links.inertias.get(name)
    radius = usual if inertia is None else _radius(inertia, usual)
    children = _children(links, name, real)
    ends = [*more, *(x for child in children for x in _places(robot, links, child))]
    if inertia is not None and inertia.mass > 0.0:
        ends.append(frame.position + frame.rotation @ (2.0 * inertia.com))
    own = [rod(name, frame, end, radius) for end in ends if _apart(end, frame.position)]
    if own or inertia is None:
        return own
    return [Shape(name, frame.body, np.eye(3), frame.position, Ball(radius))]


def _children(links: LinkTree, name: str, real: Collection[str]) -> list[str]:
    return [c for c, p in links.parents.items() if p == name and c in real and c in links.frames]


def _places(robot: Robot, links: LinkTree, child: str) -> list[Array]:
    """Where a child link begins, in the frame of the body that carries it."""
    for number, body in enumerate(robot.bodies):
        if body.name == child:
            return _origins(robot, number)
    return [links.frames[child].position]


def _apart(first: Array, second: Array) -> bool:
    return float(np.linalg.norm(first - second)) > SHORT


def _radius(inertia: Inertia, usual: float) -> float:
    """Of the even cylinder about the axis of least moment, within reason."""
    least = float(np.linalg.eigvalsh(inertia.inertia_com)[0])
    own = np.sqrt(2.0 * max(least, 0.0) / inertia.mass) if inertia.mass > 0.0 else 0.0
    return float(np.clip(own, usual / WIDEST, usual * WIDEST))


def rod(name: str, frame: Frame, end: Array, radius: float, origin: Origin = "link") -> Shape:
    """A capsule from a frame's origin to a place, both in the frame of the body."""
    way = end - frame.position
    length = float(np.linalg.norm(way))
    middle, turned = 0.5 * (frame.position + end), along(way / length)
    return Shape(name, frame.body, turned, middle, Capsule(radius, length), origin)


def along(z: Array) -> Array:
    """Axes whose third one is the unit vector `z`, shape `(3, 3)`."""
    side = np.eye(3)[np.argmin(np.abs(z))]
    x = np.cross(side, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
