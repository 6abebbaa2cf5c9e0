r"""Motions for ROS 2, as `trajectory_msgs/JointTrajectory`.

Between two points with positions, velocities and accelerations `joint_trajectory_controller`
takes the polynomial of degree five through them. If accelerations are continuous in between,
its error is at most $C h^3 (\max \dddot q - \min \dddot q) / 2$ over a step $h$: the error
functional vanishes for polynomials of degree five, a constant may be taken from the jerk, and $C$
is the greatest integral of the magnitude of its Peano kernel [Davis1963].
"""

import json
from math import ceil

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.export.points import (
    grid_times,
    head,
    orders_at,
    refuse_moving_ends,
    row,
)
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.robot.robot import Robot

APPROACH = 10
"""Seconds in which the controller goes from wherever the robot is to the start."""

TOLERANCE = 5e-7
"""What of the 1e-6 rad may be spent between two points [rad; m]."""

PEANO = 6.2e-3
r"""Bound of $C$, which is 0.006185 and reached at the middle of the step."""

BESIDE = 1e-6
"""How far before and after a jump of the acceleration points are put [s]."""

DECIMALS = 9

Nanoseconds = np.ndarray[tuple[int], np.dtype[np.int64]]


def joint_trajectory_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """YAML of a message whose splines stay within 1e-6 rad (m) of the motion at all times.

    Args:
        trajectory: The motion, from rest to rest.
        robot: Names its joints.
        rate: Points a second, at least; there are more if the motion needs them.

    Raises:
        OutputError: The motion begins or ends with a speed, or there are too many points.
    """
    refuse_moving_ends(trajectory, robot, "a joint_trajectory_controller")
    nanoseconds = spline_points(trajectory, rate)
    q, dq, ddq = orders_at(trajectory, np.minimum(nanoseconds * 1e-9, trajectory.duration))
    lines = head(
        trajectory,
        robot,
        "#",
        f"The first {APPROACH} s lead from wherever the robot is to the start of the motion.",
        f"{len(q)} points; splines of degree five between them are within 1e-6 of the motion.",
    )
    names = ", ".join(json.dumps(c.name) for c in robot.coordinates)
    lines += ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''"]
    lines += [f"joint_names: [{names}]", "points:"]
    for at, position, velocity, acceleration in zip(nanoseconds, q, dq, ddq, strict=True):
        second, rest = divmod(int(at), 10**9)
        lines += [
            f"- positions: [{row(position, DECIMALS)}]",
            f"  velocities: [{row(velocity, DECIMALS)}]",
            f"  accelerations: [{row(acceleration, DECIMALS)}]",
            f"  time_from_start: {{sec: {second + APPROACH}, nanosec: {rest}}}",
        ]
    return "\n".join([*lines, ""])


def spline_points(trajectory: ExactTrajectory, rate: float) -> Nanoseconds:
    """Times of points from which splines of degree five follow the motion, `(N,)` [ns].

    Args:
        trajectory: The motion.
        rate: Points a second, at least.
    """
    least, greatest = trajectory.extremes(3)
    step = np.cbrt(TOLERANCE / (PEANO * max(float(np.max(greatest - least)) / 2.0, 1e-9)))
    rate = max(rate, 1.0 / step, 1.0 / trajectory.duration)
    grid_times(trajectory.duration, rate)
    jumps = _jumps(trajectory)
    edges = np.sort(np.concatenate([[0.0, trajectory.duration], jumps - BESIDE, jumps + BESIDE]))
    counts = [max(1, ceil((b - a) * rate)) for a, b in zip(edges, edges[1:], strict=False)]
    pieces = [
        np.linspace(a, b, count, endpoint=False)
        for a, b, count in zip(edges, edges[1:], counts, strict=False)
    ]
    times = np.concatenate([*pieces, edges[-1:]])
    return np.unique(np.rint(times * 1e9).astype(np.int64))


def _jumps(trajectory: ExactTrajectory) -> Array:
    """Times within the motion at which an acceleration jumps by more than its jerk explains."""
    inner = np.asarray(trajectory.breaks)
    far = 2.0 * BESIDE
    inner = inner[(inner > far) & (inner < trajectory.duration - far)]
    if not len(inner):
        return inner
    before = trajectory.derivative(inner - BESIDE, 2)
    after = trajectory.derivative(inner + BESIDE, 2)
    steepest = np.max(np.abs(trajectory.extremes(3)), axis=0)
    return np.asarray(inner[np.any(np.abs(after - before) > 4.0 * BESIDE * steepest, axis=1)])
