"""Motions that robots do at work anyway: pick and place, edges of a square, any places.

Identification in the running process needs no excitation of its own: random points of two areas,
or the edges of a horizontal square, at the speed of the work. Each move starts and ends at rest;
the whole ends in the posture it started in, so it can be repeated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint import MotionLimits
from steelyard.excite.planned.moves import ProcessMotion, ToolGuidance, Tour
from steelyard.excite.planned.route import Planner
from steelyard.robot.robot import Robot

_SAME = 1e-6
"""Places nearer to each other than this are one [m]."""


class Process(Protocol):
    """A task of a robot that can be planned."""

    def plan(
        self,
        robot: Robot,
        limits: MotionLimits,
        frame: str,
        *,
        seed: int = 0,
        start: ArrayLike | None = None,
    ) -> ProcessMotion:
        """The fastest motion of the task.

        Args:
            robot: The robot.
            limits: Of its joints.
            frame: The frame that does the task, such as the tool's.
            seed: Same seed, same motion: of what is random in the task and in the search.
            start: Posture near which to begin, shape `(n,)` [rad; m]; by default one from which
                the whole task can be done.

        Raises:
            DataError: The task cannot be done, where, and how it would have to be changed.
        """
        ...


@dataclass(frozen=True)
class Box:
    """A box along the axes of the base frame; it may be flat.

    Attributes:
        centre: Its middle [m].
        size: Its edges [m].
    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        sizes = np.array([*self.centre, *self.size])
        if sizes.shape != (6,) or not np.isfinite(sizes).all() or min(self.size) < 0.0:
            raise _refused(
                f"a box of centre {self.centre} and size {self.size} is none",
                "give three finite numbers for each, the size not negative [m]",
            )

    @property
    def corners(self) -> Array:
        """The corners, shape `(8, 3)` [m]."""
        signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing="ij"), axis=-1).reshape(8, 3)
        return np.asarray(self.centre + signs * self.size)

    def points(self, rng: np.random.Generator, count: int) -> Array:
        """Random places inside, evenly spread, shape `(count, 3)` [m]."""
        return np.asarray(self.centre + rng.uniform(-0.5, 0.5, (count, 3)) * self.size)


@dataclass(frozen=True)
class PickAndPlace:
    """Random points of one box carried to random points of another, by way of lifted ones.

    Attributes:
        pick: Where things are taken.
        place: Where they are put.
        cycles: How many are carried.
        lift: How far the tool is lifted upwards between the boxes [m]; 0 for not at all.
        manner: How the tool is led; it dwells in the boxes.
    """

    pick: Box
    place: Box
    cycles: int = 10
    lift: float = 0.1
    manner: ToolGuidance = ToolGuidance()

    def __post_init__(self) -> None:
        if self.cycles < 1 or not 0.0 <= self.lift < np.inf:
            raise _refused(
                f"{self.cycles} cycles with a lift of {self.lift} m are not a valid task",
                "give 1 cycle or more, and a lift of 0 m or more",
            )

    def tour(self, robot: Robot, seed: int) -> Tour:
        """The places, drawn at random: pick, lifted, lifted, place, lifted, lifted, and so on."""
        rng, up = np.random.default_rng(seed), self.lift * upwards(robot)
        picks = self.pick.points(rng, self.cycles)
        puts = self.place.points(rng, self.cycles)
        places, names, dwells = [], list[str](), list[float]()
        for k in range(self.cycles):
            for point, what in ((picks[k], "pick"), (puts[k], "place")):
                name = f"{what} point {k + 1}"
                places += [point + up, point, point + up] if self.lift else [point]
                names += [f"above {name}", name, f"above {name}"] if self.lift else [name]
                dwells += [0.0, self.manner.dwell, 0.0] if self.lift else [self.manner.dwell]
        return Tour(np.array(places), tuple(names), np.array(dwells), self.cycles)

    def plan(
        self,
        robot: Robot,
        limits: MotionLimits,
        frame: str,
        *,
        seed: int = 0,
        start: ArrayLike | None = None,
    ) -> ProcessMotion:
        """See `Process`; refuses boxes with corners out of reach, lifted or not."""
        planner = Planner.of(robot, limits, frame, self.manner, seed, start)
        lifts = np.outer([0.0, 1.0] if self.lift else [0.0], self.lift * upwards(robot))
        for box, name in ((self.pick, "the pick box"), (self.place, "the place box")):
            corners = (lifts[:, None] + box.corners).reshape(-1, 3)
            planner.demand(corners, name, "corners and raised corners")
        return planner.run(self.tour(robot, seed))


@dataclass(frozen=True)
class Square:
    """The edges of a horizontal square.

    Attributes:
        centre: Its middle [m], in the base frame.
        side: Length of an edge [m].
        angle: Turn about the upright axis [rad]; 0 has an edge along the base's x axis.
        laps: How often it is gone round.
        manner: How the tool is led; it dwells at the corners.
    """

    centre: tuple[float, float, float]
    side: float
    angle: float = 0.0
    laps: int = 1
    manner: ToolGuidance = ToolGuidance()

    def __post_init__(self) -> None:
        if not 0.0 < self.side < np.inf or self.laps < 1:
            raise _refused(
                f"a square of {self.side} m, {self.laps} times round, is not a valid task",
                "give a side above 0 m and 1 lap or more",
            )

    def corners(self, robot: Robot) -> Array:
        """The four corners in the order of the visits, shape `(4, 3)` [m]."""
        up = upwards(robot)
        ahead = np.eye(3)[0] - up[0] * up
        ahead = ahead if np.linalg.norm(ahead) > 1e-3 else np.eye(3)[1] - up[1] * up
        ahead /= np.linalg.norm(ahead)
        aside = np.cross(up, ahead)
        angles = self.angle + np.pi * (0.25 + 0.5 * np.arange(4))
        radius = self.side / np.sqrt(2.0)
        spread = np.outer(np.cos(angles), ahead) + np.outer(np.sin(angles), aside)
        return np.asarray(np.array(self.centre) + radius * spread)

    def plan(
        self,
        robot: Robot,
        limits: MotionLimits,
        frame: str,
        *,
        seed: int = 0,
        start: ArrayLike | None = None,
    ) -> ProcessMotion:
        """See `Process`; refuses a square with corners out of reach."""
        planner = Planner.of(robot, limits, frame, self.manner, seed, start)
        corners = self.corners(robot)
        planner.demand(corners, "the square", "corners")
        names = tuple(f"corner {k + 1}" for k in range(4)) * self.laps
        dwells = np.full(len(names), self.manner.dwell)
        return planner.run(Tour(np.tile(corners, (self.laps, 1)), names, dwells, self.laps))


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Given places, one after another and back to the first.

    Attributes:
        places: Shape `(K, 3)` [m], in the base frame.
        laps: How often all are visited.
        manner: How the tool is led; it dwells at each place.
    """

    places: Array
    laps: int
    manner: ToolGuidance

    def __init__(
        self,
        places: Sequence[Sequence[float]] | Array,
        laps: int = 1,
        manner: ToolGuidance | None = None,
    ) -> None:
        try:
            points = frozen(places, (None, 3))
        except ValueError as error:
            raise _refused(
                f"the waypoints are not positions: {error}", "give x, y, z of each"
            ) from None
        moved = np.linalg.norm(np.diff(points, axis=0), axis=1) if len(points) > 1 else np.zeros(1)
        if not np.isfinite(points).all() or moved.max() < _SAME or laps < 1:
            raise _refused(
                f"{len(points)} waypoints, visited {laps} times, are not a valid path",
                "give two different places or more as finite numbers [m], and 1 lap or more",
            )
        object.__setattr__(self, "places", points)
        object.__setattr__(self, "laps", laps)
        object.__setattr__(self, "manner", ToolGuidance() if manner is None else manner)

    def plan(
        self,
        robot: Robot,
        limits: MotionLimits,
        frame: str,
        *,
        seed: int = 0,
        start: ArrayLike | None = None,
    ) -> ProcessMotion:
        """See `Process`; refuses the first waypoint that is out of reach."""
        names = tuple(f"waypoint {k + 1}" for k in range(len(self.places))) * self.laps
        dwells = np.full(len(names), self.manner.dwell)
        planner = Planner.of(robot, limits, frame, self.manner, seed, start)
        return planner.run(Tour(np.tile(self.places, (self.laps, 1)), names, dwells, self.laps))


def upwards(robot: Robot) -> Array:
    """The unit vector against gravity in the base frame; the base's z axis without gravity."""
    weight = float(np.linalg.norm(robot.gravity))
    return -robot.gravity / weight if weight > 1e-9 else np.eye(3)[2]


def _refused(wrong: str, fix: str) -> DataError:
    return DataError(wrong, where="process motion", fix=fix)
