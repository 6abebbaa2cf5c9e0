"""Motions that are planned, not searched: tasks, tool paths, sweeps, from `[excitation.motion]`.

Identification in the running process needs no excitation of its own: random points of two areas,
or the edges of a horizontal square, at the speed of the work. Each move starts and ends at rest;
the whole ends in the posture it started in, so it can be repeated.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.collision.cell import tool_of, up_of
from steelyard.excite.constraints.constraint import MotionLimits
from steelyard.excite.constraints.workspace import Marker
from steelyard.excite.planned.along_path import along_path
from steelyard.excite.planned.inverse_kinematics import Attitude, Pointing
from steelyard.excite.planned.route import Planner, ProcessMotion, ToolGuidance, ToolLimits, Tour
from steelyard.excite.planned.tool_paths import (
    Circle,
    Reaches,
    ToolPath,
    friction_sweeps,
    on_circle,
    out_and_back,
    static_postures,
)
from steelyard.excite.trajectories.bases import posture_of
from steelyard.excite.trajectories.trajectory import ExactTrajectory, SlowedMotion
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.model.equations.kinematics import frame_of
from steelyard.robot.file.excitation_sections import BoxSpans
from steelyard.robot.file.loaded_robot import LoadedRobot, beside
from steelyard.robot.robot import Frame, Robot

_SAME = 1e-6
"""Places nearer to each other than this are one [m]."""


class Process(ABC):
    """A task of a robot that can be planned; `manner` is how the tool is led."""

    manner: ToolGuidance

    @abstractmethod
    def tour(self, robot: Robot, seed: int) -> Tour:
        """The places that the tool visits."""

    def required(self, robot: Robot) -> Iterable[tuple[Array, str, str]]:
        """Places `(K, 3)` [m] that must be in reach, what they are, and which places of it."""
        return ()

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
        planner = Planner(robot, limits, frame, self.manner, seed, start)
        for places, what, which in self.required(robot):
            planner.refuse_out_of_reach(places, what, which)
        return planner.run(self.tour(robot, seed))


@dataclass(frozen=True)
class Box:
    """A box along the axes of the base frame by its middle and its edges [m]; it may be flat."""

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
class PickAndPlace(Process):
    """Random points of one box carried to random points of another, by way of lifted ones.

    Between the boxes the tool is lifted upwards by `lift` [m], or not at all; it dwells in the
    boxes.
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
        rng, up = np.random.default_rng(seed), self.lift * up_of(robot)
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

    def required(self, robot: Robot) -> Iterable[tuple[Array, str, str]]:
        """The corners of the boxes, lifted or not."""
        lifts = np.outer([0.0, 1.0] if self.lift else [0.0], self.lift * up_of(robot))
        for box, name in ((self.pick, "the pick box"), (self.place, "the place box")):
            corners = (lifts[:, None] + box.corners).reshape(-1, 3)
            yield corners, name, "corners and raised corners"


@dataclass(frozen=True)
class Square(Process):
    """The edges of a horizontal square of a `side` [m] about a `centre` [m] in the base frame.

    It is turned by `angle` about the upright axis [rad]; 0 has an edge along the base's x axis. The
    tool dwells at the corners.
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
        first = self.angle + 0.25 * np.pi
        radius = self.side / np.sqrt(2.0)
        return on_circle(np.array(self.centre), radius, 4, up_of(robot), first)

    def required(self, robot: Robot) -> Iterable[tuple[Array, str, str]]:
        """The corners."""
        return ((self.corners(robot), "the square", "corners"),)

    def tour(self, robot: Robot, seed: int) -> Tour:
        """The corners, as often as there are laps."""
        return _laps(self.corners(robot), "corner", self.laps, self.manner)


@dataclass(frozen=True, eq=False)
class Waypoints(Process):
    """Given places `(K, 3)` [m] in the base frame, one after another and back to the first.

    The tool dwells at each place.
    """

    places: Array
    laps: int = 1
    manner: ToolGuidance = ToolGuidance()

    def __post_init__(self) -> None:
        try:
            points = frozen(self.places, (None, 3))
        except ValueError as error:
            raise _refused(
                f"the waypoints are not positions: {error}", "give x, y, z of each"
            ) from None
        moved = np.linalg.norm(np.diff(points, axis=0), axis=1) if len(points) > 1 else np.zeros(1)
        if not np.isfinite(points).all() or moved.max() < _SAME or self.laps < 1:
            raise _refused(
                f"{len(points)} waypoints, visited {self.laps} times, are not a valid path",
                "give two different places or more as finite numbers [m], and 1 lap or more",
            )
        object.__setattr__(self, "places", points)

    def tour(self, robot: Robot, seed: int) -> Tour:
        """The places, as often as there are laps."""
        return _laps(self.places, "waypoint", self.laps, self.manner)


def _laps(places: Array, what: str, laps: int, manner: ToolGuidance) -> Tour:
    names = tuple(f"{what} {k + 1}" for k in range(len(places))) * laps
    return Tour(np.tile(places, (laps, 1)), names, np.full(len(names), manner.dwell), laps)


def _refused(wrong: str, fix: str) -> DataError:
    return DataError(wrong, where="process motion", fix=fix)


WHERE = "[excitation.motion]"

Planned = tuple[ExactTrajectory, tuple[str, ...]]
"""A motion, and notes on it."""


def _process(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    robot, frame = with_tool_point(loaded.robot, tool_of(loaded.excitation.workspace, loaded.robot))
    motion = TASKS[s.kind](s).plan(robot, limits, frame, seed=seed)
    return motion.trajectory, (motion.summary,)


def with_tool_point(robot: Robot, tool: Marker) -> tuple[Robot, str]:
    """The robot with a frame at the tool's point, and the frame's name."""
    if not tool.offset.any():
        return robot, tool.frame
    frame = frame_of(robot, tool.frame)
    place = frame.position + frame.rotation @ tool.offset
    point = Frame(tool.title, frame.body, frame.rotation, place)
    return robot.changed(frames=(*robot.frames, point)), tool.title


def _attitude(s: Any) -> Attitude:
    return Attitude() if s.tool_axis is None else Pointing(s.tool_axis)


def _guidance(s: Any, path: str) -> ToolGuidance:
    return ToolGuidance(
        path="joint" if path == "joint" else "line",
        attitude=_attitude(s),
        tool=ToolLimits(s.speed, s.acceleration),
        dwell=s.dwell,
    )


def _box(spans: BoxSpans, key: str) -> Box:
    """A closed box."""
    given = [getattr(spans, axis) for axis in "xyz"]
    if None in given:
        raise DataError(
            f"the box '{key}' is open",
            where=f"{WHERE} {key}",
            fix="give x, y and z, two numbers each [m]; equal ones for a flat box",
        )
    lower, upper = zip(*given, strict=True)
    centre = tuple(0.5 * (a + b) for a, b in zip(lower, upper, strict=True))
    size = tuple(b - a for a, b in zip(lower, upper, strict=True))
    return Box(centre, size)


TASKS: Mapping[str, Callable[[Any], Process]] = MappingProxyType(
    {
        "pick_and_place": lambda s: PickAndPlace(
            _box(s.pick, "pick"), _box(s.place, "place"), s.cycles, s.lift, _guidance(s, s.path)
        ),
        "square": lambda s: Square(s.centre, s.side, laps=s.laps, manner=_guidance(s, "line")),
        "waypoints": lambda s: Waypoints(s.points, manner=_guidance(s, s.path)),
    }
)


def _along(path: ToolPath, s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    """The motion that leads the tool along a path, and notes on what it lacks."""
    robot, frame = with_tool_point(loaded.robot, tool_of(loaded.excitation.workspace, loaded.robot))
    start = posture_of(s.start, robot, "start")
    motion = along_path(robot, limits, frame, path, _attitude(s), start=start, seed=seed)
    notes = list[str]()
    if motion.still:
        notes.append(f"joints that the path does not need stand still: {', '.join(motion.still)}")
    if motion.excess > 1.0 + 1e-9:
        notes.append(
            f"the {motion.limited} exceeds its limit: the path can be followed in "
            f"{motion.excess:.3g} times the time"
        )
    return motion.trajectory, tuple(notes)


def _circle(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    normal = up_of(loaded.robot) if s.normal is None else np.array(s.normal)
    path = Circle(s.centre, s.radius, s.period, s.laps, s.ramp, normal, s.angle)
    motion, notes = _along(path, s, loaded, limits, seed)
    return motion, (f"{s.laps} laps of {s.period:g} s at full speed", *notes)


def _cartesian_reaching(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    path = Reaches(out_and_back(np.array(s.home), _targets(s, loaded), s.cycles), s.move, s.dwell)
    motion, notes = _along(path, s, loaded, limits, seed)
    reaches = len(path.places) - 1
    return motion, (f"{reaches} reaches of {s.move:g} s, {s.dwell:g} s of rest after each", *notes)


def _targets(s: Any, loaded: LoadedRobot) -> Array:
    """Targets of reaches, shape `(k, 3)` [m]."""
    where = f"{WHERE} targets"
    if isinstance(s.targets, int):
        if s.radius is None:
            raise DataError(
                f"{s.targets} targets without a radius",
                where=where,
                fix="give the radius of their circle [m], or targets = [[x, y, z], ...]",
            )
        normal = up_of(loaded.robot) if s.normal is None else np.array(s.normal)
        return on_circle(np.array(s.home), s.radius, s.targets, normal, s.angle)
    if s.radius is not None or s.normal is not None or s.angle != 0.0:
        raise DataError(
            "radius, normal and angle have no effect where the targets are positions",
            where=where,
            fix="leave them out, or give the number of targets",
        )
    return np.array(s.targets)


def _sweeps(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    posture = posture_of(s.start, loaded.robot, "start")
    motion = friction_sweeps(limits, posture, speeds=s.speeds, slowest=s.slowest, fraction=1.0)
    return motion, (f"each joint alone at {s.speeds} speeds, both ways",)


def _postures(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    motion = static_postures(limits, count=s.count, seed=seed, dwell_s=s.dwell, fraction=1.0)
    return motion, (f"{s.count} postures, {s.dwell:g} s at each",)


def _replay(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    path = beside(loaded.sources[0].path, s.file, f"{WHERE} file")
    return read_motion(path, loaded.robot), (f"the motion of '{path.name}'",)


PLANS: Mapping[str, Callable[[Any, LoadedRobot, MotionLimits, int], Planned]] = MappingProxyType(
    {
        **dict.fromkeys(TASKS, _process),
        "circle": _circle,
        "cartesian_reaching": _cartesian_reaching,
        "sweeps": _sweeps,
        "postures": _postures,
        "replay": _replay,
    }
)


def planned(loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    """The motion of a kind that is planned, and notes on it; same seed, same motion."""
    section = loaded.excitation.motion
    try:
        motion, notes = PLANS[section.kind](section, loaded, limits, seed)
    except ValueError as error:
        raise DataError(str(error), where=WHERE, fix="change that number") from error
    if limits.jerk is None or section.kind == "replay":
        return motion, notes
    least, most = motion.extremes(3)
    excess = float(np.max(np.maximum(-least, most) / limits.jerk))
    if excess <= 1.0:
        return motion, notes
    ratio = excess ** (-1.0 / 3.0) * (1.0 - 1e-9)
    return SlowedMotion(motion, ratio), (*notes, f"slowed to {ratio:.2g} of its speed by its jerk")
