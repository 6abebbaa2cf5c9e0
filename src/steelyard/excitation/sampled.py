"""A motion given as a table of postures."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.motion import Motion


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A motion through given postures: the cubic spline that starts and ends without speed.

    Attributes:
        t: Times, shape `(N,)` [s], increasing; kept from zero on.
        q: Postures, shape `(N, n)` [rad; m].
    """

    t: Array
    q: Array

    def __post_init__(self) -> None:
        t = frozen(self.t, (None,))
        if len(t) < 2 or not np.all(np.diff(t) > 0.0):
            raise ValueError("a motion needs two times or more, each later than the one before")
        object.__setattr__(self, "t", frozen(t - t[0]))
        object.__setattr__(self, "q", frozen(self.q, (len(t), None)))

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.t[-1])

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` [s]; at rest before its start and after its end."""
        t = frozen(t, (None,))
        clipped = np.clip(t, 0.0, self.duration)
        inside = ((t >= 0.0) & (t <= self.duration))[:, None]
        q, dq, ddq = (self._spline(clipped, order) for order in range(3))
        return Motion(t, q, np.where(inside, dq, 0.0), np.where(inside, ddq, 0.0))

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        return {"kind": "sampled", "time_s": self.t.tolist(), "q": self.q.tolist()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "SampledMotion":
        """The inverse of `to_dict`."""
        return cls(values["time_s"], values["q"])

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.t, self.q, bc_type="clamped")
