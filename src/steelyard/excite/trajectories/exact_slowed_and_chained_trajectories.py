"""Motions whose extremes over all times are known, slowed and chained."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.motion import Motion, numbers

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
        t = np.atleast_1d(numbers("t", t, [(), (None,)]))
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
