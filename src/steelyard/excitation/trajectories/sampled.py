"""A motion given as a table of postures."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion, from_scipy
from steelyard.motion import Motion


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A motion through given postures: the cubic spline that starts and ends with given speeds.

    Attributes:
        t: Times, shape `(N,)` [s], increasing; kept from zero on.
        q: Postures, shape `(N, n)` [rad; m].
        ends: Speeds at the first and the last time, shape `(2, n)` [rad/s; m/s]; `None`: at rest.
    """

    t: Array
    q: Array
    ends: Array | None = None

    def __post_init__(self) -> None:
        t = frozen(self.t, (None,))
        if len(t) < 2 or not np.all(np.diff(t) > 0.0):
            raise ValueError("a motion needs two times or more, each later than the one before")
        object.__setattr__(self, "t", frozen(t - t[0]))
        object.__setattr__(self, "q", frozen(self.q, (len(t), None)))
        if not (np.isfinite(t).all() and np.isfinite(self.q).all()):
            raise ValueError("a time or a posture of the table is not finite")
        if self.ends is not None:
            object.__setattr__(self, "ends", frozen(self.ends, (2, self.q.shape[1])))
            if not np.isfinite(self.ends).all():
                raise ValueError("a speed at the motion's start or end is not finite")

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.t[-1])

    @property
    def breaks(self) -> Array:
        """The times of the postures, shape `(N,)` [s]."""
        return self.t

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Any order, 0 for the position, at times from 0 to the duration, shape `(N, n)`."""
        return self._pieces.derivative(t, order)

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; both sides of a break count."""
        return self._pieces.extremes(order)

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        return self._pieces.sample(t)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        values = {"kind": "sampled", "time_s": self.t.tolist(), "q": self.q.tolist()}
        return values if self.ends is None else values | {"ends": self.ends.tolist()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "SampledMotion":
        """The inverse of `to_dict`."""
        return cls(values["time_s"], values["q"], values.get("ends"))

    @cached_property
    def _pieces(self) -> PiecewiseMotion:
        from scipy.interpolate import CubicSpline

        start, end = np.zeros((2, self.q.shape[1])) if self.ends is None else self.ends
        return from_scipy(CubicSpline(self.t, self.q, bc_type=((1, start), (1, end))))


def end_speeds(t: Array, q: Array) -> Array:
    """Speeds of a table of postures in its first and its last row, which need not be at rest.

    They are those of the not-a-knot cubic spline. A joint is at rest where its speed there is not
    larger than the error of differentiation, taken as the difference from the parabola through the
    three rows at that end. With fewer than four rows all joints are at rest.

    Args:
        t: Times, shape `(N,)` [s], increasing.
        q: Postures, shape `(N, n)` [rad; m].

    Returns:
        Shape `(2, n)` [rad/s; m/s].
    """
    from scipy.interpolate import CubicSpline

    if len(t) < 4:
        return np.zeros((2, q.shape[1]))
    speeds = CubicSpline(t, q)(t[[0, -1]], 1)
    first, last = CubicSpline(t[:3], q[:3])(t[0], 1), CubicSpline(t[-3:], q[-3:])(t[-1], 1)
    return np.where(np.abs(speeds) > np.abs(speeds - [first, last]), speeds, 0.0)
