"""Families of motions that are linear in their coefficients; splines, moves between postures."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.excite.trajectories.polynomials import (
    SMOOTH,
    PiecewiseMotion,
    from_scipy,
    through_postures,
)
from steelyard.excite.trajectories.trajectory import ExactTrajectory

SAME_MOTION_TOLERANCE = 1e-6
"""Relative difference up to which two motions are one."""


class Basis(Protocol):
    r"""Functions $\phi_i$ that all joints share: $q_j(t) = o_j(t) + \sum_i x_{ji} \phi_i(t)$.

    Attributes:
        joints: Number of joints `n`.
        count: Functions per joint `m`.
        duration: Length in time [s].
        highest: The highest frequency that the functions hold [Hz]; says how densely to sample.
    """

    @property
    def joints(self) -> int:
        """Number of joints."""
        ...

    @property
    def count(self) -> int:
        """Functions per joint."""
        ...

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        ...

    @property
    def highest(self) -> float:
        """Highest frequency that the functions hold [Hz]."""
        ...

    def shapes(self, t: ArrayLike, order: int) -> Array:
        """The functions, or their derivative of order 1 to 3, shape `(N, m)`."""
        ...

    def offset(self, t: ArrayLike, order: int) -> Array:
        """What is there without coefficients, shape `(N, n)`."""
        ...

    def still(self, posture: Array) -> Array:
        """Coefficients, shape `(n, m)`, of standing still at `posture` `(n,)`.

        Where the basis prescribes a start posture, it stands there.
        """
        ...

    def motion(self, x: Array) -> ExactTrajectory:
        """The motion of coefficients `x`, shape `(n, m)`."""
        ...


def coefficients_of(basis: Basis, trajectory: ExactTrajectory) -> Array | None:
    """Coefficients, shape `(n, m)`, of a motion; `None` if it is none of the basis.

    Args:
        basis: The family.
        trajectory: The motion.
    """
    if abs(trajectory.duration - basis.duration) > SAME_MOTION_TOLERANCE * basis.duration:
        return None
    samples = int(np.ceil(8.0 * max(basis.highest * basis.duration, basis.count))) + 1
    t = np.linspace(0.0, basis.duration, samples)
    q = trajectory.derivative(t, 0)
    if q.shape[1] != basis.joints:
        return None
    shapes, rest = basis.shapes(t, 0), q - basis.offset(t, 0)
    found = np.linalg.lstsq(shapes, rest, rcond=None)[0]
    if np.abs(shapes @ found - rest).max() > SAME_MOTION_TOLERANCE * max(
        1.0, float(np.abs(q).max())
    ):
        return None
    return np.asarray(found.T)


class LinearBasis(ABC):
    r"""A family of motions $q_j(t) = \sum_i x_{ji} \phi_i(t) + \sum_h p_{jh} \psi_h(t)$.

    The `x` are its coefficients, and the `p` prescribed postures. A member only says how a
    motion is made of both; all functions are then that motion for a row of ones and zeros.

    Attributes:
        joints: Number of joints `n`.
    """

    joints: int

    @property
    @abstractmethod
    def count(self) -> int:
        """Functions per joint `m`."""

    @property
    @abstractmethod
    def highest(self) -> float:
        """The highest frequency that the functions hold [Hz]."""

    @property
    @abstractmethod
    def prescribed_postures(self) -> tuple[Array, ...]:
        """Prescribed postures `p`, each of shape `(n,)`; may be none."""

    @abstractmethod
    def still(self, posture: Array) -> Array:
        """Coefficients, shape `(n, m)`, of standing still at `posture` or the prescribed start."""

    @abstractmethod
    def made_of(self, rows: Array) -> ExactTrajectory:
        """The motion of the coefficients and the prescribed postures, shape `(k, m + p)`."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self._units.duration

    def shapes(self, t: ArrayLike, order: int) -> Array:
        """The functions, or their derivative of order 1 to 3, shape `(N, m)`."""
        return self._units.derivative(t, order)[:, : self.count]

    def offset(self, t: ArrayLike, order: int) -> Array:
        """What is there without coefficients, shape `(N, n)`."""
        postures = np.reshape(self.prescribed_postures, (-1, self.joints))
        return self._units.derivative(t, order)[:, self.count :] @ postures

    def motion(self, x: Array) -> ExactTrajectory:
        """The motion of coefficients `x`, shape `(n, m)`."""
        x = frozen(x, (self.joints, self.count))
        return self.made_of(np.column_stack([x, *self.prescribed_postures]))

    @cached_property
    def _units(self) -> ExactTrajectory:
        return self.made_of(np.eye(self.count + len(self.prescribed_postures)))


def checked_postures(joints: int, *postures: ArrayLike | None) -> tuple[Array, ...]:
    """Those postures that are given, as arrays of shape `(n,)`.

    Raises:
        ValueError: There are no joints, or a posture is one of another number of them.
    """
    if joints < 1:
        raise ValueError(f"a motion needs a joint or more, not {joints}")
    return tuple(frozen(posture, (joints,)) for posture in postures if posture is not None)


def check_times(**seconds: float) -> None:
    """All of them are positive and finite.

    Raises:
        ValueError: Says which is not.
    """
    for name, value in seconds.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} = {value} s: it must be above 0")


@dataclass(frozen=True, eq=False)
class ReachingBasis(LinearBasis):
    """Minimum-jerk moves between postures; the postures are the coefficients.

    Attributes:
        joints: Number of joints `n`.
        targets: Postures to choose `m`; without a `start`, the first of them is the start.
        move_s: Time of every move [s].
        dwell_s: Time to stand after every move [s].
        start: Posture at the start, shape `(n,)`, if it is not to be chosen.
        closed: Whether a last move leads back to the start.
    """

    joints: int
    targets: int
    move_s: float
    dwell_s: float = 0.0
    start: Array | None = None
    closed: bool = True

    def __post_init__(self) -> None:
        check_times(move_s=self.move_s)
        checked_postures(self.joints, self.start)
        if self.targets < (fewest := 2 - len(self.prescribed_postures)):
            raise ValueError(f"{self.targets} targets are no motion, {fewest} or more are")
        self.made_of(np.zeros((1, self.count + len(self.prescribed_postures))))

    @property
    def count(self) -> int:
        """Functions per joint: one a target."""
        return self.targets

    @property
    def highest(self) -> float:
        """A move's acceleration is about one sine long [Hz]."""
        return 1.0 / self.move_s

    @property
    def prescribed_postures(self) -> tuple[Array, ...]:
        """The start, if it is given."""
        return checked_postures(self.joints, self.start)

    def still(self, posture: Array) -> Array:
        """All targets at the posture, or at the start if it is given, shape `(n, m)`."""
        (place,) = self.prescribed_postures or (posture,)
        return np.repeat(frozen(place, (self.joints,))[:, None], self.targets, axis=1)

    def made_of(self, rows: Array) -> PiecewiseMotion:
        """The motion through the postures in the columns, shape `(k, m + p)`."""
        postures = np.roll(rows.T, len(self.prescribed_postures), axis=0)
        if self.closed:
            postures = np.vstack([postures, postures[:1]])
        return through_postures(postures, self.move_s, self.dwell_s)


_REST_CONTROL_POINTS = 3
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
        return self.control_points - 2 * _REST_CONTROL_POINTS

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
        return np.array(means[_REST_CONTROL_POINTS:-_REST_CONTROL_POINTS])

    def made_of(self, rows: Array) -> PiecewiseMotion:
        """The motion of inner control points, start and perhaps end in the columns."""
        from scipy.interpolate import BSpline

        inner, start, end = rows[:, : self.inner], rows[:, self.inner], rows[:, -1]
        points = np.vstack(
            [*[start] * _REST_CONTROL_POINTS, inner.T, *[end] * _REST_CONTROL_POINTS]
        )
        even = np.linspace(0.0, self.seconds, self.control_points - self.degree + 1)
        return from_scipy(BSpline(np.pad(even, self.degree, mode="edge"), points, self.degree))
