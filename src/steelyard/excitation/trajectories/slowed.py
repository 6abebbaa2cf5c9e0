"""A motion at reduced speed, along the same path."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.motion import Motion, sample_times


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
