"""Families of motions that are linear in their coefficients, also from `[excitation.motion]`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, refuse_unknown
from steelyard.excite.trajectories.exact_trajectories import (
    SMOOTH,
    ChainedMotion,
    ExactTrajectory,
    PiecewiseMotion,
    from_scipy,
    quintic,
    through_postures,
)
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.robot.robot import Robot

SAME_MOTION_TOLERANCE = 1e-6  # relative difference up to which two motions are one

_WHERE = "[excitation.motion]"


@dataclass(frozen=True, eq=False)
class Basis:
    r"""A family of motions $q_j(t) = \sum_i x_{ji} \phi_i(t) + \sum_h p_{jh} \psi_h(t)$.

    The `x` are coefficients of `m` functions per joint, the `p` prescribed postures, `(n,)`
    each, the start first; the functions hold frequencies up to `highest` [Hz]. A family says how a
    motion is `made_of` both, `(k, m + p)`; all functions are that motion for a row of ones and
    zeros. Standing at the posture 1 of one joint has the coefficients `standing`, `(m,)`; `going`,
    `(n, m)`, is added to go to a prescribed end.
    """

    joints: int
    highest: float
    prescribed: tuple[Array, ...]
    made_of: Callable[[Array], ExactTrajectory]
    standing: Array
    going: Array | float = 0.0

    def __post_init__(self) -> None:
        # making a motion refuses numbers that do not fit each other
        if not self.duration > 0.0:
            raise ValueError(f"a motion of {self.duration} s takes no time")

    @property
    def count(self) -> int:
        """Number of functions `m`."""
        return len(self.standing)

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self._units.duration

    def shapes(self, t: ArrayLike, order: int) -> Array:
        """The functions, or their derivative of order 1 to 3, shape `(N, m)`."""
        return self._units.derivative(t, order)[:, : self.count]

    def offset(self, t: ArrayLike, order: int) -> Array:
        """What is there without coefficients, shape `(N, n)`."""
        postures = np.reshape(self.prescribed, (-1, self.joints))
        return self._units.derivative(t, order)[:, self.count :] @ postures

    def still(self, posture: Array) -> Array:
        """Coefficients, `(n, m)`, of standing still at `posture` `(n,)`, or the prescribed start.

        A prescribed end is still gone to.
        """
        place = self.prescribed[0] if self.prescribed else frozen(posture, (self.joints,))
        return np.outer(place, self.standing) + self.going

    def motion(self, x: Array) -> ExactTrajectory:
        """The motion of coefficients `x`, shape `(n, m)`."""
        x = frozen(x, (self.joints, self.count))
        return self.made_of(np.column_stack([x, *self.prescribed]))

    @cached_property
    def _units(self) -> ExactTrajectory:
        return self.made_of(np.eye(self.count + len(self.prescribed)))


def coefficients_of(basis: Basis, trajectory: ExactTrajectory) -> Array | None:
    """Coefficients, shape `(n, m)`, of a motion; `None` if it is none of the basis."""
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


Place = ArrayLike | None  # a posture `(n,)`, if it is given


def _given(joints: int, *postures: Place) -> tuple[Array, ...]:
    """Those postures that are given, shape `(n,)` each."""
    return tuple(frozen(place, (joints,)) for place in postures if place is not None)


def rest_fourier(
    joints: int, period: float, harmonics: int, start: Place = None, end: Place = None
) -> Basis:
    """Series of one period [s] from rest to rest, by the null space of these conditions.

    The first `2H - 2` coefficients are coordinates in `rest_basis`. Without a `start`, the posture
    at both ends is one more. To another `end` a minimum-jerk move is added [Swevers1997].
    """
    postures = _given(joints, start, end)

    def made_of(rows: Array) -> FourierMotion:
        free, places = np.split(rows, [2 * harmonics - 2], axis=1)
        series = FourierMotion.from_free(places[:, 0], free, period)
        if end is None:
            return series
        way = np.outer(SMOOTH, places[:, 1] - places[:, 0])[None]
        return replace(series, trend=PiecewiseMotion(np.array([0.0, period]), way))

    standing = np.zeros(2 * harmonics - 2 + (start is None))
    if start is None:
        standing[-1] = 1.0
    return Basis(joints, harmonics / period, postures, made_of, standing)


def _mean_posture(harmonics: int) -> Array:
    """The mean posture among the coefficients of a `_series`."""
    return np.asarray(np.eye(2 * harmonics + 1)[-1])


def _series(rows: Array, harmonics: int, period: float, periods: int) -> FourierMotion:
    """Coefficients are those of the sines, the cosines and the mean posture, in this order."""
    sine, cosine, mean = np.split(rows[:, : 2 * harmonics + 1], [harmonics, 2 * harmonics], axis=1)
    start = mean[:, 0] + cosine.sum(axis=1)
    return FourierMotion(start, sine, cosine, period, periods, rests=False)


def raw_fourier(joints: int, period: float, harmonics: int) -> Basis:
    """Series of one period [s] of any coefficients, not at rest at their ends."""

    def made_of(rows: Array) -> FourierMotion:
        return _series(rows, harmonics, period, 1)

    return Basis(joints, harmonics / period, (), made_of, _mean_posture(harmonics))


def blended_fourier(
    joints: int, period: float, harmonics: int, periods: int, blend: float, start: Place = None
) -> Basis:
    """From rest by a quintic blend of `blend` s into a series, and by one back to where it began.

    Blends meet position, velocity and acceleration of the series. The posture at both ends is the
    mean one if there is no `start`.
    """
    postures = _given(joints, start)

    def made_of(rows: Array) -> ChainedMotion:
        series = _series(rows, harmonics, period, periods)
        place, zero = rows[:, -1], np.zeros(len(rows))
        state = [series.derivative([0.0], order)[0] for order in range(3)]
        rest, times = (place, zero, zero), np.array([0.0, blend])
        into = PiecewiseMotion(times, quintic(rest, state, blend))
        return ChainedMotion((into, series, PiecewiseMotion(times, quintic(state, rest, blend))))

    highest = max(harmonics / period, 1.0 / blend)
    return Basis(joints, highest, postures, made_of, _mean_posture(harmonics))


def ramped_fourier(
    joints: int, period: float, harmonics: int, periods: int, ramp: float, start: Place = None
) -> Basis:
    """Series whose amplitude rises from zero in `ramp` s, and falls back to it.

    Unlike blends, ramps take no time before and after the periods. The posture at both ends is the
    mean one if there is no `start`.
    """
    postures = _given(joints, start)

    def made_of(rows: Array) -> FourierMotion:
        series, place = _series(rows, harmonics, period, periods), rows[:, -1]
        return replace(series, start=series.start - place).ramped(place, ramp)

    highest = harmonics / period + 0.5 / ramp
    return Basis(joints, highest, postures, made_of, _mean_posture(harmonics))


def reaching(
    joints: int, targets: int, move_s: float, dwell_s: float = 0.0, start: Place = None
) -> Basis:
    """Minimum-jerk moves of `move_s` between postures, which are the coefficients.

    It stands `dwell_s` after every move. Without a `start`, the first target is it; a last move
    leads back there. A move's acceleration is about one sine long.
    """
    postures = _given(joints, start)
    if targets < (fewest := 2 - len(postures)):
        raise ValueError(f"{targets} targets are no motion, {fewest} or more are")

    def made_of(rows: Array) -> PiecewiseMotion:
        places = np.roll(rows.T, len(postures), axis=0)
        return through_postures(np.vstack([places, places[:1]]), move_s, dwell_s)

    return Basis(joints, 1.0 / move_s, postures, made_of, np.ones(targets))


_REST_CONTROL_POINTS = 3  # equal control points at an end make velocity and acceleration zero there


def splines(
    joints: int,
    seconds: float,
    control_points: int,
    degree: int = 5,
    start: Place = None,
    end: Place = None,
) -> Basis:
    """B-splines of degree 3 or 5 on even knots, clamped, at rest at both ends [DeBoor2001].

    The first three of 7 or more control points are the posture at the start, the last three that at
    the end; the others are the coefficients. Without a `start`, the posture at both ends is one
    more and the last. Two knot spans hold one wave at most.
    """
    from scipy.interpolate import BSpline

    postures = _given(joints, start, end)
    fixed = _REST_CONTROL_POINTS
    inner = control_points - 2 * fixed
    even = np.linspace(0.0, seconds, control_points - degree + 1)
    knots = np.pad(even, degree, mode="edge")

    def made_of(rows: Array) -> PiecewiseMotion:
        free, first, last = rows[:, :inner], rows[:, inner], rows[:, -1]
        points = np.vstack([*[first] * fixed, free.T, *[last] * fixed])
        return from_scipy(BSpline(knots, points, degree))

    standing = np.ones(inner + (start is None))
    going: Array | float = 0.0
    if end is not None:
        # nearly as by a minimum-jerk move: the control points lie on it
        where = [knots[k + 1 : k + 1 + degree].mean() for k in range(fixed, control_points - fixed)]
        shares = np.polynomial.Polynomial(SMOOTH)(np.array(where) / seconds)
        going = np.outer(postures[1] - postures[0], shares)
    highest = 0.5 * (control_points - degree) / seconds
    return Basis(joints, highest, postures, made_of, standing, going)


def posture_of(given: Any, robot: Robot, what: str) -> Array | None:
    """A posture from a list or a table by joint; joints that a table leaves out are at zero."""
    if given is None:
        return None
    fix = "give one number per joint: " + ", ".join(robot.joint_names)
    return frozen(by_joint(given, robot.joint_names, f"{_WHERE} {what}", np.zeros(robot.n), fix))


def _ends(s: Any, robot: Robot) -> tuple[Array | None, Array | None]:
    start, end = (posture_of(getattr(s, key), robot, key) for key in ("start", "end"))
    if end is not None and start is None:
        raise DataError(
            "an end posture is given, but no start posture",
            where=_WHERE,
            fix="give start = [...] too; without either, the motion ends where it starts",
        )
    return start, end


FAMILIES: Mapping[str, Callable[[Any, Robot], Basis]] = {
    "fourier": lambda s, r: rest_fourier(r.n, s.period, s.harmonics, *_ends(s, r)),
    "raw_fourier": lambda s, r: raw_fourier(r.n, s.period, s.harmonics),
    "blended_fourier": lambda s, r: blended_fourier(
        r.n, s.period, s.harmonics, s.periods, s.blend, posture_of(s.start, r, "start")
    ),
    "ramped_fourier": lambda s, r: ramped_fourier(
        r.n, s.period, s.harmonics, s.periods, s.ramp, posture_of(s.start, r, "start")
    ),
    "spline": lambda s, r: splines(r.n, s.duration, s.points, s.degree, *_ends(s, r)),
    "reaching": lambda s, r: reaching(
        r.n, s.targets, s.move, s.dwell, posture_of(s.start, r, "start")
    ),
}
"""Families that are searched, by their sections; others are planned, see `plans_from_tables`."""


def basis_of(section: Any, robot: Robot) -> Basis:
    """The family of motions that a table describes."""
    try:
        return FAMILIES[section.kind](section, robot)
    except ValueError as error:
        raise DataError(str(error), where=_WHERE, fix="change that number") from error


def per_joint(given: Any, robot: Robot, what: str, default: Array) -> Array:
    """Numbers by joint, from one for all, a list, or a table that changes some of the defaults."""
    if given is None:
        return default
    if isinstance(given, float | int):
        return np.full(robot.n, float(given))
    fix = "give one number, one per joint, or a table by joint name"
    return by_joint(given, robot.joint_names, f"[excitation.limits] {what}", default, fix)


def by_joint(given: Any, names: Sequence[str], where: str, default: Array, fix: str) -> Array:
    """Numbers by joint, `(n,)`, from a list, or from a table that changes some of the default."""
    if isinstance(given, Mapping):
        values = np.array(default)
        for name, value in given.items():
            wrong = f"the robot has no joint '{name}'"
            refuse_unknown(name, names, wrong, where, "joints", DataError)
            values[names.index(name)] = value
        return values
    if len(given) != len(names):
        raise DataError(f"{len(given)} numbers for {len(names)} joints", where=where, fix=fix)
    return np.array(given, dtype=np.float64)
