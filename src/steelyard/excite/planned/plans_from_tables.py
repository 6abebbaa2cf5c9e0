"""Motions that are planned, not searched: tasks, tool paths, sweeps, from `[excitation.motion]`.

Identification in the running process needs no excitation of its own: random points of two areas,
or the edges of a horizontal square, at the speed of the work. Each move starts and ends at rest;
the whole ends in the posture it started in, so it can be repeated.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.collision.workspace_from_tables import tool_of, up_of
from steelyard.excite.constraints.motion_limits import MotionLimits
from steelyard.excite.planned.fastest_moves_and_tours import ToolGuidance, Tour, planned_tour
from steelyard.excite.planned.inverse_kinematics import Attitude, Pointing
from steelyard.excite.planned.joints_along_path import along_path
from steelyard.excite.planned.sweeps_and_standstills import friction_sweeps, static_postures
from steelyard.excite.planned.tool_paths import Circle, Reaches, ToolPath, on_circle, out_and_back
from steelyard.excite.trajectories.motion_families import posture_of
from steelyard.excite.trajectories.trajectory import ExactTrajectory, SlowedMotion
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.robot.file.excitation_sections import (
    BoxSpans,
    PickAndPlaceSection,
    SquareSection,
    WaypointsSection,
)
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot, beside
from steelyard.robot.robot import Frame, Robot

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
    required = tuple(
        (
            (lifts + own.reshape(8, 3)).reshape(-1, 3),
            f"the {what} box",
            "corners and raised corners",
        )
        for own, (what, _) in zip(corners, boxes, strict=True)
    )
    return Tour(np.array(places), tuple(names), np.array(dwells), s.cycles, required)


def _box(spans: BoxSpans, key: str) -> Array:
    """Least and greatest corner of a closed box, shape `(2, 3)` [m]."""
    given = [getattr(spans, axis) for axis in "xyz"]
    if None in given:
        raise DataError(
            f"the box '{key}' is open",
            where=f"{WHERE} {key}",
            fix="give x, y and z, two numbers each [m]; equal ones for a flat box",
        )
    lower, upper = box = np.array(given).T
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


TASKS: Mapping[str, Callable[[Any, Robot, int], Tour]] = MappingProxyType(
    {"pick_and_place": pick_and_place, "square": square, "waypoints": waypoints}
)
"""Tasks of the tool by their names, from their sections; same seed, same places."""


def _process(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    guidance = ToolGuidance(getattr(s, "path", "line"), _attitude(s), s.speed, s.acceleration)
    tour = TASKS[s.kind](s, loaded.robot, seed)
    motion = planned_tour(loaded.robot, limits, _tool(loaded), tour, guidance, seed)
    return motion.trajectory, (motion.summary,)


def _tool(loaded: LoadedRobot) -> Frame:
    tool = tool_of(loaded.excitation.workspace, loaded.robot)
    return replace(tool.on(loaded.robot), name=tool.title if tool.offset.any() else tool.frame)


def _attitude(s: Any) -> Attitude:
    return Attitude() if s.tool_axis is None else Pointing(s.tool_axis)


def _along(path: ToolPath, s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    robot, start = loaded.robot, posture_of(s.start, loaded.robot, "start")
    motion = along_path(robot, limits, _tool(loaded), path, _attitude(s), start=start, seed=seed)
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
