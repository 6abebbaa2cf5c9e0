r"""Collision shapes fixed to bodies: where they are, and how fast their distances can change.

The distance $s$ of two solids on bodies $a$ and $b$ changes at the rate
$n \cdot (v_b - v_a)$ of their nearest points, whose difference is along $n$. A revolute joint
between $a$ and $b$ contributes $\dot x\, n \cdot (w \times p)$ for any point $p$ on that line, so
at most $|\dot x|$ times the distance of *either* nearest point from the joint's axis; a prismatic
one at most $|\dot x|$; a joint that moves both nothing. The reach of a solid from an axis is
bounded over all postures by a ball around it that is swept about one joint after the other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.excite.collision.solids import Ball, HalfSpace, Solid
from steelyard.model.equations.kinematics import Points
from steelyard.robot.robot import Frame, Robot, bodies_along

Origin = Literal["link", "tool", "world"]
"""Whose a shape is: a link's of the model, a tool's or a payload's, or the cell's."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex solid on a body.

    Attributes:
        name: The link, tool or obstacle that it is a part of.
        body: Index of the body that carries it; -1 is the base, and the world.
        rotation: Shape `(3, 3)`, axes of the solid in the body's frame.
        position: Shape `(3,)` [m], origin of the solid in the body's frame.
        solid: What it is.
        origin: Whose it is.
    """

    name: str
    body: int
    rotation: Array
    position: Array
    solid: Solid
    origin: Origin = "link"

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3)))
        object.__setattr__(self, "position", frozen(self.position, (3,)))


@dataclass(frozen=True, eq=False)
class Geometry:
    """The shapes of a robot.

    Attributes:
        shapes: In the order of the model file.
        parents: The link that carries a link, for all links but the root.
        never: Pairs of links that the model itself lets pass through each other.
        skipped: Links whose shapes are left out.
        notes: What the user should know, one sentence each.
    """

    shapes: tuple[Shape, ...]
    parents: Mapping[str, str] = field(default_factory=dict)
    never: frozenset[frozenset[str]] = frozenset()
    skipped: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "parents", MappingProxyType(dict(self.parents)))


def obstacle(
    name: str,
    solid: Solid,
    position: ArrayLike = (0.0, 0.0, 0.0),
    rotation: ArrayLike | None = None,
) -> Shape:
    """A thing that stands still in the cell, placed in the robot's base frame."""
    base = Frame(name, -1, np.eye(3), np.zeros(3))
    return placed(base, name, solid, position, rotation, "world")


def wall(name: str, normal: ArrayLike, offset: float) -> Shape:
    """A plane that nothing may go behind: kept is `normal @ p >= offset` in the base frame.

    Args:
        name: What it is called.
        normal: Shape `(3,)`, of any length but zero.
        offset: [m] for a normal of length one.

    Raises:
        ModelError: The normal has no direction.
    """
    vector = frozen(normal, (3,))
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < np.inf:
        raise ModelError(
            f"the normal of the plane '{name}' has no direction",
            where=f"plane '{name}'",
            fix="give the direction of the free side, such as 0, 0, 1 for a floor",
        )
    z = vector / length
    side = np.eye(3)[np.argmin(np.abs(z))]
    x = np.cross(side, z) / np.linalg.norm(np.cross(side, z))
    rotation = np.column_stack([x, np.cross(z, x), z])
    return obstacle(name, HalfSpace(), z * offset / length, rotation)


def placed(
    frame: Frame,
    name: str,
    solid: Solid,
    position: ArrayLike = (0.0, 0.0, 0.0),
    rotation: ArrayLike | None = None,
    origin: Origin = "link",
) -> Shape:
    """A solid that is placed in a frame, as a shape on the frame's body."""
    turned = np.eye(3) if rotation is None else frozen(rotation, (3, 3))
    if not np.allclose(turned @ turned.T, np.eye(3), atol=1e-6):
        raise ValueError(f"the rotation of '{name}' is not a rotation")
    at = frame.position + frame.rotation @ frozen(position, (3,))
    return Shape(name, frame.body, frame.rotation @ turned, at, solid, origin)


@dataclass(frozen=True, eq=False)
class Poses:
    """All shapes and all joints' axes at `N` samples, in the base frame.

    Attributes:
        rotations: Axes of the solids, shape `(N, G, 3, 3)`.
        origins: Origins of the solids, shape `(N, G, 3)` [m].
        centres: Centres of the balls around them, shape `(N, G, 3)` [m].
        axes: Axes of the bodies' joints, shape `(N, B, 3)`.
        anchors: A point on each of these axes, shape `(N, B, 3)` [m].
    """

    rotations: Array
    origins: Array
    centres: Array
    axes: Array
    anchors: Array


@dataclass(frozen=True, eq=False)
class ShapeKinematics:
    """Forward kinematics of a robot's bodies and what is fixed to them.

    Attributes:
        robot: A tree without loops.
        carriers: Body of each shape, plus one; 0 is the base. Shape `(G,)`.
        rotations: Axes of each solid in its body's frame, shape `(G, 3, 3)`.
        positions: Origins there, shape `(G, 3)` [m].
        centres: Centres of the balls around the solids there, shape `(G, 3)` [m].
    """

    robot: Robot
    carriers: NDArray[np.intp] = field(init=False)
    rotations: Array = field(init=False)
    positions: Array = field(init=False)
    centres: Array = field(init=False)

    def __init__(self, robot: Robot, shapes: Sequence[Shape]) -> None:
        object.__setattr__(self, "robot", robot)
        carriers = np.array([shape.body + 1 for shape in shapes], dtype=np.intp)
        object.__setattr__(self, "carriers", carriers)
        object.__setattr__(self, "rotations", frozen(np.array([s.rotation for s in shapes])))
        object.__setattr__(self, "positions", frozen(np.array([s.position for s in shapes])))
        centres = [s.position + s.rotation @ s.solid.centre for s in shapes]
        object.__setattr__(self, "centres", frozen(np.array(centres)))

    def __call__(self, q: Array) -> Poses:
        """Poses at positions of the joints, shape `(N, n)`."""
        rotation, origin = bodies_along(self.robot, q)
        axes = [(r @ b.axis) for r, b in zip(rotation[1:], self.robot.bodies, strict=True)]
        count, shapes = len(q), len(self.carriers)
        frames = np.empty((count, shapes, 3, 3))
        places = np.empty((2, count, shapes, 3))
        for carrier, which, own in self._carried:
            # one product per body: a stack of small ones would take several times as long
            turned = (rotation[carrier].reshape(-1, 3) @ own).reshape(count, 3, -1, 5)
            frames[:, which] = turned[..., :3].transpose(0, 2, 1, 3)
            places[:, :, which] = turned[..., 3:].transpose(3, 0, 2, 1)
            places[:, :, which] += origin[carrier][:, None]
        origins, centres = places
        return Poses(frames, origins, centres, np.stack(axes, axis=1), np.stack(origin[1:], axis=1))

    @cached_property
    def _carried(self) -> list[tuple[int, NDArray[np.intp], Array]]:
        """Per body that has shapes their numbers, and rotations, origins, centres side by side."""
        found = []
        for carrier in np.unique(self.carriers):
            which = np.flatnonzero(self.carriers == carrier)
            at = np.stack([self.positions[which], self.centres[which]], axis=2)
            own = np.concatenate([self.rotations[which], at], axis=2)
            found.append((int(carrier), which, own.transpose(1, 0, 2).reshape(3, -1)))
        return found


_POINT = 1e-9


@dataclass(frozen=True, eq=False)
class _Ball:
    """A ball in a frame: centre `(3,)` and radius [m]."""

    centre: Array
    radius: float


def sides(robot: Robot, first: int, second: int) -> NDArray[np.int8]:
    """Per body what its joint moves of two bodies.

    Returns:
        Shape `(B,)`: -1 for a joint that moves only the first, 1 for one that moves only the
        second, 0 for those that move both or none.
    """
    signs = np.zeros(len(robot.bodies), dtype=np.int8)
    for body, sign in ((first, -1), (second, 1)):
        while body >= 0:
            signs[body] += sign
            body = robot.bodies[body].parent
    return signs


def rates(robot: Robot, first: Shape, second: Shape, lower: Array, upper: Array) -> Array:
    """Bound of the change of two shapes' distance per speed of each coordinate.

    Args:
        robot: The robot.
        first: A shape.
        second: Another.
        lower: Least positions that occur, shape `(n,)` [rad; m].
        upper: Greatest positions, shape `(n,)`.

    Returns:
        Shape `(n,)` [m/rad; 1].
    """
    ways = sides(robot, first.body, second.body)
    up = _to_base(robot, first.body, ways)
    down = _to_base(robot, second.body, ways)
    mine = _reaches(robot, first, up, down[::-1], lower, upper)
    theirs = _reaches(robot, second, down, up[::-1], lower, upper)
    bound = np.zeros(robot.n)
    for index in (*up, *down):
        body = robot.bodies[index]
        reach = 1.0 if body.kind == "prismatic" else min(mine[index], theirs[index])
        bound[body.coordinate] += abs(body.ratio) * reach
    return bound


def point_rates(robot: Robot, points: Points, lower: Array, upper: Array) -> Array:
    """How far each point moves at most per change of each coordinate, shape `(m, n)` [m/rad; 1]."""
    base = Shape("base", -1, np.eye(3), np.zeros(3), Ball(_POINT))
    own = [
        Shape("point", body, np.eye(3), place, Ball(_POINT))
        for body, place in zip(points.carriers, points.places, strict=True)
    ]
    return np.array([rates(robot, base, shape, lower, upper) for shape in own])


def _to_base(robot: Robot, body: int, ways: NDArray[np.int8]) -> list[int]:
    """Joints from a body to where the two bodies' ways meet, as numbers of bodies."""
    found = []
    while body >= 0:
        if ways[body]:
            found.append(body)
        body = robot.bodies[body].parent
    return found


def _reaches(
    robot: Robot,
    shape: Shape,
    up: Sequence[int],
    down: Sequence[int],
    lower: Array,
    upper: Array,
) -> dict[int, float]:
    """How far a shape may be from the axes of joints, which it passes first up, then down."""
    centre = shape.position + shape.rotation @ shape.solid.centre
    ball, reaches = _Ball(centre, shape.solid.radius), {}
    for index in up:
        body = robot.bodies[index]
        ball, reaches[index] = _swept(robot, index, ball, lower, upper, 1.0)
        ball = _Ball(body.rotation @ ball.centre + body.position, ball.radius)
    for index in down:
        body = robot.bodies[index]
        ball = _Ball(body.rotation.T @ (ball.centre - body.position), ball.radius)
        ball, reaches[index] = _swept(robot, index, ball, lower, upper, -1.0)
    return reaches


def _swept(
    robot: Robot, index: int, ball: _Ball, lower: Array, upper: Array, sign: float
) -> tuple[_Ball, float]:
    """A ball that holds a ball while a joint moves it, and its reach from the joint's axis."""
    body = robot.bodies[index]
    along = body.axis * (body.axis @ ball.centre)
    reach = float(np.linalg.norm(ball.centre - along)) + ball.radius
    if body.kind == "revolute":
        return _Ball(along, reach), reach
    ends = body.ratio * np.array([lower[body.coordinate], upper[body.coordinate]]) + body.offset
    middle, half = ends.mean(), abs(ends[1] - ends[0]) / 2.0
    return _Ball(ball.centre + sign * middle * body.axis, ball.radius + half), reach
