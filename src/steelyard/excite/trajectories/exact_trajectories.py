r"""Motions whose extremes over all times are known: slowed, chained, of piecewise polynomials.

A polynomial on $[0, 1]$ lies between the least and the greatest of its Bernstein coefficients, and
the first and the last of them are values of it. Halving the interval brings both together
quadratically; a half whose coefficients stay below a value already found is done with
[Farouki2012]. What remains is a bound over all times that no sample exceeds and one attains.

From rest to rest in the time $T$, with $\tau = t / T$,
$q = p_0 + (p_1 - p_0)(10 \tau^3 - 15 \tau^4 + 6 \tau^5)$ [Flash1985]: the fastest speed is
$15/8$ and the largest acceleration $10/\sqrt 3$ of what the distance gives.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb, factorial, perm, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.motion import Motion, numbers

ORDERS = ("position", "velocity", "acceleration", "jerk")  # derivatives by their order


class ExactTrajectory(ABC):
    """A motion that can be differentiated, bounded and stored."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.breaks[-1])

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


def stretch_within(motion: ExactTrajectory, bounds: Sequence[Array]) -> tuple[float, int, int]:
    """The time in which a motion keeps bounds of its derivatives, over its own time.

    Bounds are of orders 1, 2, ... either way, `(n,)` each; also the order and joint that decide.
    """
    found = []
    for order, bound in enumerate(bounds, start=1):
        low, high = motion.extremes(order)
        needed = (np.maximum(-low, high) / bound) ** (1.0 / order)
        found.append((float(needed.max()), order, int(needed.argmax())))
    return max(found)


def divided(edges: Array, longest: float) -> Array:
    """Ascending times `(k,)`, and others evenly between them: no two are more than that apart."""
    counts = np.ceil(np.diff(edges) / longest * (1.0 - 1e-9)).astype(int).clip(1)
    parts = [
        np.linspace(start, end, count, endpoint=False)
        for start, end, count in zip(edges, edges[1:], counts, strict=False)
    ]
    return np.concatenate([*parts, edges[-1:]])


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


_HALVINGS = 60
_EPSILON = float(np.finfo(np.float64).eps)


def polynomial_extremes(pieces: Array) -> tuple[Array, Array]:
    r"""Least and greatest value of $\sum_i a_i \tau^i$ over all pieces and $0 \le \tau \le 1$.

    Coefficients are ascending, `(p, d + 1, n)`; values, `(n,)`, are rounded away from each other.
    """
    degree, joints = pieces.shape[1] - 1, pieces.shape[2]
    points = np.einsum("ji,pin->pnj", _to_bernstein(degree), pieces)
    rounding = 8 * (degree + 1) * np.abs(pieces).sum(axis=1).max(axis=0)
    slack = _EPSILON * (rounding + 128 * np.abs(points).max(axis=(0, 2)))
    top = _greatest(np.concatenate([points, -points], axis=1), np.tile(slack, 2))
    return -top[joints:], top[:joints]


def _greatest(points: Array, slack: Array) -> Array:
    """The greatest value of Bernstein polynomials `(p, k, d + 1)` per column, shape `(k,)`."""
    columns, degree = points.shape[1], points.shape[2] - 1
    best = points[:, :, [0, -1]].max(axis=(0, 2))
    owner = np.tile(np.arange(columns), len(points))
    rows = points.reshape(-1, degree + 1)
    halves = _halves(degree)
    for _ in range(_HALVINGS):
        open_ = rows.max(axis=1) > (best + slack)[owner]
        if not open_.any():
            return np.asarray(best + slack)
        rows, owner = rows[open_], np.tile(owner[open_], 2)
        rows = np.concatenate([rows @ half for half in halves])
        np.maximum.at(best, owner, np.maximum(rows[:, 0], rows[:, -1]))
    np.maximum.at(best, owner, rows.max(axis=1))
    return np.asarray(best + slack)


def differentiated(pieces: Array, widths: Array, order: int) -> Array:
    """Coefficients of a derivative in time, shape `(p, max(d - order, 0) + 1, n)`.

    The pieces, `(p, d + 1, n)`, are polynomials in the share of their times `widths`, `(p,)` [s].
    """
    degree = pieces.shape[1] - 1
    if order > degree:
        return np.zeros((len(pieces), 1, pieces.shape[2]))
    factor = np.array([perm(i, order) for i in range(order, degree + 1)], dtype=np.float64)
    return np.asarray(pieces[:, order:] * factor[:, None] / widths[:, None, None] ** order)


@lru_cache
def _to_bernstein(degree: int) -> Array:
    """From ascending powers to Bernstein coefficients, shape `(d + 1, d + 1)`."""
    rows = range(degree + 1)
    return np.array([[comb(j, i) / comb(degree, i) for i in rows] for j in rows])


@lru_cache
def _halves(degree: int) -> tuple[Array, Array]:
    """From Bernstein coefficients in rows to those of the first and of the second half."""
    rows = range(degree + 1)
    first = np.array([[comb(j, i) / 2.0**j for i in rows] for j in rows])
    return first.T.copy(), first[::-1, ::-1].T.copy()


@dataclass(frozen=True, eq=False)
class PiecewiseMotion(ExactTrajectory):
    r"""Polynomials of all joints between shared times, `edges` from 0 on, `(p + 1,)` [s].

    Between $t_p$ and $t_{p+1}$, with $\tau = (t - t_p) / (t_{p+1} - t_p)$, joint `j` is at
    $\sum_i c_{pij} \tau^i$, with coefficients `(p, d + 1, n)` [rad; m].
    """

    edges: Array
    coefficients: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "edges", frozen(self.edges, (None,)))
        pieces = len(self.edges) - 1
        if pieces < 1 or self.edges[0] != 0.0 or not np.all(np.diff(self.edges) > 0.0):
            raise ValueError("the breaks of a motion rise from 0, and there are two or more")
        object.__setattr__(self, "coefficients", frozen(self.coefficients, (pieces, None, None)))
        if not (np.isfinite(self.edges).all() and np.isfinite(self.coefficients).all()):
            raise ValueError("a break or a coefficient of the motion is not finite")
        if self.coefficients.shape[1] == 0:
            raise ValueError("the pieces of the motion have no coefficients")
        ends, starts = self.coefficients[:-1].sum(axis=1), self.coefficients[1:, 0]
        check_join(ends, starts, self.edges[1:-1])

    @property
    def breaks(self) -> Array:
        """The edges."""
        return self.edges

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """See `ExactTrajectory`; any order."""
        t = np.asarray(t, dtype=np.float64)
        last = len(self.coefficients) - 1
        piece = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, last)
        width = np.diff(self.breaks)[piece]
        share = np.clip((t - self.breaks[piece]) / width, 0.0, 1.0)[:, None]
        values = np.zeros((len(t), self.coefficients.shape[2]))
        for power in range(self.coefficients.shape[1] - 1, order - 1, -1):
            values = values * share + perm(power, order) * self.coefficients[piece, power]
        return np.asarray(values / width[:, None] ** order)

    def extremes(self, order: int) -> tuple[Array, Array]:
        """See `ExactTrajectory`."""
        return polynomial_extremes(differentiated(self.coefficients, np.diff(self.breaks), order))

    def to_dict(self) -> dict[str, Any]:
        """See `ExactTrajectory`."""
        pieces = self.coefficients.tolist()
        return {"kind": "piecewise", "breaks_s": self.breaks.tolist(), "coefficients": pieces}


def from_scipy(curve: Any) -> PiecewiseMotion:
    """The motion of a `scipy.interpolate` `PPoly` or `BSpline` with values of shape `(n,)`."""
    if hasattr(curve, "k"):
        degree, knots = curve.k, curve.t[curve.k : len(curve.t) - curve.k]
    else:
        degree, knots = len(curve.c) - 1, curve.x
    knots = np.unique(knots)
    width = np.diff(knots)[:, None]
    pieces = [curve(knots[:-1], i) * (width**i / factorial(i)) for i in range(degree + 1)]
    return PiecewiseMotion(knots, np.stack(pieces, axis=1))


SMOOTH = frozen([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])  # from 0 to 1, at rest at both ends, by powers


def through_postures(
    postures: ArrayLike, move_s: ArrayLike, dwell_s: float = 0.0
) -> PiecewiseMotion:
    """The motion through postures, `(k, n)` [rad; m], that stands `dwell_s` at all but the first.

    Moves take `move_s`, all the same or one each, `(k - 1,)` [s].
    """
    postures = frozen(postures, (None, None))
    moves = np.broadcast_to(np.asarray(move_s, dtype=np.float64), (len(postures) - 1,))
    reach = np.diff(postures, axis=0)[:, None, :] * SMOOTH[:, None]
    reach[:, 0] = postures[:-1]
    if dwell_s == 0.0:
        return PiecewiseMotion(np.cumsum([0.0, *moves]), reach)
    stand = np.zeros_like(reach)
    stand[:, 0] = postures[1:]
    pieces = np.stack([reach, stand], axis=1).reshape(-1, *reach.shape[1:])
    seconds = np.column_stack([moves, np.full_like(moves, dwell_s)]).ravel()
    return PiecewiseMotion(np.cumsum([0.0, *seconds]), pieces)


def reach_seconds(distance: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> float:
    """The shortest time of a minimum-jerk move within limits [s]; zero for no distance.

    Distances, of any sign, highest speeds and accelerations are those of all joints, `(n,)`.
    """
    way = np.abs(np.asarray(distance, dtype=np.float64))
    by_speed = 15.0 / 8.0 * way / np.asarray(velocity, dtype=np.float64)
    by_acceleration = np.sqrt(10.0 / sqrt(3.0) * way / np.asarray(acceleration, dtype=np.float64))
    return float(np.max(np.maximum(by_speed, by_acceleration), initial=0.0))


def quintic(start: Sequence[Array], end: Sequence[Array], seconds: float) -> Array:
    """The polynomials of degree 5 with given position, velocity and acceleration at both ends.

    `(n,)` each. Coefficients of the powers of the time's share, `(1, 6, n)`.
    """
    p, v, a = (value * seconds**k for k, value in enumerate(start))
    end_p, end_v, end_a = (value * seconds**k for k, value in enumerate(end))
    dp, dv, da = end_p - p - v - 0.5 * a, end_v - v - a, end_a - a
    high = [10.0 * dp - 4.0 * dv + 0.5 * da, -15.0 * dp + 7.0 * dv - da]
    return np.array([[p, v, 0.5 * a, *high, 6.0 * dp - 3.0 * dv + 0.5 * da]])


@dataclass(frozen=True, eq=False)
class SampledMotion(PiecewiseMotion):
    """A motion through postures `(N, n)`: the cubic spline with given speeds at its ends, `(2, n)`.

    Times `(N,)` [s] are kept from zero on; without speeds it rests.
    """

    t: Array
    q: Array
    ends: Array | None

    def __init__(self, t: ArrayLike, q: ArrayLike, ends: ArrayLike | None = None) -> None:
        from scipy.interpolate import CubicSpline

        t = frozen(t, (None,))
        if len(t) < 2 or not np.all(np.diff(t) > 0.0):
            raise ValueError("a motion needs two times or more, each later than the one before")
        q = frozen(q, (len(t), None))
        if not (np.isfinite(t).all() and np.isfinite(q).all()):
            raise ValueError("a time or a posture of the table is not finite")
        if ends is not None:
            ends = frozen(ends, (2, q.shape[1]))
            if not np.isfinite(ends).all():
                raise ValueError("a speed at the motion's start or end is not finite")
        set_fields(self, t=frozen(t - t[0]), q=q, ends=ends)
        start, end = np.zeros((2, q.shape[1])) if ends is None else np.asarray(ends)
        pieces = from_scipy(CubicSpline(self.t, q, bc_type=((1, start), (1, end))))
        super().__init__(pieces.breaks, pieces.coefficients)

    def to_dict(self) -> dict[str, Any]:
        """See `ExactTrajectory`."""
        values = {"kind": "sampled", "time_s": self.t.tolist(), "q": self.q.tolist()}
        return values if self.ends is None else values | {"ends": self.ends.tolist()}


def end_speeds(t: Array, q: Array) -> Array:
    """Speeds of a table of postures `(N, n)` in its first and last row, `(2, n)` [rad/s; m/s].

    Those of the not-a-knot cubic spline; zero where not larger than the error of differentiation,
    taken as the difference from the parabola through the three rows at that end, and for fewer than
    four rows.
    """
    from scipy.interpolate import CubicSpline

    if len(t) < 4:
        return np.zeros((2, q.shape[1]))
    speeds = CubicSpline(t, q)(t[[0, -1]], 1)
    first, last = CubicSpline(t[:3], q[:3])(t[0], 1), CubicSpline(t[-3:], q[-3:])(t[-1], 1)
    return np.where(np.abs(speeds) > np.abs(speeds - [first, last]), speeds, 0.0)
