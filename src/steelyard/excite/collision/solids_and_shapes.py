r"""Convex solids, shapes fixed to bodies, where they are, and how fast their distances change.

With the height $h(d) = \max_{x} d \cdot x$ of a solid in a direction, the signed distance of two
solids is $\max_{|d| = 1} -h_B(-d) - h_A(d)$: any direction gives a lower bound, the right one the
distance itself, or less the depth of an overlap.

The distance $s$ of two solids on bodies $a$ and $b$ changes at the rate
$n \cdot (v_b - v_a)$ of their nearest points, whose difference is along $n$. A revolute joint
between $a$ and $b$ contributes $\dot x\, n \cdot (w \times p)$ for any point $p$ on that line, so
at most $|\dot x|$ times the distance of *either* nearest point from the joint's axis; a prismatic
one at most $|\dot x|$; a joint that moves both nothing. The reach of a solid from an axis is
bounded over all postures by a ball around it that is swept about one joint after the other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import ModelError
from steelyard.model.equations.frame_and_point_kinematics import Points
from steelyard.robot.robot import Frame, Robot, bodies_along

FLAT_HULL_THICKNESS = 1e-4  # what a mesh without volume is thickened by to each side [m]
WITHOUT_MESH_ADVICE = "name the link under `without` to ignore its shapes"


_OUTERMOST = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1]], dtype=np.float64)
"""Directions among which is that of the point of a solid that is farthest from its centre."""


class Solid:
    """A convex solid in a frame of its own.

    The `radius` [m] is that of a ball around it, infinite for a half-space, and `centre`, shape
    `(3,)` [m], the middle of that ball: the origin, if not stated.
    """

    centre: Array = frozen(np.zeros(3))
    radius: float

    def farthest(self, directions: Array) -> Array:
        """A point of the solid that is farthest along each direction, both of shape `(N, 3)`."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        """Keep the radius, if all sizes, which are the fields, are those of a solid."""
        given = list(vars(self).values())
        sizes = np.hstack(given)
        right = all(np.shape(one) in ((), (3,)) for one in given)  # one number, or three edges
        if not right or not all(0.0 < size < np.inf for size in sizes):
            kind = {"Ball": "sphere"}.get(type(self).__name__, type(self).__name__.lower())
            shown = ", ".join(f"{size:g}" for size in sizes)
            raise ValueError(f"a {kind} of {shown} m is not a solid")
        farthest = np.linalg.norm(self.farthest(_OUTERMOST), axis=1).max()
        set_fields(self, radius=vars(self).get("radius", float(farthest)))


def height(solid: Solid, directions: Array) -> Array:
    """How far a solid reaches along directions `(N, 3)`, shape `(N,)`."""
    return np.asarray(np.einsum("ij,ij->i", solid.farthest(directions), directions))


@dataclass(frozen=True)
class Ball(Solid):
    """A sphere of a radius [m]."""

    radius: float

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return self.radius * _unit(directions)


@dataclass(frozen=True)
class Box(Solid):
    """A box along the axes, by the full lengths of its three edges [m]."""

    size: tuple[float, ...]

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return np.copysign(np.array(self.size) / 2.0, directions)


@dataclass(frozen=True)
class Ellipsoid(Solid):
    """An ellipsoid along the axes, by its three semi-axes [m]."""

    semi: tuple[float, float, float]

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        semi = np.array(self.semi)
        return semi * _unit(directions * semi)


@dataclass(frozen=True)
class _Round(Solid):
    """What turns about z with a radius `disc` [m]; the `length` along z [m] is without caps."""

    disc: float
    length: float

    def _end(self, directions: Array) -> Array:
        """The end of the axis that is farther along each direction."""
        return np.asarray(np.copysign([0.0, 0.0, self.length / 2.0], directions))


@dataclass(frozen=True)
class Cylinder(_Round):
    """A cylinder about z with flat ends."""

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return self._end(directions) + self.disc * _unit(directions * (1.0, 1.0, 0.0))


@dataclass(frozen=True)
class Capsule(_Round):
    """All points near a piece of the z axis."""

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return self._end(directions) + self.disc * _unit(directions)


@dataclass(frozen=True, eq=False)
class Hull(Solid):
    """The convex hull of points; `vertices` are its corners, shape `(V, 3)` [m]."""

    vertices: Array

    def __init__(self, points: ArrayLike) -> None:
        vertices = frozen(_corners(frozen(points, (None, 3))))
        centre = frozen(_ball(vertices))
        radius = float(np.linalg.norm(vertices - centre, axis=1).max())
        if not np.isfinite(radius):
            raise ValueError(f"a hull of radius {radius:g} m is not a solid")
        set_fields(self, vertices=vertices, centre=centre, radius=radius)

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return np.asarray(self.vertices[np.argmax(directions @ self.vertices.T, axis=1)])


class HalfSpace(Solid):
    """All points below the plane z = 0."""

    radius = np.inf

    def farthest(self, directions: Array) -> Array:
        """The origin: only the direction of z has a farthest point, and no other is requested."""
        if not np.allclose(directions, (0.0, 0.0, 1.0), atol=1e-6):
            raise ValueError("a half-space has no end but along z")
        return np.zeros_like(directions)


def _unit(vectors: Array) -> Array:
    """Vectors of length one; a zero vector becomes the x axis, which is as good as any."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0.0, vectors, (1.0, 0.0, 0.0)) / np.where(length > 0.0, length, 1.0)


def _corners(points: Array) -> Array:
    """The points that span their hull; a flat set is thickened by `FLAT_HULL_THICKNESS`."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 1 or not np.isfinite(points).all():
        raise ValueError("the points of a hull are none, or not finite")
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        signs: Sequence[float] = (-FLAT_HULL_THICKNESS, FLAT_HULL_THICKNESS)
        cube = np.array([(x, y, z) for x in signs for y in signs for z in signs])
        thick = (points[:, None] + cube).reshape(-1, 3)
        try:
            return np.asarray(thick[ConvexHull(thick).vertices])
        except QhullError as error:
            wrong = f"no hull can be put around the points: {str(error).splitlines()[0]}"
            raise ValueError(wrong) from None


def _ball(points: Array, rounds: int = 200) -> Array:
    """Centre of a nearly smallest ball around points, shape `(3,)` [BadoiuClarkson2003]."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for step in range(2, rounds):
        far = points[np.argmax(np.linalg.norm(points - centre, axis=1))]
        centre = centre + (far - centre) / step
    return np.asarray(centre)


Origin = Literal["link", "tool", "world"]  # whose: of the model, a tool or payload, or the cell


@dataclass(frozen=True, eq=False)
class Shape(Frame):
    """A convex solid in a frame of a body, -1 for the base and the world.

    It is part of a link, a tool or an obstacle, which it is called like.
    """

    solid: Solid
    origin: Origin = "link"

    @property
    def flat(self) -> bool:
        """Whether it is a half-space."""
        return isinstance(self.solid, HalfSpace)


@dataclass(frozen=True, eq=False)
class Geometry:
    """The shapes of a robot, in the order of the model file.

    The links that carry all links but the root, pairs of links that the model itself lets pass
    through each other (`never`), and links whose shapes are left out (`skipped`).
    """

    shapes: tuple[Shape, ...]
    parents: Mapping[str, str] = field(default_factory=dict)
    never: frozenset[frozenset[str]] = frozenset()
    skipped: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


def obstacle(
    name: str,
    solid: Solid,
    position: ArrayLike = (0.0, 0.0, 0.0),
    rotation: ArrayLike | None = None,
) -> Shape:
    """A thing that stands still in the cell, placed in the robot's base frame."""
    return placed(Frame(name, -1, np.eye(3), np.zeros(3)), name, solid, position, rotation, "world")


def wall(name: str, normal: ArrayLike, offset: float) -> Shape:
    """A plane that nothing may go behind: kept is `normal @ p >= offset` [m] in the base frame.

    The offset is that for a normal of length one.
    """
    vector = frozen(normal, (3,))
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < np.inf:
        raise ModelError(
            f"the normal of the plane '{name}' has no direction",
            where=f"plane '{name}'",
            fix="give the direction of the free side, such as 0, 0, 1 for a floor",
        )
    return obstacle(name, HalfSpace(), vector * offset / length**2, axes_along(vector))


def axes_along(way: Array) -> Array:
    """Axes, the columns of shape `(3, 3)`, whose third one is along a vector."""
    z = way / np.linalg.norm(way)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


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
    at = frame.position + frame.rotation @ frozen(position, (3,))
    return Shape(name, frame.body, frame.rotation @ turned, at, solid, origin)


@dataclass(frozen=True, eq=False)
class Poses:
    """All shapes and all joints' axes at `N` samples, in the base frame.

    Axes `(N, G, 3, 3)` and origins `(N, G, 3)` of the solids, `centres` of the balls around them,
    axes of the bodies' joints `(N, B, 3)` and points on these (`anchors`) [m].
    """

    rotations: Array
    origins: Array
    centres: Array
    axes: Array
    anchors: Array


class ShapeKinematics:
    """Forward kinematics of a tree's bodies without loops, and of shapes that are fixed to them."""

    def __init__(self, robot: Robot, shapes: Sequence[Shape]) -> None:
        self.robot, self._count = robot, len(shapes)
        # per body (plus one; 0 is the base) that has shapes their numbers, and rotations, origins
        # and centres of the balls around them side by side
        self._carried = list[tuple[int, NDArray[np.intp], Array]]()
        for carrier in sorted({shape.body for shape in shapes}):
            which = np.array([k for k, s in enumerate(shapes) if s.body == carrier], dtype=np.intp)
            own = [
                np.column_stack([s.rotation, s.position, s.position + s.rotation @ s.solid.centre])
                for s in (shapes[k] for k in which)
            ]
            self._carried.append((carrier + 1, which, np.concatenate(own, axis=1)))

    def __call__(self, q: Array) -> Poses:
        """Poses at positions of the joints, shape `(N, n)`."""
        rotation, origin = bodies_along(self.robot, q)
        axes = [(r @ b.axis) for r, b in zip(rotation[1:], self.robot.bodies, strict=True)]
        count, shapes = len(q), self._count
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


_POINT = 1e-9


def sides(robot: Robot, first: int, second: int) -> NDArray[np.int8]:
    """Per body what its joint moves of two bodies, shape `(B,)`.

    That is -1 for a joint that moves only the first, 1 for only the second, 0 for both or none.
    """
    signs = np.zeros(len(robot.bodies), dtype=np.int8)
    for chain, sign in zip(robot.apart(first, second), (-1, 1), strict=True):
        signs[list(chain)] = sign
    return signs


def rates(robot: Robot, first: Shape, second: Shape, lower: Array, upper: Array) -> Array:
    """Bound of the change of two shapes' distance per speed of each coordinate, `(n,)` [m/rad; 1].

    It holds for positions from `lower` to `upper`, shape `(n,)` each [rad; m].
    """
    up, down = (chain[::-1] for chain in robot.apart(first.body, second.body))
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


def _reaches(
    robot: Robot, shape: Shape, up: Sequence[int], down: Sequence[int], lower: Array, upper: Array
) -> dict[int, float]:
    """How far a shape may be from the axes of joints, which it passes first up, then down."""
    centre, radius = shape.position + shape.rotation @ shape.solid.centre, shape.solid.radius
    reaches = {}
    for index in up:
        body = robot.bodies[index]
        centre, radius, reaches[index] = _swept(robot, index, centre, radius, lower, upper, 1.0)
        centre = body.rotation @ centre + body.position
    for index in down:
        body = robot.bodies[index]
        centre = body.rotation.T @ (centre - body.position)
        centre, radius, reaches[index] = _swept(robot, index, centre, radius, lower, upper, -1.0)
    return reaches


def _swept(
    robot: Robot, index: int, centre: Array, radius: float, lower: Array, upper: Array, sign: float
) -> tuple[Array, float, float]:
    """A ball that holds a ball while a joint moves it, and its reach from the joint's axis [m]."""
    body = robot.bodies[index]
    along = body.axis * (body.axis @ centre)
    reach = float(np.linalg.norm(centre - along)) + radius
    if body.kind == "revolute":
        return along, reach, reach
    ends = body.ratio * np.array([lower[body.coordinate], upper[body.coordinate]]) + body.offset
    middle, half = ends.mean(), float(abs(ends[1] - ends[0])) / 2.0
    return centre + sign * middle * body.axis, radius + half, reach
