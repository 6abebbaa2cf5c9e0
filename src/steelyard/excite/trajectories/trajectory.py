"""Trajectories whose extremes over all times are known; samples, rests, slowed motion."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.motion import Motion, Trajectory, sample_times
from steelyard.robot.robot import Robot

ORDERS = ("position", "velocity", "acceleration", "jerk")
"""Derivatives by their order."""


class ExactTrajectory(Trajectory, Protocol):
    """A motion that can be differentiated, bounded and stored.

    Attributes:
        breaks: Times, ascending, from 0 to the duration; between two of them position, velocity,
            acceleration and jerk are continuous.
    """

    @property
    def breaks(self) -> Array:
        """Shape `(k,)` [s]."""
        ...

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Order 0 (position) to 4 at times `t` from 0 to the duration, shape `(N, n)`."""
        ...

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; orders as those of `derivative`.

        Both sides of a break count.
        """
        ...

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON, with a `kind`."""
        ...


def sampled(trajectory: ExactTrajectory, t: ArrayLike) -> Motion:
    """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
    t = sample_times(t)
    clipped = np.clip(t, 0.0, trajectory.duration)
    inside = ((t >= 0.0) & (t <= trajectory.duration))[:, None]
    q, dq, ddq = (trajectory.derivative(clipped, order) for order in range(3))
    return Motion(t, q, np.where(inside, dq, 0.0), np.where(inside, ddq, 0.0))


@dataclass(frozen=True, eq=False)
class SlowedMotion:
    r"""Another motion with time stretched: $q(t) = q_0(f t)$.

    Attributes:
        motion: The motion at full speed $q_0$.
        factor: Share of the speed $f$, above 0 and at most 1.
    """

    motion: ExactTrajectory
    factor: float

    def __post_init__(self) -> None:
        if not 0.0 < self.factor <= 1.0:
            raise ValueError(f"{self.factor:g} of the speed is not a reduced speed")

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.motion.duration / self.factor

    @property
    def breaks(self) -> Array:
        """Times between which position to jerk are continuous, shape `(k,)` [s]."""
        return frozen(self.motion.breaks / self.factor)

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]."""
        t = sample_times(t)
        inner = self.motion.sample(t * self.factor)
        return Motion(t, inner.q, inner.dq * self.factor, inner.ddq * self.factor**2)

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Order 0 (position) to 3 (jerk) at times `t` from 0 to the duration, shape `(N, n)`."""
        inner = np.minimum(frozen(t, (None,)) * self.factor, self.motion.duration)
        return frozen(self.motion.derivative(inner, order) * self.factor**order)

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`."""
        least, greatest = self.motion.extremes(order)
        return frozen(least * self.factor**order), frozen(greatest * self.factor**order)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON."""
        return {"kind": "slowed", "factor": self.factor, "motion": self.motion.to_dict()}


ROUNDING_JUMP_SHARE = 1e-9
"""Changes of velocity below this share of its limit are rounding."""

_JUMP_STEP_ULPS = 8.0


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
    """A sentence for each end at which the motion does not rest.

    Args:
        trajectory: The motion.
        limit: Of velocities, shape `(n,)` [rad/s; m/s].
    """
    speeds = np.abs(trajectory.derivative([0.0, trajectory.duration], 1))
    begins, ends = np.any(speeds > ROUNDING_JUMP_SHARE * limit, axis=1)
    notes = []
    if begins:
        notes.append("the motion does not start at rest: the robot must already be moving")
    if ends:
        notes.append("the motion does not end at rest: the robot must be stopped afterwards")
    return tuple(notes)


HOLD_TEST_PLACES = (0.1, 0.5, 0.9)
"""Places between two breaks at which a motion that stands still is looked at."""
STILL_SPEED_SHARE = 1e-9
"""Speed below which all joints stand still, over the motion's highest."""
SHORTEST_HOLD = 1e-3
"""Shortest time that counts as a hold [s]."""


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
