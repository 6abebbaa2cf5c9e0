"""Where the velocity of a motion jumps, and whether it rests at its ends."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.robot.robot import Robot

SHARE = 1e-9
"""Changes of velocity below this share of its limit are rounding."""

_APART = 8.0


@dataclass(frozen=True)
class Jump:
    """A velocity that differs on the two sides of an instant: an infinite acceleration.

    Attributes:
        joint: Name of the joint.
        unit: Of the velocity.
        size: By how much it jumps.
        time: When [s].
    """

    joint: str
    unit: str
    size: float
    time: float

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"velocity of '{self.joint}' jumps by {self.size:.3g} {self.unit} "
            f"at t = {self.time:.6g} s"
        )


def velocity_jumps(robot: Robot, trajectory: ExactTrajectory, limit: Array) -> tuple[Jump, ...]:
    """The greatest jump of each joint that has one.

    Args:
        robot: Gives names and units.
        trajectory: The motion.
        limit: Of velocities, shape `(n,)` [rad/s; m/s].
    """
    end = trajectory.duration
    times = np.asarray(trajectory.breaks)
    times = times[(times > 0.0) & (times < end)]
    if not len(times):
        return ()
    # so far apart that times which are rounded within parts of the motion stay on their side
    step = _APART * np.spacing(end)
    before = trajectory.derivative(np.maximum(times - step, 0.0), 1)
    after = trajectory.derivative(np.minimum(times + step, end), 1)
    sizes = np.abs(after - before)
    steepest = np.max(np.abs(trajectory.extremes(2)), axis=0)
    beyond = sizes - SHARE * limit - 2.0 * step * steepest
    worst = np.argmax(beyond, axis=0)
    return tuple(
        Jump(joint.name, f"{joint.unit}/s", float(sizes[worst[j], j]), float(times[worst[j]]))
        for j, joint in enumerate(robot.coordinates)
        if beyond[worst[j], j] > 0.0
    )


def unrest(trajectory: ExactTrajectory, limit: Array) -> tuple[str, ...]:
    """A sentence for each end at which the motion does not rest.

    Args:
        trajectory: The motion.
        limit: Of velocities, shape `(n,)` [rad/s; m/s].
    """
    speeds = np.abs(trajectory.derivative([0.0, trajectory.duration], 1))
    begins, ends = np.any(speeds > SHARE * limit, axis=1)
    notes = []
    if begins:
        notes.append("the motion does not start at rest: the robot must already be moving")
    if ends:
        notes.append("the motion does not end at rest: the robot must be stopped afterwards")
    return tuple(notes)
