"""Motions as programs of robot controllers: URScript, KUKA KRL, ABB RAPID."""

from steelyard.errors import OutputError
from steelyard.excitation.export.points import (
    degrees_and_millimetres,
    even_times,
    fixed,
    grid_times,
    head,
    refuse_moving_ends,
    row,
)
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.robot.robot import Robot

UR_RATES = (125.0, 500.0)
"""Control rates of the UR controllers: CB series, and e-Series and later [1/s]."""

RADIANS = 10
DEGREES = 6
"""Decimals of positions in rad, and in degrees or mm."""

KRL_AXES = tuple(f"{kind}{number}" for kind in "AE" for number in range(1, 7))
NO_AXIS = "9E9"
"""An external axis that is not there, in RAPID."""

SLOW = "Goes slowly to the start posture first. Before the first run compare signs and zeros of"


def urscript_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """A `servoj` for every step of the controller, after a slow `movej` to the start.

    Raises:
        OutputError: The robot is not one of six revolute joints, or the rate is not a UR's.
    """
    kinds = [c.kind for c in robot.coordinates]
    if kinds != ["revolute"] * 6:
        raise _unfit(robot, "URScript", "six revolute joints", kinds.count("prismatic"))
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
    lines = head(
        trajectory,
        robot,
        "#",
        f"{len(q)} set points in rad, one every {step:g} s.",
        f"{SLOW} the arm's joints with the model's.",
    )
    lines += ["def steelyard_motion():", f"  movej([{row(q[0], RADIANS)}], a=0.5, v=0.2)"]
    lines += ["  sleep(1.0)"]
    options = f"t={step:g}, lookahead_time=0.1, gain=300"
    lines += [f"  servoj([{row(point, RADIANS)}], {options})" for point in q]
    return "\n".join([*lines, "  stopj(1.0)", "end", ""])


def krl_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """A spline through points at equal times, after a slow PTP to the start; degrees and mm.

    Raises:
        OutputError: The robot has more axes than KRL.
    """
    if robot.n > len(KRL_AXES):
        raise _unfit(robot, "KRL", f"at most {len(KRL_AXES)} axes")
    refuse_moving_ends(trajectory, robot, "a KRL program")
    times = even_times(trajectory.duration, rate)
    points = trajectory.derivative(times, 0) * degrees_and_millimetres(robot)
    targets = [
        ", ".join(f"{axis} {fixed(x, DEGREES)}" for axis, x in zip(KRL_AXES, point, strict=False))
        for point in points
    ]
    lines = ["&ACCESS RVP", "DEF trajectory( )"]
    lines += head(
        trajectory,
        robot,
        ";",
        f"{len(times)} points in degrees (prismatic axes: mm), {times[1]:.9g} s apart; "
        "a spline leads through them.",
        f"{SLOW} the axes with the model's.",
    )
    lines += ["BAS(#INITMOV, 0)", "BAS(#VEL_PTP, 10)", "BAS(#ACC_PTP, 10)"]
    lines += [f"PTP {{{targets[0]}}}", "BAS(#VEL_PTP, 100)", "BAS(#ACC_PTP, 100)"]
    lines += ["PTP_SPLINE", "  TIME_BLOCK START"]
    for target in targets[1:]:
        lines += [f"  SPTP {{{target}}}", "  TIME_BLOCK PART = 1.0"]
    lines += [f"  TIME_BLOCK END = {fixed(trajectory.duration, DEGREES)}", "ENDSPLINE", "END", ""]
    return "\n".join(lines)


def rapid_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    r"""A `MoveAbsJ` per point with its time as `\T`, after a slow one to the start; degrees and mm.

    Raises:
        OutputError: The robot does not have six to twelve axes.
    """
    if not 6 <= robot.n <= 12:
        raise _unfit(robot, "RAPID", "six axes, and up to six external ones")
    refuse_moving_ends(trajectory, robot, "a RAPID program")
    times = even_times(trajectory.duration, rate)
    points = trajectory.derivative(times, 0) * degrees_and_millimetres(robot)
    step = fixed(times[1], DEGREES)
    free = [NO_AXIS] * (12 - robot.n)
    lines = ["MODULE Trajectory"]
    lines += head(
        trajectory,
        robot,
        "  !",
        f"{len(times)} points in degrees (prismatic axes: mm), {step} s apart; "
        "corners are rounded within zone z10.",
        f"{SLOW} the axes with the model's.",
    )
    lines += ["  PROC SteelyardMotion()", "    VelSet 20, 5000;"]
    for number, point in enumerate(points):
        axes = [fixed(x, DEGREES) for x in point] + free
        target = f"[[{', '.join(axes[:6])}], [{', '.join(axes[6:])}]]\\NoEOffs"
        speed = "v50" if number == 0 else f"v1000\\T:={step}"
        zone = "fine" if number in (0, len(points) - 1) else "z10"
        lines.append(f"    MoveAbsJ {target}, {speed}, {zone}, tool0;")
        lines += ["    VelSet 100, 5000;"] if number == 0 else []
    return "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def _unfit(robot: Robot, form: str, wanted: str, prismatic: int = 0) -> OutputError:
    has = f"{robot.n} joints" + (f", {prismatic} of them prismatic" if prismatic else "")
    return OutputError(
        f"{form} is for robots of {wanted}, this one has {has}",
        where=f"robot '{robot.name}'",
        fix="export the motion in another format",
    )
