r"""Motions that are planned, not searched, from `[excitation.motion]`: tasks, tool paths, sweeps.

Identification in the running process needs no excitation of its own: random points of two areas,
or the edges of a horizontal square, at the speed of the work. Each move starts and ends at rest;
the whole ends in the posture it started in, so it can be repeated.

A sweep is a joint that goes there and back at a constant speed $v$. It gets up to it with the speed
$v (3 \tau^2 - 2 \tau^3)$, whose largest acceleration is $3/2$ of $v$ over its time.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.collision.workspace_from_tables import tool_of, up_of
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.planned.fastest_moves_and_tours import ToolGuidance, Tour, TourPlanner
from steelyard.excite.planned.inverse_kinematics import Attitude
from steelyard.excite.planned.joints_along_path import along_path, refuse_outside
from steelyard.excite.planned.tool_paths_lines_and_reach import (
    Circle,
    Reaches,
    ToolPath,
    on_circle,
    out_and_back,
)
from steelyard.excite.trajectories.exact_trajectories import (
    SMOOTH,
    ExactTrajectory,
    PiecewiseMotion,
    SlowedMotion,
    reach_seconds,
    through_postures,
)
from steelyard.excite.trajectories.motion_families import posture_of
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.robot.file.excitation_sections import (
    BoxSpans,
    PickAndPlaceSection,
    SquareSection,
    WaypointsSection,
)
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot, beside
from steelyard.robot.robot import Frame, Robot

_GAIN = 1.5  # largest acceleration of a change of speed, over the change per time
_STEADY = 0.5  # share of a sweep's way that is gone at constant speed, at least
_ROOM = 1.0 - 1e-9  # keeps the largest values below the limits, not on them, whatever rounding does


def friction_sweeps(
    limits: MotionLimits,
    posture: Array | None = None,
    *,
    speeds: int = 6,
    slowest: float = 0.05,
    fraction: float = 0.9,
    longest_s: float = 5.0,
) -> PiecewiseMotion:
    """One joint after another goes there and back at constant speeds; the others stand still.

    The ways lie around the posture, as long as `longest_s` and the position range let them be. A
    joint whose range is too short for its highest speed goes as fast as half of the range can be
    gone at. It changes all its speeds in the time that the fastest one needs.

    Speeds are geometrically spaced from the share `slowest` of the fastest on. A `fraction` of the
    speeds, accelerations and position ranges is used. The posture is the middle of the ranges if
    `None`.
    """
    lower, upper = _allowed(limits, _ROOM * fraction)
    posture = 0.5 * (lower + upper) if posture is None else posture
    shares = np.geomspace(slowest, 1.0, speeds) if speeds > 1 else np.ones(1)
    rows: list[tuple[float, int, Array]] = []
    for joint, place in enumerate(posture):
        room = (float(lower[joint]), float(upper[joint]))
        fastest = fraction * _ROOM * limits.velocity[joint]
        acceleration = fraction * _ROOM * limits.acceleration[joint]
        reached = np.sqrt((1.0 - _STEADY) * (room[1] - room[0]) * acceleration / _GAIN)
        top, bounds = min(fastest, reached), (fastest, acceleration)
        for seconds, powers in _joint_sweeps(float(place), room, top * shares, bounds, longest_s):
            rows.append((seconds, joint, powers))
    coefficients = np.zeros((len(rows), 6, len(posture)))
    coefficients[:, 0] = posture
    for piece, (_, joint, powers) in enumerate(rows):
        coefficients[piece, :, joint] = powers
    return PiecewiseMotion(np.cumsum([0.0] + [row[0] for row in rows]), coefficients)


def _joint_sweeps(
    place: float,
    room: tuple[float, float],
    speeds: Array,
    bounds: tuple[float, float],
    longest_s: float,
) -> Iterator[tuple[float, Array]]:
    """Seconds and coefficients of one joint's pieces, from `place` back to it.

    The `room` is its lowest and highest position, `bounds` are its highest speed and acceleration.
    """
    at, change = place, _GAIN * speeds[-1] / bounds[1]
    for speed in speeds:
        way = min(speed * (change + longest_s), room[1] - room[0])
        low = float(np.clip(place - 0.5 * way, room[0], room[1] - way))
        yield from _reach(at, low, bounds, change)
        yield from _sweep(low, low + way, speed, change)
        yield from _sweep(low + way, low, -speed, change)
        at = low
    yield from _reach(at, place, bounds, change)


def _reach(
    start: float, end: float, bounds: tuple[float, float], least_s: float
) -> Iterator[tuple[float, Array]]:
    """A minimum-jerk move, unless there is no way to go; short ones are not hurried."""
    if start != end:
        powers = (end - start) * SMOOTH
        powers[0] = start
        yield max(reach_seconds([end - start], *bounds), least_s), powers


def _sweep(start: float, end: float, speed: float, change: float) -> Iterator[tuple[float, Array]]:
    """From rest up to the speed, along at it, and down to rest; `speed` has the way's sign."""
    half = 0.5 * speed * change
    steady = (end - start) / speed - change
    yield change, np.array([start, 0.0, 0.0, 2.0 * half, -half, 0.0])
    yield steady, np.array([start + half, steady * speed, 0.0, 0.0, 0.0, 0.0])
    yield change, np.array([end - half, 2.0 * half, 0.0, -2.0 * half, half, 0.0])


def static_postures(
    limits: MotionLimits, *, count: int, seed: int, dwell_s: float, fraction: float = 0.9
) -> PiecewiseMotion:
    """Stands still at postures that fill the ranges evenly, and comes back to their middle.

    The postures are the first ones of a scrambled Sobol sequence [Owen1998], in a `fraction` of the
    position ranges; moves between them use half of the speeds and accelerations.
    """
    from scipy.stats.qmc import Sobol

    lower, upper = _allowed(limits, fraction)
    sequence = Sobol(len(lower), seed=np.random.default_rng(seed))
    places = sequence.random_base2((count - 1).bit_length())[:count]
    middle = 0.5 * (lower + upper)
    postures = np.vstack([middle, lower + (upper - lower) * places, middle])
    share = 0.5 * _ROOM
    seconds = [
        reach_seconds(step, share * limits.velocity, share * limits.acceleration)
        for step in np.diff(postures, axis=0)
    ]
    return through_postures(postures, seconds, dwell_s)


def _allowed(limits: MotionLimits, fraction: float) -> tuple[Array, Array]:
    """The share of the position ranges, around their middle."""
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    return middle - fraction * half, middle + fraction * half


WHERE = "[excitation.motion]"

Planned = tuple[ExactTrajectory, tuple[str, ...]]  # a motion, and notes on it


def pick_and_place(s: PickAndPlaceSection, robot: Robot, seed: int) -> Tour:
    """Random points of one box carried to random points of another, by way of lifted ones.

    The tool dwells in the boxes. Their corners, lifted or not, must be in reach.
    """
    rng, up = np.random.default_rng(seed), s.lift * up_of(robot)
    boxes = (("pick", _box(s.pick, "pick")), ("place", _box(s.place, "place")))
    points = [rng.uniform(box[0], box[1], (s.cycles, 3)) for _, box in boxes]
    places, names, dwells = [], list[str](), list[float]()
    for k in range(s.cycles):
        for (what, _), own in zip(boxes, points, strict=True):
            name, point = f"{what} point {k + 1}", own[k]
            places += [point + up, point, point + up] if s.lift else [point]
            names += [f"above {name}", name, f"above {name}"] if s.lift else [name]
            dwells += [0.0, s.dwell, 0.0] if s.lift else [s.dwell]
    lifts = np.outer([0.0, 1.0] if s.lift else [0.0], up)[:, None]
    corners = [np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1) for _, box in boxes]
    which = "corners and raised corners"
    required = tuple(
        ((lifts + own.reshape(8, 3)).reshape(-1, 3), f"the {what} box", which)
        for own, (what, _) in zip(corners, boxes, strict=True)
    )
    return Tour(np.array(places), tuple(names), np.array(dwells), s.cycles, required)


def _box(spans: BoxSpans, key: str) -> Array:
    """Least and greatest corner of a closed box, shape `(2, 3)` [m]."""
    if None in spans.spans:
        raise DataError(
            f"the box '{key}' is open",
            where=f"{WHERE} {key}",
            fix="give x, y and z, two numbers each [m]; equal ones for a flat box",
        )
    lower, upper = box = np.array(spans.spans).T
    if np.any(lower > upper):
        raise DataError(
            f"the box '{key}' ends below its beginning",
            where=f"{WHERE} {key}",
            fix="give the lower number of x, y and z first [m]",
        )
    return box


def square(s: SquareSection, robot: Robot, seed: int) -> Tour:
    """The corners of a horizontal square, one edge of it along the base's x axis, lap after lap."""
    corners = on_circle(np.array(s.centre), s.side / np.sqrt(2.0), 4, up_of(robot), 0.25 * np.pi)
    names = tuple(f"corner {k + 1}" for k in range(4)) * s.laps
    dwells, required = np.full(len(names), s.dwell), ((corners, "the square", "corners"),)
    return Tour(np.tile(corners, (s.laps, 1)), names, dwells, s.laps, required)


def waypoints(s: WaypointsSection, robot: Robot, seed: int) -> Tour:
    """Given places, one after another and back to the first; the tool dwells at each."""
    names = tuple(f"waypoint {k + 1}" for k in range(len(s.points)))
    return Tour(np.array(s.points), names, np.full(len(names), s.dwell), 1)


TASKS: Mapping[str, Callable[[Any, Robot, int], Tour]] = {
    "pick_and_place": pick_and_place,
    "square": square,
    "waypoints": waypoints,
}
"""Tasks of the tool by their names, from their sections; same seed, same places."""


def _process(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    guidance = ToolGuidance(
        getattr(s, "path", "line"), Attitude(s.tool_axis), s.speed, s.acceleration
    )
    tour = TASKS[s.kind](s, loaded.robot, seed)
    planner = TourPlanner(loaded.robot, limits, _tool(loaded), guidance, seed)
    motion = planner.fastest(tour)
    return motion.trajectory, (motion.summary,)


def _tool(loaded: LoadedRobot) -> Frame:
    tool = tool_of(loaded.excitation.workspace, loaded.robot)
    return replace(tool.on(loaded.robot), name=tool.title if tool.offset.any() else tool.frame)


def _along(path: ToolPath, s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    robot, start = loaded.robot, posture_of(s.start, loaded.robot, "start")
    motion = along_path(
        robot, limits, _tool(loaded), path, Attitude(s.tool_axis), start=start, seed=seed
    )
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
    if posture is not None:
        refuse_outside(loaded.robot, limits, posture)
    motion = friction_sweeps(limits, posture, speeds=s.speeds, slowest=s.slowest, fraction=1.0)
    return motion, (f"each joint alone at {s.speeds} speeds, both ways",)


def _postures(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    motion = static_postures(limits, count=s.count, seed=seed, dwell_s=s.dwell, fraction=1.0)
    return motion, (f"{s.count} postures, {s.dwell:g} s at each",)


def _replay(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    path = beside(loaded.sources[0].path, s.file, f"{WHERE} file")
    return read_motion(path, loaded.robot), (f"the motion of '{path.name}'",)


PLANS: Mapping[str, Callable[[Any, LoadedRobot, MotionLimits, int], Planned]] = {
    **dict.fromkeys(TASKS, _process),
    "circle": _circle,
    "cartesian_reaching": _cartesian_reaching,
    "sweeps": _sweeps,
    "postures": _postures,
    "replay": _replay,
}


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
