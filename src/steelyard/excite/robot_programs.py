"""Motions as programs of robot controllers: URScript, KRL, RAPID."""

from steelyard.base.arrays import Array
from steelyard.base.errors import OutputError
from steelyard.excite.sampled_motion_files import (
    comma_row,
    comment_head,
    degrees_and_millimetres,
    even_times,
    fixed_point_text,
    grid_times,
    refuse_moving_ends,
)
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.robot.robot import Robot

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
    times = grid_times(trajectory.duration, rate)
    q = trajectory.derivative(times, 0)
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
    points = trajectory.derivative(times, 0) * degrees_and_millimetres(robot)
    targets = [
        ", ".join(
            f"{axis} {fixed_point_text(x, DEGREE_DECIMALS)}"
            for axis, x in zip(KRL_AXES, point, strict=False)
        )
        for point in points
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
