"""Motions that are planned, not searched, from the `[excitation.motion]` table."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.collision.cell import tool_of
from steelyard.excite.constraints.constraint import MotionLimits
from steelyard.excite.constraints.markers import Marker
from steelyard.excite.planned.along_path import along_path
from steelyard.excite.planned.inverse_kinematics import AnyAttitude, Attitude, Pointing
from steelyard.excite.planned.moves import ToolGuidance, ToolLimits
from steelyard.excite.planned.process import Box, PickAndPlace, Process, Square, Waypoints, upwards
from steelyard.excite.planned.sweeps import friction_sweeps, static_postures
from steelyard.excite.planned.tool_paths import Circle, Reaches, ToolPath, on_circle, out_and_back
from steelyard.excite.trajectories.families import posture_of
from steelyard.excite.trajectories.trajectory import ExactTrajectory, SlowedMotion
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.model.equations.kinematics import frame_of
from steelyard.robot.file.loaded_robot import LoadedRobot, beside
from steelyard.robot.file.motion_sections import BoxSpans
from steelyard.robot.robot import Frame, Robot

WHERE = "[excitation.motion]"

Planned = tuple[ExactTrajectory, tuple[str, ...]]
"""A motion, and notes on it."""

Plan = Callable[[Any, LoadedRobot, MotionLimits, int], Planned]


def _process(task: Process, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    robot, frame = with_tool_point(loaded.robot, tool_of(loaded.excitation.workspace, loaded.robot))
    motion = task.plan(robot, limits, frame, seed=seed)
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
    return AnyAttitude() if s.tool_axis is None else Pointing(s.tool_axis)


def _guidance(s: Any, path: str) -> ToolGuidance:
    return ToolGuidance(
        path="joint" if path == "joint" else "line",
        attitude=_attitude(s),
        tool=ToolLimits(s.speed, s.acceleration),
        dwell=s.dwell,
    )


def _box(spans: BoxSpans, key: str) -> Box:
    """A closed box.

    Raises:
        DataError: It is open.
    """
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


def _pick_and_place(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    pick, place = _box(s.pick, "pick"), _box(s.place, "place")
    task = PickAndPlace(pick, place, s.cycles, s.lift, _guidance(s, s.path))
    return _process(task, loaded, limits, seed)


def _square(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    return _process(
        Square(s.centre, s.side, laps=s.laps, manner=_guidance(s, "line")), loaded, limits, seed
    )


def _waypoints(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    return _process(Waypoints(s.points, manner=_guidance(s, s.path)), loaded, limits, seed)


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
    normal = upwards(loaded.robot) if s.normal is None else np.array(s.normal)
    path = Circle(s.centre, s.radius, s.period, s.laps, s.ramp, normal, s.angle)
    motion, notes = _along(path, s, loaded, limits, seed)
    return motion, (f"{s.laps} laps of {s.period:g} s at full speed", *notes)


def _cartesian_reaching(s: Any, loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    path = Reaches(out_and_back(np.array(s.home), _targets(s, loaded), s.cycles), s.move, s.dwell)
    motion, notes = _along(path, s, loaded, limits, seed)
    reaches = len(path.places) - 1
    return motion, (f"{reaches} reaches of {s.move:g} s, {s.dwell:g} s of rest after each", *notes)


def _targets(s: Any, loaded: LoadedRobot) -> Array:
    """Targets of reaches, shape `(k, 3)` [m].

    Raises:
        DataError: A number of them is given without the radius of their circle, or the reverse.
    """
    where = f"{WHERE} targets"
    if isinstance(s.targets, int):
        if s.radius is None:
            raise DataError(
                f"{s.targets} targets without a radius",
                where=where,
                fix="give the radius of their circle [m], or targets = [[x, y, z], ...]",
            )
        normal = upwards(loaded.robot) if s.normal is None else np.array(s.normal)
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


PLANS: Mapping[str, Plan] = MappingProxyType(
    {
        "pick_and_place": _pick_and_place,
        "square": _square,
        "waypoints": _waypoints,
        "circle": _circle,
        "cartesian_reaching": _cartesian_reaching,
        "sweeps": _sweeps,
        "postures": _postures,
        "replay": _replay,
    }
)


def planned(loaded: LoadedRobot, limits: MotionLimits, seed: int) -> Planned:
    """The motion of a kind that is planned.

    Args:
        loaded: The robot and its tables.
        limits: Of its joints.
        seed: Same seed, same motion.

    Raises:
        DataError: The task cannot be done; says where and how it would have to be changed.
    """
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
