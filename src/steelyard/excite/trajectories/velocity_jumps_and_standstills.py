"""Jumps of velocity, ends at which a motion does not rest, times at which it stands still."""

from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.robot.robot import Robot

ROUNDING_JUMP_SHARE = 1e-9  # changes of velocity below this share of its limit are rounding

_JUMP_STEP_ULPS = 8.0


@dataclass(frozen=True)
class Jump:
    """A velocity that differs by `size` before and after a `time` [s]: infinite acceleration."""

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
    """The greatest jump of each joint that has one; velocities are limited to `limit`, `(n,)`."""
    end = trajectory.duration
    times = np.asarray(trajectory.breaks)
    times = times[(times > 0.0) & (times < end)]
    if not len(times):
        return ()
    # so far apart that times which are rounded within parts of the motion stay on their side
    step = _JUMP_STEP_ULPS * np.spacing(end)
    before = trajectory.derivative(np.maximum(times - step, 0.0), 1)
    after = trajectory.derivative(np.minimum(times + step, end), 1)
    sizes = np.abs(after - before)
    steepest = np.max(np.abs(trajectory.extremes(2)), axis=0)
    beyond = sizes - ROUNDING_JUMP_SHARE * limit - 2.0 * step * steepest
    worst = np.argmax(beyond, axis=0)
    return tuple(
        Jump(joint.name, f"{joint.unit}/s", float(sizes[worst[j], j]), float(times[worst[j]]))
        for j, joint in enumerate(robot.coordinates)
        if beyond[worst[j], j] > 0.0
    )


def unrest(trajectory: ExactTrajectory, limit: Array) -> tuple[str, ...]:
    """A sentence for each end at which the motion does not rest; speeds are limited to `limit`."""
    speeds = np.abs(trajectory.derivative([0.0, trajectory.duration], 1))
    begins, ends = np.any(speeds > ROUNDING_JUMP_SHARE * limit, axis=1)
    notes = []
    if begins:
        notes.append("the motion does not start at rest: the robot must already be moving")
    if ends:
        notes.append("the motion does not end at rest: the robot must be stopped afterwards")
    return tuple(notes)


HOLD_TEST_PLACES = (0.1, 0.5, 0.9)  # between two breaks, at which a hold is tested
STILL_SPEED_SHARE = 1e-9  # speed below which all joints stand still, over the motion's highest
SHORTEST_HOLD = 1e-3  # shortest time that counts as a hold [s]


def holds(motion: ExactTrajectory) -> Array:
    """Times for which all joints stand still, in their order [s]."""
    starts, ends = motion.breaks[:-1], motion.breaks[1:]
    fastest = max(float(np.max(np.abs(side))) for side in motion.extremes(1))
    times = starts[:, None] + np.outer(ends - starts, HOLD_TEST_PLACES)
    speeds = np.abs(motion.derivative(times.ravel(), 1)).reshape(*times.shape, -1)
    still = np.all(speeds <= STILL_SPEED_SHARE * fastest, axis=(1, 2))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False]))))
    lengths = np.array([motion.breaks[b] - motion.breaks[a] for a, b in edges.reshape(-1, 2)])
    return lengths[lengths >= SHORTEST_HOLD]


def holds_note(motion: ExactTrajectory) -> tuple[str, ...]:
    """One note on how often and how long a motion stands still; none if it never does."""
    found = holds(motion)
    if not len(found):
        return ()
    least, most = float(found.min()), float(found.max())
    same = most - least <= 1e-6 * most
    each = f"{most:.3g} s each time" if same else f"{least:.3g} to {most:.3g} s each time"
    times = "once" if len(found) == 1 else f"{len(found)} times"
    return (f"all joints are at standstill {times}: {each}, {found.sum():.3g} s in all",)
