"""Motions one after another, and again."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.trajectories.fourier import FourierMotion
from steelyard.excitation.trajectories.piecewise import check_join
from steelyard.excitation.trajectories.sampling import sampled
from steelyard.motion import Motion


@dataclass(frozen=True, eq=False)
class ChainedMotion:
    """Parts one after another, each beginning where the one before ends.

    Attributes:
        parts: One or more, of the same joints.
        times: How often all parts are run through.
    """

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
        """Order 0 (position) or higher at times from 0 to the duration, shape `(N, n)`."""
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
        """Least and greatest value over all times, each `(n,)`; both sides of a break count."""
        least, greatest = zip(*(part.extremes(order) for part in self.parts), strict=True)
        return np.min(least, axis=0), np.max(greatest, axis=0)

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        return sampled(self, t)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        parts = [part.to_dict() for part in self.parts]
        return {"kind": "chained", "times": self.times, "parts": parts}

    @cached_property
    def _ends(self) -> Array:
        """When each part ends for the first time, shape `(parts,)` [s]."""
        return np.cumsum([part.duration for part in self.parts])


def repeated(trajectory: ExactTrajectory, times: int) -> ExactTrajectory:
    """The trajectory several times without a stop.

    Raises:
        ValueError: It does not end where it starts.
    """
    if isinstance(trajectory, FourierMotion):
        return replace(trajectory, periods=times * trajectory.periods)
    if isinstance(trajectory, ChainedMotion):
        return replace(trajectory, times=times * trajectory.times)
    return trajectory if times == 1 else ChainedMotion((trajectory,), times)
