r"""Spheres on frames of the robot: where they are, inside a box, and out of boxes of the cell.

Over a stretch of half length $r$ about its middle,
$p(t) \in p_m + [-r, r]\,\dot p_m + \tfrac{1}{2}[0, r^2]\,A$, with accelerations $A$ bounded by
interval arithmetic over all states of the stretch.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.base.progress import Progress, silent
from steelyard.excite.collision.shapes import point_rates
from steelyard.excite.constraints.bounding import Stretches, proven_minimum
from steelyard.excite.constraints.constraint import Constraint, Margins
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.model.equations.kinematics import FrameKinematics, Points, frame_of, points_on
from steelyard.robot.robot import Robot

MARKER_ROOM = 0.05
"""Activation distance: the barrier acts on margins below it [m]."""

MARKER_TOLERANCE = 5e-4
"""How far below the least margin at a sample a proof may stay [m]."""

MARKER_PROOF = (
    "positions and velocities at the middle of every time interval, and bounds of the "
    "accelerations over the interval"
)
"""How margins of spheres are proven."""

TOOL_ONLY = "tool point only"
"""What of a robot such margins are about."""

_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Marker:
    """A sphere that a frame of the robot carries.

    Attributes:
        offset: Its centre in the frame, shape `(3,)` [m].
        radius: Zero for a point [m].
    """

    frame: str
    offset: Array
    radius: float

    def __init__(self, frame: str, offset: ArrayLike = (0.0, 0.0, 0.0), radius: float = 0.0):
        object.__setattr__(self, "frame", frame)
        object.__setattr__(self, "offset", frozen(offset, (3,)))
        object.__setattr__(self, "radius", float(radius))
        if not 0.0 <= self.radius < np.inf:
            raise ValueError(f"a sphere of radius {radius} m")

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
    """A constraint whose margins are distances of spheres from something in the cell.

    Attributes:
        labels: What each of the `k` margins is.
        activation_distance: Shape `(k,)` [m].
        which: Per margin the index of its point.
    """

    name: str
    labels: tuple[str, ...]
    activation_distance: Array
    points: Points
    which: tuple[int, ...]
    unit = "m"
    scope = TOOL_ONLY
    how = MARKER_PROOF

    @abstractmethod
    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        """Margins at the middles of stretches, and bounds all over them, `(k, B)` each [m]."""

    def proven(self, trajectory: ExactTrajectory, progress: Progress = silent) -> Array:
        """See `Constraint`."""
        return proven_minimum(
            trajectory, self._bound, np.full(len(self.which), MARKER_TOLERANCE), progress, self.name
        )

    def reaches(self, lower: Array, upper: Array) -> Array:
        """See `Constraint`."""
        return point_rates(self.points.robot, self.points, lower, upper)[list(self.which)]


@dataclass(frozen=True, eq=False)
class Paths:
    """Bounds of where points are during stretches of half lengths `(B,)` [s].

    Positions and speeds at the middles, and accelerations (`bends`) all over the stretches, shape
    `(2, m, 3, B)` each.
    """

    middles: Array
    speeds: Array
    bends: Array
    half: Array

    def along(self, point: int, normal: Array) -> Array:
        """Bounds of a point's coordinate along a vector, shape `(2, 2, B)` [m].

        At the middles and all over the stretches, lower and upper.
        """
        at, speed, bend = (
            _combined(x[:, point], normal) for x in (self.middles, self.speeds, self.bends)
        )
        away = self.half * np.abs(speed).max(axis=0)
        turned = 0.5 * self.half**2 * np.stack([np.minimum(bend[0], 0.0), np.maximum(bend[1], 0.0)])
        over = at + turned + np.stack([-away - _ROUNDING, away + _ROUNDING])
        return np.stack([at, over])


def paths(points: Points, stretches: Stretches) -> Paths:
    """Where points are during stretches of a motion."""
    m = len(points.carriers)
    flow = np.stack(stretches.middles(points.flow)).reshape(2, 2, m, 3, -1)
    bend = np.stack(stretches.throughout(points.bend)).reshape(2, m, 3, -1)
    return Paths(flow[:, 0], flow[:, 1], bend, stretches.half)


def points_of(robot: Robot, markers: Sequence[Marker], where: str) -> Points:
    """Centres of the spheres."""
    if not markers:
        raise ModelError(
            "no point of the robot is named",
            where=where,
            fix="name at least one frame, such as that of the last link, "
            f"'{robot.bodies[-1].name}'",
        )
    frames = [frame_of(robot, marker.frame) for marker in markers]
    if still := [frame.name for frame in frames if frame.body < 0]:
        raise ModelError(
            f"frame '{still[0]}' is fixed to the base: no motion moves it",
            where=where,
            fix=f"name a frame that moves, such as '{robot.bodies[-1].name}'",
        )
    places = [
        frame.rotation @ marker.offset + frame.position
        for frame, marker in zip(frames, markers, strict=True)
    ]
    return points_on(robot, [frame.body for frame in frames], places)


def _combined(bounds: Array, normal: Array) -> Array:
    """Bounds of a vector along another, from those of its entries, `(2, 3, B)`: `(2, B)`."""
    parts = bounds * normal[:, None]
    return np.asarray(np.sort(parts, axis=0).sum(axis=1))


_FIRST_STRETCHES = 64
"""Stretches of time that a proof begins with."""


@dataclass(frozen=True)
class Extent:
    """Bounds over all times of the tool's speed [m/s] and acceleration [m/s²].

    The deviation is the distance from the straight line [m]; 0 where there is none.
    """

    speed: float
    acceleration: float
    deviation: float


class ToolWay:
    """The way of a frame's origin."""

    def __init__(self, kinematics: FrameKinematics) -> None:
        frame = kinematics.frame
        self.kinematics = kinematics
        self.points = points_on(kinematics.robot, [frame.body], frame.position[None])

    def seen(self, motion: ExactTrajectory, t: Array) -> tuple[float, float]:
        r"""Greatest speed and acceleration at times [m/s, m/s²].

        $v = J \dot q$ and $a = J \ddot q + \dot J \dot q$, the second from the Jacobian's change
        along the way.
        """
        q, dq, ddq = (motion.derivative(t, order) for order in range(3))
        jacobian, small = self.kinematics.jacobian, 1e-6
        ahead, behind = jacobian(q + small * dq)[:, :3], jacobian(q - small * dq)[:, :3]
        here = jacobian(q)[:, :3]
        speeds = np.einsum("nij,nj->ni", here, dq)
        bends = np.einsum("nij,nj->ni", here, ddq)
        bends += np.einsum("nij,nj->ni", (ahead - behind) / (2.0 * small), dq)
        speed, bend = (float(np.linalg.norm(x, axis=1).max()) for x in (speeds, bends))
        return speed, bend

    def proven(
        self,
        motion: ExactTrajectory,
        tolerances: tuple[float, float, float],
        ends: Array | None = None,
    ) -> Extent:
        """Bounds that hold at all times.

        Args:
            motion: The motion.
            tolerances: How far above what is reached the bounds of speed, acceleration and
                deviation may stay; infinite where a rough bound will do.
            ends: Two places on the straight line, shape `(2, 3)` [m]; none by default.
        """
        normals = np.zeros((0, 3)) if ends is None else unit_vectors_across(ends[1] - ends[0])
        levels = np.zeros(0) if ends is None else normals @ ends[0]

        def bound(stretches: Stretches) -> tuple[Array, Array]:
            path = paths(self.points, stretches)
            speed, bend = _greatest_length(path.speeds[:, 0]), _greatest_length(path.bends[:, 0])
            sharp = _greatest_length(np.stack(stretches.middles(self.points.bend)))
            off = np.array([path.along(0, n) - d for n, d in zip(normals, levels, strict=True)])
            away = np.zeros((2, len(speed)))
            if len(off):
                away = np.linalg.norm(np.abs(off).max(axis=2), axis=0)
            middle = np.stack([speed, sharp, away[0]])
            over = np.stack([speed + stretches.half * bend, bend, away[1]])
            return -middle, -over

        least = proven_minimum(motion, bound, np.array(tolerances), count=_FIRST_STRETCHES)
        return Extent(*(float(x) for x in -least))


def _greatest_length(bounds: Array) -> Array:
    """Greatest length of vectors within bounds `(2, 3, B)`, shape `(B,)`."""
    return np.asarray(np.linalg.norm(np.abs(bounds).max(axis=0), axis=0))


def unit_vectors_across(way: Array) -> Array:
    """Two unit vectors across a way, shape `(2, 3)`."""
    along = way / np.linalg.norm(way)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])


_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class HalfSpaces(SphereDistances):
    r"""Spheres that stay on one side of planes, $n \cdot p - \rho \ge d$.

    The `normals` $n$ into the allowed side, shape `(k, 3)`, are unit vectors; `levels` are the
    least values of $n \cdot p$, radius included, shape `(k,)` [m].
    """

    normals: Array
    levels: Array

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """See `Constraint`."""
        positions, slopes = self.points(q)
        chosen = list(self.which)
        values = (positions[:, chosen] * self.normals).sum(axis=2) - self.levels
        by_q = (self.normals[:, None, :] @ slopes[:, chosen])[:, :, 0]
        return Margins(values, by_q=by_q)

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        path = paths(self.points, stretches)
        values, lower = np.empty((2, len(self.which), len(stretches.middle)))
        for k, (point, normal) in enumerate(zip(self.which, self.normals, strict=True)):
            values[k], lower[k] = path.along(point, normal)[:, 0] - self.levels[k]
        return values, lower


def tool_box(
    robot: Robot,
    markers: Sequence[Marker],
    lower: Sequence[float | None],
    upper: Sequence[float | None],
    name: str = "tool box",
) -> HalfSpaces:
    """Spheres that stay inside a box along the base frame's axes.

    `lower` and `upper` are its least and greatest x, y and z [m]; `None` where it is open.
    """
    sides = []
    for axis, low, high in zip(range(3), lower, upper, strict=True):
        if low is not None and high is not None and not low < high:
            raise ModelError(
                f"the box is empty along {_AXES[axis]}: from {low:g} to {high:g} m",
                where=name,
                fix="give a lower bound below the upper one",
            )
        normal = np.eye(3)[axis]
        if low is not None:
            sides.append((normal, low, f"{_AXES[axis]} of {{}} above {low:g} m"))
        if high is not None:
            sides.append((-normal, -high, f"{_AXES[axis]} of {{}} below {high:g} m"))
    if not sides:
        raise ModelError(
            "the box is open on all sides",
            where=name,
            fix="give at least one bound, or leave the box out",
        )
    return _half_spaces(robot, markers, sides, name)


def planes(
    robot: Robot,
    markers: Sequence[Marker],
    normals: ArrayLike,
    levels: ArrayLike,
    name: str = "planes",
) -> HalfSpaces:
    r"""Spheres that stay on one side of planes, $n \cdot p \ge d$.

    Args:
        robot: The robot.
        markers: The spheres.
        normals: $n$, into the allowed side, of any length, shape `(s, 3)`.
        levels: $d$ for the unit vector, the distance of the plane from the base, shape `(s,)` [m].
        name: For certificates and messages.
    """
    vectors = frozen(normals, (None, 3))
    lengths = np.linalg.norm(vectors, axis=1)
    if not len(vectors) or not np.all(lengths > 1e-9):
        raise ModelError(
            "a plane has no direction" if len(vectors) else "there are no planes",
            where=name,
            fix="give every plane a normal that is not zero, such as [0, 0, 1]",
        )
    sides = [
        (n / size, float(d), f"{{}} above plane {number}")
        for number, (n, size, d) in enumerate(
            zip(vectors, lengths, frozen(levels, (len(vectors),)), strict=True), start=1
        )
    ]
    return _half_spaces(robot, markers, sides, name)


def _half_spaces(
    robot: Robot, markers: Sequence[Marker], sides: Sequence[tuple[Array, float, str]], name: str
) -> HalfSpaces:
    """Every sphere on every side: normal, level and label."""
    every = [(k, m, *side) for k, m in enumerate(markers) for side in sides]
    return HalfSpaces(
        name,
        labels=tuple(label.format(marker.title) for _, marker, _, _, label in every),
        activation_distance=np.full(len(every), MARKER_ROOM),
        points=points_of(robot, markers, name),
        which=tuple(k for k, *_ in every),
        normals=np.array([normal for _, _, normal, _, _ in every]),
        levels=np.array([level + marker.radius for _, marker, _, level, _ in every]),
    )


@dataclass(frozen=True, eq=False)
class KeepOut(SphereDistances):
    """Spheres of `radii` `(k,)` [m] that stay out of boxes.

    Distances are to the nearest face, edge or corner. Boxes have `centres` and half edges `halves`,
    shape `(k, 3)` each [m].
    """

    radii: Array
    centres: Array
    halves: Array

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """See `Constraint`."""
        positions, slopes = self.points(q)
        chosen = list(self.which)
        apart = positions[:, chosen] - self.centres
        beyond = np.abs(apart) - self.halves
        values = box_distance(beyond) - self.radii
        direction = _steepest(beyond) * np.where(apart < 0.0, -1.0, 1.0)
        by_q = (direction[:, :, None, :] @ slopes[:, chosen])[:, :, 0]
        return Margins(values, by_q=by_q)

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        path = paths(self.points, stretches)
        values, lower = np.empty((2, len(self.which), len(stretches.middle)))
        for k, point in enumerate(self.which):
            place = np.stack([path.along(point, axis) for axis in np.eye(3)], axis=-1)
            values[k], lower[k] = (self._least(k, bounds) for bounds in place)
        return values, lower

    def _least(self, k: int, bounds: Array) -> Array:
        """Least distance while each coordinate is within bounds, `(2, B, 3)`: shape `(B,)`."""
        above, below = bounds[0] - self.centres[k], self.centres[k] - bounds[1]
        distance = box_distance(np.maximum(above, below) - self.halves[k])
        return np.asarray(distance - self.radii[k])


def keep_out(
    robot: Robot,
    markers: Sequence[Marker],
    lower: ArrayLike,
    upper: ArrayLike,
    name: str = "forbidden boxes",
) -> KeepOut:
    """Spheres that stay out of boxes along the base frame's axes.

    `lower` and `upper` are the least and greatest x, y and z of every box, shape `(b, 3)` each [m].

    Raises:
        ModelError: A box is empty, or a frame does not exist.
    """
    low, high = checked_boxes(lower, upper, name)
    every = [(k, m, b) for k, m in enumerate(markers) for b in range(len(low))]
    boxes = [b for _, _, b in every]
    return KeepOut(
        name,
        labels=tuple(f"{m.title} out of box {b + 1}" for _, m, b in every),
        activation_distance=np.full(len(every), MARKER_ROOM),
        points=points_of(robot, markers, name),
        which=tuple(k for k, _, _ in every),
        radii=np.array([m.radius for _, m, _ in every]),
        centres=(0.5 * (low + high))[boxes],
        halves=(0.5 * (high - low))[boxes],
    )


def checked_boxes(lower: ArrayLike, upper: ArrayLike, name: str) -> tuple[Array, Array]:
    """Corners of boxes, shape `(b, 3)` each [m]."""
    low = frozen(lower, (None, 3))
    high = frozen(upper, low.shape)
    if not len(low) or not np.all(low < high):
        raise ModelError(
            f"box {int(np.argmin((low < high).all(axis=1))) + 1} is empty"
            if len(low)
            else "there are no boxes",
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
