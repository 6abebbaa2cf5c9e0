"""Bases of B-splines."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.excitation.bases.linear_basis import LinearBasis, check_times, checked_postures
from steelyard.excitation.trajectories.minimum_jerk import SMOOTH
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion, from_scipy

_REST = 3
"""Equal control points at an end make velocity and acceleration zero there."""


@dataclass(frozen=True, eq=False)
class SplineBasis(LinearBasis):
    """B-splines on even knots, clamped, with velocity and acceleration zero at both ends.

    The first three control points are the posture at the start, the last three that at the end; the
    ones between are the coefficients. Without a `start`, the posture at both ends is one more and
    the last [DeBoor2001].

    Attributes:
        joints: Number of joints `n`.
        seconds: Length in time [s].
        control_points: Their number, those at the ends included; 7 or more.
        degree: 3 or 5.
        start: Posture at the start, shape `(n,)`, if it is not to be chosen.
        end: Posture at the end if it is not the start's; only with a `start`.
    """

    joints: int
    seconds: float
    control_points: int
    degree: int = 5
    start: Array | None = None
    end: Array | None = None

    def __post_init__(self) -> None:
        check_times(seconds=self.seconds)
        checked_postures(self.joints, self.start, self.end)
        if self.degree not in (3, 5):
            raise ValueError(f"the splines' degree is 3 or 5, not {self.degree}")
        if self.inner < 1:
            raise ValueError(f"a spline needs 7 control points or more, not {self.control_points}")
        if self.end is not None and self.start is None:
            raise ValueError("an end posture of its own needs a start posture")

    @property
    def inner(self) -> int:
        """Number of control points that are free."""
        return self.control_points - 2 * _REST

    @property
    def count(self) -> int:
        """Functions per joint."""
        return self.inner + (self.start is None)

    @property
    def highest(self) -> float:
        """Two knot spans hold one wave at most [Hz]."""
        return 0.5 * (self.control_points - self.degree) / self.seconds

    @property
    def prescribed_postures(self) -> tuple[Array, ...]:
        """Start and end, as far as they are given."""
        return checked_postures(self.joints, self.start, self.end)

    def still(self, posture: Array) -> Array:
        """All free control points at the posture, or at the given start.

        A given end is gone to nearly as by a minimum-jerk move: the control points lie on it.
        """
        place = frozen(posture if self.start is None else self.start, (self.joints,))
        still = np.repeat(place[:, None], self.count, axis=1)
        if self.end is None:
            return still
        shares = np.polynomial.polynomial.polyval(self._places, SMOOTH)
        return still + np.outer(self.end - place, shares)

    @property
    def _places(self) -> Array:
        """Where each free control point acts, as a share of the time, shape `(inner,)`."""
        even = np.linspace(0.0, 1.0, self.control_points - self.degree + 1)
        knots = np.pad(even, self.degree, mode="edge")
        means = [knots[k + 1 : k + 1 + self.degree].mean() for k in range(self.control_points)]
        return np.array(means[_REST:-_REST])

    def made_of(self, rows: Array) -> PiecewiseMotion:
        """The motion of inner control points, start and perhaps end in the columns."""
        from scipy.interpolate import BSpline

        inner, start, end = rows[:, : self.inner], rows[:, self.inner], rows[:, -1]
        points = np.vstack([*[start] * _REST, inner.T, *[end] * _REST])
        even = np.linspace(0.0, self.seconds, self.control_points - self.degree + 1)
        return from_scipy(BSpline(np.pad(even, self.degree, mode="edge"), points, self.degree))
