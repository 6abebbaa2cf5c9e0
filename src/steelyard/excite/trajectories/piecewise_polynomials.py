r"""Piecewise polynomials: exact extremes, minimum-jerk moves, and motions through given postures.

A polynomial on $[0, 1]$ lies between the least and the greatest of its Bernstein coefficients, and
the first and the last of them are values of it. Halving the interval brings both together
quadratically; a half whose coefficients stay below a value already found is done with
[Farouki2012]. What remains is a bound over all times that no sample exceeds and one attains.

From rest to rest in the time $T$, with $\tau = t / T$,
$q = p_0 + (p_1 - p_0)(10 \tau^3 - 15 \tau^4 + 6 \tau^5)$ [Flash1985]: the fastest speed is
$15/8$ and the largest acceleration $10/\sqrt 3$ of what the distance gives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial, perm, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.excite.trajectories.exact_slowed_and_chained_trajectories import (
    ExactTrajectory,
    check_join,
)

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

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.edges[-1])

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
    if len(postures) < 2:
        raise ValueError(f"a motion through postures needs 2 of them or more, not {len(postures)}")
    moves = np.broadcast_to(np.asarray(move_s, dtype=np.float64), (len(postures) - 1,))
    if not (np.all(moves > 0.0) and dwell_s >= 0.0 and np.isfinite(moves).all()):
        raise ValueError("moves take more than 0 s, and dwells 0 s or more")
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
