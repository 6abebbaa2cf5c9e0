"""Trajectories whose extremes over all times are known; slowed, chained; jumps and holds."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.motion import Motion, sample_times
from steelyard.robot.robot import Robot

ORDERS = ("position", "velocity", "acceleration", "jerk")  # derivatives by their order


class ExactTrajectory(ABC):
    """A motion that can be differentiated, bounded and stored."""

    @property
    @abstractmethod
    def duration(self) -> float:
        """Length in time [s]."""

    @property
    @abstractmethod
    def breaks(self) -> Array:
        """Times, ascending from 0 to the duration, between which all is smooth, `(k,)` [s]."""

    @abstractmethod
    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Order 0 (position) to 4 at times `t` from 0 to the duration, shape `(N, n)`.

        At a break, derivatives are those of the piece that begins.
        """

    @abstractmethod
    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; both sides of a break count."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """As values for JSON, with a `kind`; numbers keep all their digits."""

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        t = sample_times(t)
        clipped = np.clip(t, 0.0, self.duration)
        inside = ((t >= 0.0) & (t <= self.duration))[:, None]
        q, dq, ddq = (self.derivative(clipped, order) for order in range(3))
        return Motion(t, q, np.where(inside, dq, 0.0), np.where(inside, ddq, 0.0))


@dataclass(frozen=True, eq=False)
class SlowedMotion(ExactTrajectory):
    r"""Another motion at the share `factor` $f$ of its speed, above 0: $q(t) = q_0(f t)$."""

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
        """Those of the motion, later."""
        return frozen(self.motion.breaks / self.factor)

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """See `ExactTrajectory`."""
        inner = np.minimum(frozen(t, (None,)) * self.factor, self.motion.duration)
        return frozen(self.motion.derivative(inner, order) * self.factor**order)

    def extremes(self, order: int) -> tuple[Array, Array]:
        """See `ExactTrajectory`."""
        least, greatest = self.motion.extremes(order)
        return frozen(least * self.factor**order), frozen(greatest * self.factor**order)

    def to_dict(self) -> dict[str, Any]:
        """See `ExactTrajectory`."""
        return {"kind": "slowed", "factor": self.factor, "motion": self.motion.to_dict()}


JOIN_TOLERANCE = 1e-9  # positions closer than this are one [rad; m], relative above 1


def check_join(ends: Array, starts: Array, times: Array) -> None:
    """Postures before and after each of the times, both `(k, n)`, are the same."""
    jump = np.abs(starts - ends)
    excess = jump - JOIN_TOLERANCE * np.maximum(1.0, np.abs(ends))
    if np.any(excess > 0.0):
        row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
        raise ValueError(
            f"the parts of the motion do not join: joint {joint + 1} jumps by "
            f"{jump[row, joint]:.3g} at {times[row]:.6g} s"
        )


@dataclass(frozen=True, eq=False)
class ChainedMotion(ExactTrajectory):
    """Parts one after another, each beginning where the one before ends."""

    parts: Sequence[ExactTrajectory]
    times: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts or self.times < 1:
            raise ValueError(f"{self.times} times {len(self.parts)} parts are no motion")
        ends = [part.derivative([0.0, part.duration], 0) for part in self.parts]
        joints = {values.shape[1] for values in ends}
        if len(joints) > 1:
            raise ValueError(f"the parts move {sorted(joints)} joints, not all the same number")
        starts = np.array([start for start, _ in ends])
        following = np.roll(starts, -1, axis=0)[: len(ends) if self.times > 1 else -1]
        before = np.array([end for _, end in ends])[: len(following)]
        check_join(before, following, self._ends[: len(following)])

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.times * self._ends[-1])

    @cached_property
    def breaks(self) -> Array:
        """Those of the parts, and where they meet, shape `(k,)` [s]."""
        starts = self._ends - [part.duration for part in self.parts]
        once = [start + p.breaks[:-1] for start, p in zip(starts, self.parts, strict=True)]
        rounds = self._ends[-1] * np.arange(self.times)
        inner = (rounds[:, None] + np.concatenate(once)).ravel()
        return np.append(inner[inner < self.duration], self.duration)

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """See `ExactTrajectory`."""
        clipped = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        rounds = np.clip(clipped // self._ends[-1], 0, self.times - 1)
        inside = clipped - rounds * self._ends[-1]
        which = np.searchsorted(self._ends[:-1], inside, side="right")
        values = np.empty((len(inside), self.parts[0].derivative([0.0], 0).shape[1]))
        for number in np.unique(which):
            here, part = which == number, self.parts[number]
            local = inside[here] - (self._ends[number] - part.duration)
            values[here] = part.derivative(np.clip(local, 0.0, part.duration), order)
        return values

    def extremes(self, order: int) -> tuple[Array, Array]:
        """See `ExactTrajectory`."""
        least, greatest = zip(*(part.extremes(order) for part in self.parts), strict=True)
        return np.min(least, axis=0), np.max(greatest, axis=0)

    def to_dict(self) -> dict[str, Any]:
        """See `ExactTrajectory`."""
        parts = [part.to_dict() for part in self.parts]
        return {"kind": "chained", "times": self.times, "parts": parts}

    @cached_property
    def _ends(self) -> Array:
        """When each part ends for the first time, shape `(parts,)` [s]."""
        return np.cumsum([part.duration for part in self.parts])


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
