r"""A sphere on a frame, such as the tool: in a box, beside planes, out of boxes of the cell.

Over a stretch of half length $r$ about its middle,
$p(t) \in p_m + [-r, r]\,\dot p_m + \tfrac{1}{2}[0, r^2]\,A$, with accelerations $A$ bounded by
interval arithmetic over all states of the stretch.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import ModelError
from steelyard.excite.collision.solids_and_shapes import point_rates
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import Stretches, proven_minimum
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.model.equations.frame_and_point_kinematics import (
    Points,
    frame_of,
    points_on,
    refuse_fixed,
)
from steelyard.robot.robot import Frame, Robot

MARKER_ROOM = 0.05  # activation distance: the barrier acts on margins below it [m]
MARKER_TOLERANCE = 5e-4  # how far below the least margin at a sample a proof may stay [m]

MARKER_PROOF = (
    "positions and velocities at the middle of every time interval, and bounds of the "
    "accelerations over the interval"
)

TOOL_ONLY = "tool point only"  # what of a robot such margins are about

_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Marker:
    """A sphere about `offset` in a frame of the robot, `(3,)` [m]; of radius 0 for a point [m]."""

    frame: str
    offset: Array
    radius: float

    def __init__(self, frame: str, offset: ArrayLike = (0.0, 0.0, 0.0), radius: float = 0.0):
        set_fields(self, frame=frame, offset=frozen(offset, (3,)), radius=float(radius))

    def on(self, robot: Robot) -> Frame:
        """Its centre, as a frame on the body that carries it."""
        own = frame_of(robot, self.frame)
        return Frame(own.name, own.body, own.rotation, own.position + own.rotation @ self.offset)

    @property
    def ball(self) -> str:
        """Such as `ball of radius 50 mm`."""
        return f"ball of radius {1e3 * self.radius:.3g} mm"

    @property
    def title(self) -> str:
        """Name for labels, such as `'hand' + (0, 0, 0.1) (ball of radius 50 mm)`."""
        name = f"'{self.frame}'"
        if self.offset.any():
            name += f" + ({', '.join(f'{x:g}' for x in self.offset)})"
        return f"{name} ({self.ball})" if self.radius > 0.0 else name


@dataclass(frozen=True, eq=False)
class SphereDistances(Constraint):
    """A constraint whose margins are distances of the tool's sphere from something in the cell."""

    name: str
    labels: tuple[str, ...]
    points: Points
    unit = "m"
    scope = TOOL_ONLY
    how = MARKER_PROOF
    activation_distance: Array = field(init=False)

    def __post_init__(self) -> None:
        set_fields(self, activation_distance=np.full(len(self.labels), MARKER_ROOM))

    @abstractmethod
    def _distances(self, places: Array) -> tuple[Array, Array]:
        """Margins at places `(N, 3)` of the centre, `(N, k)` [m], and their slopes `(k, 3)`."""

    @abstractmethod
    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        """Margins at the middles of stretches, and bounds all over them, `(k, B)` each [m]."""

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """See `Constraint`."""
        positions, slopes = self.points(q)
        values, directions = self._distances(positions[:, 0])
        return Margins(values, by_q=directions @ slopes[:, 0])

    def proven(self, trajectory: ExactTrajectory) -> Array:
        """See `Constraint`."""
        return proven_minimum(trajectory, self._bound, np.full(len(self.labels), MARKER_TOLERANCE))

    def reaches(self, lower: Array, upper: Array) -> Array:
        """See `Constraint`."""
        once = point_rates(self.points.robot, self.points, lower, upper)
        return np.repeat(once, len(self.labels), axis=0)


class Paths:
    """Bounds of where points are during stretches of a motion of half lengths `(B,)` [s].

    Positions and speeds at the middles, accelerations (`bends`) all over, `(2, m, 3, B)` each.
    """

    def __init__(self, points: Points, stretches: Stretches) -> None:
        shape = (len(points.carriers), 3, -1)
        flow = np.stack(stretches.middles(points.flow)).reshape(2, 2, *shape)
        self.middles, self.speeds = flow[:, 0], flow[:, 1]
        self.bends = np.stack(stretches.throughout(points.bend)).reshape(2, *shape)
        self.half = stretches.half

    def along(self, point: int, normal: Array) -> Array:
        """Bounds of a point's coordinate along a vector, `(2, 2, B)` [m].

        At the middles and all over the stretches, lower and upper.
        """
        at, speed, bend = (
            np.sort(x[:, point] * normal[:, None], axis=0).sum(axis=1)
            for x in (self.middles, self.speeds, self.bends)
        )
        away = self.half * np.abs(speed).max(axis=0)
        turned = 0.5 * self.half**2 * np.stack([np.minimum(bend[0], 0.0), np.maximum(bend[1], 0.0)])
        over = at + turned + np.stack([-away - _ROUNDING, away + _ROUNDING])
        return np.stack([at, over])


def points_of(robot: Robot, marker: Marker) -> Points:
    """The centre of a sphere, which must move."""
    frame = marker.on(robot)
    refuse_fixed(robot, frame)
    return points_on(robot, [frame.body], frame.position[None])


_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class HalfSpaces(SphereDistances):
    r"""A sphere that stays on one side of planes, $n \cdot p - \rho \ge d$.

    The `normals` $n$ into the allowed side, shape `(k, 3)`, are unit vectors; `levels` are the
    least values of $n \cdot p$, radius included, shape `(k,)` [m].
    """

    normals: Array
    levels: Array

    def _distances(self, places: Array) -> tuple[Array, Array]:
        return places @ self.normals.T - self.levels, self.normals

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        path = Paths(self.points, stretches)
        found = np.array([path.along(0, normal)[:, 0] for normal in self.normals])
        values, lower = np.moveaxis(found - self.levels[:, None, None], 1, 0)
        return values, lower


def tool_box(
    robot: Robot, marker: Marker, lower: Sequence[float | None], upper: Sequence[float | None]
) -> HalfSpaces:
    """A sphere in a box, by its least and greatest x, y and z [m]; `None` where it is open."""
    name, sides = "tool box", []
    for axis, normal, low, high in zip(_AXES, np.eye(3), lower, upper, strict=True):
        if low is not None and high is not None and not low < high:
            raise ModelError(
                f"the box is empty along {axis}: from {low:g} to {high:g} m",
                where=name,
                fix="give a lower bound below the upper one",
            )
        if low is not None:
            sides.append((normal, low, f"{axis} of {marker.title} above {low:g} m"))
        if high is not None:
            sides.append((-normal, -high, f"{axis} of {marker.title} below {high:g} m"))
    normals, levels, labels = zip(*sides, strict=True)
    points = points_of(robot, marker)
    return HalfSpaces(name, labels, points, np.array(normals), np.array(levels) + marker.radius)


def planes(robot: Robot, marker: Marker, normals: ArrayLike, levels: ArrayLike) -> HalfSpaces:
    r"""A sphere that stays on one side of planes, $n \cdot p \ge d$.

    Normals $n$, `(s, 3)`, of any length, point into the allowed side; levels $d$, `(s,)` [m], are
    those of such normals.
    """
    vectors = frozen(normals, (None, 3))
    lengths = np.linalg.norm(vectors, axis=1)
    if not np.all(lengths > 1e-9):
        raise ModelError(
            "a plane has no direction",
            where="planes",
            fix="give every plane a normal that is not zero, such as [0, 0, 1]",
        )
    labels = tuple(f"{marker.title} above plane {k + 1}" for k in range(len(vectors)))
    points, least = points_of(robot, marker), np.asarray(levels) / lengths
    return HalfSpaces("planes", labels, points, vectors / lengths[:, None], least + marker.radius)


@dataclass(frozen=True, eq=False)
class KeepOut(SphereDistances):
    """A sphere of a radius [m] that stays out of boxes.

    Distances are to the nearest face, edge or corner. Boxes have `centres` and half edges `halves`,
    shape `(k, 3)` each [m].
    """

    radius: float
    centres: Array
    halves: Array

    def _distances(self, places: Array) -> tuple[Array, Array]:
        apart = places[:, None] - self.centres
        beyond = np.abs(apart) - self.halves
        directions = _steepest(beyond) * np.where(apart < 0.0, -1.0, 1.0)
        return box_distance(beyond) - self.radius, directions

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        path = Paths(self.points, stretches)
        # least and greatest coordinates, `(2, B, 3)`, at the middles and all over
        place = np.stack([path.along(0, axis) for axis in np.eye(3)], axis=-1)
        boxes = list(zip(self.centres, self.halves, strict=True))
        values, lower = (
            np.array([box_distance(np.maximum(low - c, c - high) - half) for c, half in boxes])
            for low, high in place
        )
        return values - self.radius, lower - self.radius


def keep_out(robot: Robot, marker: Marker, lower: ArrayLike, upper: ArrayLike) -> KeepOut:
    """A sphere that stays out of boxes, by their least and greatest corners, `(b, 3)` each [m].

    Raises:
        ModelError: A box is empty, or a frame does not exist.
    """
    name = "forbidden boxes"
    low, high = checked_boxes(lower, upper, name)
    labels = tuple(f"{marker.title} out of box {k + 1}" for k in range(len(low)))
    centres, halves = 0.5 * (low + high), 0.5 * (high - low)
    return KeepOut(name, labels, points_of(robot, marker), marker.radius, centres, halves)


def checked_boxes(lower: ArrayLike, upper: ArrayLike, name: str) -> tuple[Array, Array]:
    """Corners of boxes, shape `(b, 3)` each [m]."""
    low = frozen(lower, (None, 3))
    high = frozen(upper, low.shape)
    if not np.all(low < high):
        raise ModelError(
            f"box {int(np.argmin((low < high).all(axis=1))) + 1} is empty",
            where=name,
            fix="give every box a lower corner below its upper one in x, y and z",
        )
    return low, high


def box_distance(beyond: Array) -> Array:
    """Signed distance from a box, from how far each coordinate is beyond its faces, `(..., 3)`."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0.0))


def _steepest(beyond: Array) -> Array:
    """Derivative of `box_distance`, shape `(..., 3)`; at an edge inside that of one face."""
    outside = np.maximum(beyond, 0.0)
    length = np.linalg.norm(outside, axis=-1, keepdims=True)
    inside = np.eye(3)[beyond.argmax(axis=-1)]
    return np.where(length > 0.0, outside / np.where(length > 0.0, length, 1.0), inside)
