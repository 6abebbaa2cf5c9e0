r"""Spheres on frames: where they are over time, how fast they move, how far off a straight line.

Over a stretch of half length $r$ about its middle,
$p(t) \in p_m + [-r, r]\,\dot p_m + \tfrac{1}{2}[0, r^2]\,A$, with accelerations $A$ bounded by
interval arithmetic over all states of the stretch.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.base.progress import Progress, silent
from steelyard.excite.collision.shapes import point_rates
from steelyard.excite.constraints.bounding import Stretches, proven_minimum
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
        frame: Name of the frame.
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
class SphereDistances(ABC):
    """A constraint whose margins are distances of spheres from something in the cell.

    Attributes:
        name: For certificates and messages.
        labels: What each of the `k` margins is.
        activation_distance: Shape `(k,)` [m].
        points: Centres of the spheres.
        which: Per margin the index of its point.
    """

    name: str
    labels: tuple[str, ...]
    activation_distance: Array
    points: Points
    which: tuple[int, ...]

    @property
    def how(self) -> str:
        """How it is proven, in one sentence."""
        return MARKER_PROOF

    @property
    def scope(self) -> str:
        """What of the robot it is about."""
        return TOOL_ONLY

    @property
    def unit(self) -> str:
        """Unit of the margins."""
        return "m"

    @abstractmethod
    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        """Margins at the middles of stretches, and bounds all over them, `(k, B)` each [m]."""

    def proven(self, trajectory: ExactTrajectory, progress: Progress = silent) -> Array:
        """Lower bounds of the distances at all times, shape `(k,)` [m]."""
        return proven_minimum(
            trajectory, self._bound, np.full(len(self.which), MARKER_TOLERANCE), progress, self.name
        )

    def reaches(self, lower: Array, upper: Array) -> Array:
        """Change of every margin per change of each joint within bounds, `(k, n)` [m/rad; 1]."""
        return point_rates(self.points.robot, self.points, lower, upper)[list(self.which)]


@dataclass(frozen=True, eq=False)
class Paths:
    """Where points are during stretches.

    Attributes:
        middles: Bounds of their positions at the middles, shape `(2, m, 3, B)` [m].
        speeds: Bounds of their velocities at the middles, likewise [m/s].
        bends: Bounds of their accelerations all over the stretches, likewise [m/s²].
        half: Half the stretches' lengths, shape `(B,)` [s].
    """

    middles: Array
    speeds: Array
    bends: Array
    half: Array

    def along(self, point: int, normal: Array) -> Array:
        """Bounds of a point's coordinate along a vector.

        Returns:
            Shape `(2, 2, B)` [m]: at the middles and all over the stretches, lower and upper.
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
    """Centres of the spheres.

    Raises:
        ModelError: There is none, or a frame does not exist, does not move, or hangs on a closed
            chain.
    """
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
    """Bounds over all times.

    Attributes:
        speed: Of the tool's origin [m/s].
        acceleration: Likewise [m/s²].
        deviation: Distance from the straight line [m]; 0 where there is none.
    """

    speed: float
    acceleration: float
    deviation: float


@dataclass(frozen=True, eq=False)
class ToolWay:
    """The way of a frame's origin.

    Attributes:
        kinematics: Of the frame.
        points: Its origin.
    """

    kinematics: FrameKinematics
    points: Points

    @classmethod
    def of(cls, kinematics: FrameKinematics) -> "ToolWay":
        """Of a frame."""
        frame = kinematics.frame
        points = points_on(kinematics.robot, [frame.body], frame.position[None])
        return cls(kinematics, points)

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
        normals = np.zeros((0, 3)) if ends is None else _unit_vectors_across(ends[1] - ends[0])
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


def _unit_vectors_across(way: Array) -> Array:
    """Two unit vectors across a way, shape `(2, 3)`."""
    along = way / np.linalg.norm(way)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])
