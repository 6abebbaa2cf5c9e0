r"""Motions as CSV, MJCF keyframes, ROS 2 trajectories, and programs in URScript, KRL and RAPID.

Between two points with positions, velocities and accelerations `joint_trajectory_controller`
takes the polynomial of degree five through them. If accelerations are continuous in between,
its error is at most $C h^3 (\max \dddot q - \min \dddot q) / 2$ over a step $h$: the error
functional vanishes for polynomials of degree five, a constant may be taken from the jerk, and $C$
is the greatest integral of the magnitude of its Peano kernel [Davis1963].
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, floor, inf
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import OutputError, refuse_unknown
from steelyard.base.files import csv_text, refuse_existing, whole_file
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory, divided
from steelyard.robot.robot import Robot

MOST_POINTS = 2_000_000  # rows or commands that a file may hold
AT_REST = 1e-7  # speed below which a motion counts as at rest [rad/s; m/s]
_STEP_ROUNDING = 1e-9  # share of a step that counts as rounding


MoreColumns = Callable[[Array, Array, Array], Mapping[str, Array]]
"""Further columns by name, each `(N,)`, of positions, velocities and accelerations `(N, n)`."""


def grid_times(duration: float, rate: float) -> Array:
    """Times `k / rate` from 0 on, and the end, `(N,)` [s]; `OutputError` for too many."""
    _refuse_many(duration, rate)
    times = np.arange(floor(duration * rate + _STEP_ROUNDING) + 1) / rate
    beyond = duration - times[-1] > _STEP_ROUNDING / rate
    return np.append(times, duration) if beyond else np.minimum(times, duration)


def even_times(duration: float, rate: float) -> Array:
    """Times from 0 to the duration in equal steps, at least `rate` a second, `(N,)` [s]."""
    _refuse_many(duration, rate)
    return np.linspace(0.0, duration, max(1, ceil(duration * rate - _STEP_ROUNDING)) + 1)


def _refuse_many(duration: float, rate: float) -> None:
    if duration * rate > MOST_POINTS:
        raise OutputError(
            f"{duration:g} s at {rate:g} points per second are more than {MOST_POINTS} points",
            where="rate of the export",
            fix=f"give at most {MOST_POINTS / duration:.3g} points per second",
        )


def refuse_moving_ends(trajectory: ExactTrajectory, robot: Robot, what: str) -> None:
    """A controller begins and ends at rest, whatever the motion states."""
    for end, time in (("begins", 0.0), ("ends", trajectory.duration)):
        speed = trajectory.derivative([time], 1)[0]
        worst = int(np.argmax(np.abs(speed)))
        if abs(speed[worst]) > AT_REST:
            joint = robot.coordinates[worst]
            raise OutputError(
                f"the motion {end} with {speed[worst]:.3g} {joint.unit}/s, "
                f"but {what} begins and ends at rest",
                where=f"joint '{joint.name}'",
                fix="design the motion from rest to rest, or with ramps",
            )


def fixed_point_text(value: float, decimals: int) -> str:
    """A number without exponent, which every controller reads as one; zero has no sign."""
    text = f"{value:.{decimals}f}"
    return text[1:] if not text.strip("-0.") and text[0] == "-" else text


def comma_row(values: Array, decimals: int) -> str:
    """Numbers with commas between them."""
    return ", ".join(fixed_point_text(value, decimals) for value in values)


def degrees_and_millimetres(robot: Robot) -> Array:
    """Factors from rad to degrees and from m to mm, shape `(n,)`."""
    return np.array([1e3 if c.kind == "prismatic" else 180.0 / np.pi for c in robot.coordinates])


def comment_head(trajectory: ExactTrajectory, robot: Robot, mark: str, *lines: str) -> list[str]:
    """Comment lines: what the file is, and `lines`; plain ASCII, as old controllers want it."""
    joints = ", ".join(robot.joint_names)
    title = f"Motion of robot '{robot.name}', {trajectory.duration:g} s, written by steelyard."
    texts = (title, f"Joints in this order: {joints}.", *lines)
    return [f"{mark} {_plain(text)}" for text in texts]


def _plain(text: str) -> str:
    """Text on one line of ASCII, without what ends a comment in XML."""
    return " ".join(text.encode("ascii", "replace").decode().split()).replace("--", "- -")


def csv_of(
    trajectory: ExactTrajectory, robot: Robot, rate: float, more: MoreColumns | None = None
) -> str:
    """A row every `1 / rate` seconds and one at the end, with all digits, in SI units.

    Columns are `time_s`, then `q_NAME`, `dq_NAME` and `ddq_NAME` of all joints, and `more` that
    follow from these.
    """
    times = grid_times(trajectory.duration, rate)
    names = [f"{what}_{c.name}" for what in ("q", "dq", "ddq") for c in robot.coordinates]
    parts = [trajectory.derivative(times, order) for order in range(3)]
    added = {} if more is None else more(*parts)
    table = np.column_stack([times, *parts, *added.values()])
    return csv_text([["time_s", *names, *added], *table.tolist()])


def keyframes_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """An MJCF file of keyframes, to be included in a model with the robot's joints.

    A keyframe has a position and a velocity for every joint of MuJoCo, depth first along the
    tree; joints that follow others (mimic) have theirs.
    """
    if robot.loops:
        raise OutputError(
            "keyframes need the positions of all joints, but loops determine some of them",
            where=f"robot '{robot.name}'",
            fix="export the motion in another format",
        )
    bodies = [robot.bodies[index] for index in _depth_first(robot)]
    followed = [body.coordinate for body in bodies]
    ratio, offset = [body.ratio for body in bodies], [body.offset for body in bodies]
    times = even_times(trajectory.duration, rate)
    q, dq = (trajectory.derivative(times, order) for order in range(2))
    joints = ", ".join(body.joint for body in bodies)
    top = f"{len(times)} keyframes in rad (prismatic joints: m). Include this file in a model whose"
    lines = comment_head(trajectory, robot, " ", top, f"joints are, in this order: {joints}.")
    lines = ["<mujoco>", "  <!--", *lines, "  -->", "  <keyframe>"]
    for t, position, velocity in zip(
        times.tolist(), q[:, followed] * ratio + offset, dq[:, followed] * ratio, strict=True
    ):
        qpos, qvel = (" ".join(map(repr, state.tolist())) for state in (position, velocity))
        state = f'qpos="{qpos}" qvel="{qvel}"'
        lines.append(f'    <key time="{t!r}" {state}/>')
    return "\n".join([*lines, "  </keyframe>", "</mujoco>", ""])


def _depth_first(robot: Robot, parent: int = -1) -> list[int]:
    found = []
    for index, body in enumerate(robot.bodies):
        if body.parent == parent:
            found += [index, *_depth_first(robot, index)]
    return found


APPROACH_SECONDS = 10  # in which the controller goes from wherever the robot is to the start
SPLINE_TOLERANCE = 5e-7  # what of the 1e-6 rad may be spent between two points [rad; m]
PEANO_BOUND = 6.2e-3  # bound of $C$, which is 0.006185 and reached at the middle of the step
BESIDE_JUMP_SECONDS = 1e-6  # how far before and after a jump of the acceleration points are put [s]

SECOND_DECIMALS = 9

Nanoseconds = np.ndarray[tuple[int], np.dtype[np.int64]]


def joint_trajectory_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """YAML of a message whose splines stay within 1e-6 rad (m) of the motion at all times.

    It has `rate` points a second, or more if the motion needs them.
    """
    refuse_moving_ends(trajectory, robot, "a joint_trajectory_controller")
    nanoseconds = spline_points(trajectory, rate)
    times = np.minimum(nanoseconds * 1e-9, trajectory.duration)
    q, dq, ddq = (trajectory.derivative(times, order) for order in range(3))
    way = "lead from wherever the robot is to the start of the motion."
    what = f"{len(q)} points; splines of degree five between them are within 1e-6 of the motion."
    lines = comment_head(trajectory, robot, "#", f"The first {APPROACH_SECONDS} s {way}", what)
    names = ", ".join(json.dumps(c.name) for c in robot.coordinates)
    lines += ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''"]
    lines += [f"joint_names: [{names}]", "points:"]
    for at, position, velocity, acceleration in zip(nanoseconds, q, dq, ddq, strict=True):
        second, rest = divmod(int(at), 10**9)
        lines += [
            f"- positions: [{comma_row(position, SECOND_DECIMALS)}]",
            f"  velocities: [{comma_row(velocity, SECOND_DECIMALS)}]",
            f"  accelerations: [{comma_row(acceleration, SECOND_DECIMALS)}]",
            f"  time_from_start: {{sec: {second + APPROACH_SECONDS}, nanosec: {rest}}}",
        ]
    return "\n".join([*lines, ""])


def spline_points(trajectory: ExactTrajectory, rate: float) -> Nanoseconds:
    """Times of points from which splines of degree five follow the motion, `(N,)` [ns]."""
    least, greatest = trajectory.extremes(3)
    step = np.cbrt(
        SPLINE_TOLERANCE / (PEANO_BOUND * max(float(np.max(greatest - least)) / 2.0, 1e-9))
    )
    rate = max(rate, 1.0 / step, 1.0 / trajectory.duration)
    grid_times(trajectory.duration, rate)
    jumps = _acceleration_jumps(trajectory)
    beside = [jumps - BESIDE_JUMP_SECONDS, jumps + BESIDE_JUMP_SECONDS]
    edges = np.sort(np.concatenate([[0.0, trajectory.duration], *beside]))
    return np.unique(np.rint(divided(edges, 1.0 / rate) * 1e9).astype(np.int64))


def _acceleration_jumps(trajectory: ExactTrajectory) -> Array:
    """Times within the motion at which an acceleration jumps by more than its jerk explains."""
    inner = np.asarray(trajectory.breaks)
    far = 2.0 * BESIDE_JUMP_SECONDS
    inner = inner[(inner > far) & (inner < trajectory.duration - far)]
    if not len(inner):
        return inner
    before = trajectory.derivative(inner - BESIDE_JUMP_SECONDS, 2)
    after = trajectory.derivative(inner + BESIDE_JUMP_SECONDS, 2)
    steepest = np.max(np.abs(trajectory.extremes(3)), axis=0)
    return np.asarray(
        inner[np.any(np.abs(after - before) > 4.0 * BESIDE_JUMP_SECONDS * steepest, axis=1)]
    )


UR_RATES = (125.0, 500.0)  # of the CB series, and of e-Series and later [1/s]

RADIAN_DECIMALS = 10
DEGREE_DECIMALS = 6  # decimals of positions in rad, and in degrees or mm

KRL_AXES = tuple(f"{kind}{number}" for kind in "AE" for number in range(1, 7))
NO_AXIS = "9E9"  # an external axis that is not there, in RAPID

SLOW_START_NOTE = (
    "Goes slowly to the start posture first. Before the first run compare signs and zeros of"
)
SLOW_AXES_NOTE = f"{SLOW_START_NOTE} the axes with the model's."


def urscript_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """A `servoj` for every step of the controller, after a slow `movej` to the start."""
    kinds = [c.kind for c in robot.coordinates]
    if kinds != ["revolute"] * 6:
        raise _unfit_motion(robot, "URScript", "six revolute joints", kinds.count("prismatic"))
    if rate not in UR_RATES:
        raise OutputError(
            f"UR controllers do not accept {rate:g} set points a second",
            where="rate of the export",
            fix="give 125 (CB series), or 500 (e-Series and later)",
        )
    refuse_moving_ends(trajectory, robot, "a UR's program")
    step = 1.0 / rate
    q = trajectory.derivative(grid_times(trajectory.duration, rate), 0)
    what = f"{len(q)} set points in rad, one every {step:g} s."
    start = f"{SLOW_START_NOTE} the arm's joints with the model's."
    lines = [*comment_head(trajectory, robot, "#", what, start), "def steelyard_motion():"]
    lines += [f"  movej([{comma_row(q[0], RADIAN_DECIMALS)}], a=0.5, v=0.2)", "  sleep(1.0)"]
    options = f"t={step:g}, lookahead_time=0.1, gain=300"
    lines += [f"  servoj([{comma_row(point, RADIAN_DECIMALS)}], {options})" for point in q]
    return "\n".join([*lines, "  stopj(1.0)", "end", ""])


def krl_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """A spline through points at equal times, after a slow PTP to the start; degrees and mm."""
    if robot.n > len(KRL_AXES):
        raise _unfit_motion(robot, "KRL", f"at most {len(KRL_AXES)} axes")
    refuse_moving_ends(trajectory, robot, "a KRL program")
    times = even_times(trajectory.duration, rate)
    targets = [
        ", ".join(
            f"{axis} {fixed_point_text(x, DEGREE_DECIMALS)}"
            for axis, x in zip(KRL_AXES, point, strict=False)
        )
        for point in trajectory.derivative(times, 0) * degrees_and_millimetres(robot)
    ]
    what = f"{_points_apart(times, f'{times[1]:.9g}')}; a spline leads through them."
    lines = ["&ACCESS RVP", "DEF trajectory( )"]
    lines += comment_head(trajectory, robot, ";", what, SLOW_AXES_NOTE)
    lines += ["BAS(#INITMOV, 0)", "BAS(#VEL_PTP, 10)", "BAS(#ACC_PTP, 10)"]
    lines += [f"PTP {{{targets[0]}}}", "BAS(#VEL_PTP, 100)", "BAS(#ACC_PTP, 100)"]
    lines += ["PTP_SPLINE", "  TIME_BLOCK START"]
    for target in targets[1:]:
        lines += [f"  SPTP {{{target}}}", "  TIME_BLOCK PART = 1.0"]
    lines.append(f"  TIME_BLOCK END = {fixed_point_text(trajectory.duration, DEGREE_DECIMALS)}")
    return "\n".join([*lines, "ENDSPLINE", "END", ""])


def rapid_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    r"""A `MoveAbsJ` per point with its time as `\T`, first a slow one to the start; degrees, mm."""
    if not 6 <= robot.n <= 12:
        raise _unfit_motion(robot, "RAPID", "six axes, and up to six external ones")
    refuse_moving_ends(trajectory, robot, "a RAPID program")
    times = even_times(trajectory.duration, rate)
    points = trajectory.derivative(times, 0) * degrees_and_millimetres(robot)
    step = fixed_point_text(times[1], DEGREE_DECIMALS)
    free = [NO_AXIS] * (12 - robot.n)
    what = f"{_points_apart(times, step)}; corners are rounded within zone z10."
    lines = ["MODULE Trajectory", *comment_head(trajectory, robot, "  !", what, SLOW_AXES_NOTE)]
    lines += ["  PROC SteelyardMotion()", "    VelSet 20, 5000;"]
    for number, point in enumerate(points):
        axes = [fixed_point_text(x, DEGREE_DECIMALS) for x in point] + free
        target = f"[[{', '.join(axes[:6])}], [{', '.join(axes[6:])}]]\\NoEOffs"
        speed = "v50" if number == 0 else f"v1000\\T:={step}"
        zone = "fine" if number in (0, len(points) - 1) else "z10"
        lines.append(f"    MoveAbsJ {target}, {speed}, {zone}, tool0;")
        lines += ["    VelSet 100, 5000;"] if number == 0 else []
    return "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def _points_apart(times: Array, step: str) -> str:
    return f"{len(times)} points in degrees (prismatic axes: mm), {step} s apart"


def _unfit_motion(robot: Robot, form: str, wanted: str, prismatic: int = 0) -> OutputError:
    has = f"{robot.n} joints" + (f", {prismatic} of them prismatic" if prismatic else "")
    return OutputError(
        f"{form} is for robots of {wanted}, this one has {has}",
        where=f"robot '{robot.name}'",
        fix="export the motion in another format",
    )


@dataclass(frozen=True)
class Export:
    """A format of motions: its file, the text of it, and points a second if none are requested.

    What a controller does `between` points, see `error_between`; `None` if the file is for none.
    """

    file: str
    text: Callable[[ExactTrajectory, Robot, float], str]
    rate: float
    between: str | None = None


EXPORTS: dict[str, Export] = {
    "csv": Export("trajectory.csv", csv_of, 500.0, "lines"),
    "ros2": Export("trajectory.yaml", joint_trajectory_of, 20.0, "quintic splines"),
    "urscript": Export("trajectory.script", urscript_of, 500.0, "lines"),
    "krl": Export("trajectory.src", krl_of, 10.0, "cubic spline"),
    "rapid": Export("trajectory.mod", rapid_of, 10.0, "rounded lines"),
    "mujoco": Export("trajectory.xml", keyframes_of, 50.0),
}


def exported(
    trajectory: ExactTrajectory,
    robot: Robot,
    form: str,
    rate: float | None = None,
    more: MoreColumns | None = None,
) -> str:
    """A motion as the text of a file in a format of `EXPORTS`, with `rate` points a second.

    A csv may have `more` columns.
    """
    export = _format_of_name(form)
    rate = export.rate if rate is None else rate
    if not 0.0 < rate < inf:
        raise OutputError(
            f"{rate:g} points per second are not a valid rate",
            where="rate of the export",
            fix="give a number of points per second above 0",
        )
    if form == "csv":
        return csv_of(trajectory, robot, rate, more)
    return export.text(trajectory, robot, rate)


def write_export(
    trajectory: ExactTrajectory,
    robot: Robot,
    form: str,
    folder: Path,
    rate: float | None = None,
    more: MoreColumns | None = None,
) -> Path:
    """Write a motion to a folder, under the format's file name; the file."""
    path = folder / _format_of_name(form).file
    refuse_existing(path)
    text = exported(trajectory, robot, form, rate, more)
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return path


def _format_of_name(form: str) -> Export:
    wrong, where = f"there is no format '{form}' for motions", "format of the export"
    refuse_unknown(form, EXPORTS, wrong, where, "formats", OutputError)
    return EXPORTS[form]
