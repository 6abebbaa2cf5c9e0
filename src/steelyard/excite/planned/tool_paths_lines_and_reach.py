r"""Paths of a tool over time, postures along straight lines, and whether places are in reach.

A circle is gone round at a constant speed that rises and falls along the minimum-jerk step
$s = 10 \tau^3 - 15 \tau^4 + 6 \tau^5$ [Flash1985]; a reach goes straight from place to place along
the same step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.planned.inverse_kinematics import InverseKinematics, Postures
from steelyard.excite.trajectories.exact_trajectories import SMOOTH

_PER_LAP = 16  # stretches of a lap, and of its ramps, that are followed at once at most
_PER_REACH = 4  # stretches of a reach that are followed at once at most
_SAME = 1e-9  # places nearer to each other than this are one [m]

_RISING = Polynomial(SMOOTH)
_RISE = _RISING.integ()  # way at a speed that rises from 0 to 1 within the unit of time


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle about `centre` [m], started and stopped smoothly; whole turns include both ramps.

    A lap at full speed takes `period`, the speed rises and falls in `ramp` [s] each, which takes
    `ramp / (2 period)` of a turn. It turns right-handed about `normal`. The start's `angle` [rad]
    is from the projection of the base's x axis on its plane, or of the y axis where x is normal to
    it.
    """

    centre: Array
    radius: float
    period: float
    laps: int
    ramp: float
    normal: Array
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("centre", "normal"):
            object.__setattr__(self, name, frozen(getattr(self, name), (3,)))
        if self.ramp > self.laps * self.period:
            raise ValueError(
                f"a ramp of {self.ramp:g} s is longer than the circle's laps, "
                f"{self.laps * self.period:g} s in all"
            )
        plane_axes(self.normal)

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.laps * self.period + self.ramp

    @cached_property
    def knots(self) -> Array:
        """Times from 0 to the duration, shape `(k,)` [s]; the path is smooth between them."""
        stretches = [(0.0, self.ramp), (self.ramp, self.duration - self.ramp)]
        stretches.append((self.duration - self.ramp, self.duration))
        parts = [
            np.linspace(start, end, int(np.ceil(_PER_LAP * max((end - start) / self.period, 0.5))))
            for start, end in stretches
            if end - start > 1e-9 * self.duration
        ]
        return np.unique(np.concatenate(parts))

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Place [m], velocity [m/s] and acceleration [m/s²], each `(3,)`, in the base frame."""
        way, rate, slope = self._pace(t)
        speed = 2.0 * np.pi / self.period
        angle, rate, slope = self.angle + speed * way, speed * rate, speed * slope
        ahead, aside = plane_axes(self.normal)
        out = self.radius * (np.cos(angle) * ahead + np.sin(angle) * aside)
        across = self.radius * (np.cos(angle) * aside - np.sin(angle) * ahead)
        return self.centre + out, rate * across, slope * across - rate**2 * out

    def _pace(self, t: float) -> tuple[float, float, float]:
        """Time gone at full speed, and its first and second derivative."""
        left = self.duration - t
        if left < min(t, self.ramp):
            way, rate, slope = self._pace(left)
            return self.laps * self.period - way, rate, -slope
        x = min(t / self.ramp, 1.0)
        rest = max(t - self.ramp, 0.0)
        slope = float(_RISING.deriv()(x)) / self.ramp
        return self.ramp * float(_RISE(x)) + rest, float(_RISING(x)), slope


@dataclass(frozen=True, eq=False)
class Reaches:
    """Straight minimum-jerk reaches through places `(k, 3)` [m], with a pause at each.

    Every reach takes `move`, and every pause `dwell` [s]. The first place is where it starts.
    """

    places: Array
    move: float
    dwell: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen(self.places, (None, 3)))
        ways = np.linalg.norm(np.diff(self.places, axis=0), axis=1)
        if ways.min() < _SAME:
            raise ValueError("each place of the reaches differs from the one before it")

    @cached_property
    def knots(self) -> Array:
        """See `Circle`."""
        once = np.linspace(0.0, self.move, _PER_REACH + 1)[:-1]
        once = np.concatenate([once, [self.move] if self.dwell > 0.0 else []])
        starts = self._each * np.arange(len(self.places) - 1)
        whole = (starts[:, None] + once).ravel()
        return np.append(whole, self._each * (len(self.places) - 1))

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """See `Circle`."""
        k = min(int(t / self._each * (1.0 + 1e-12)), len(self.places) - 2)
        x = min(max(t - k * self._each, 0.0) / self.move, 1.0)
        start, way = self.places[k], self.places[k + 1] - self.places[k]
        steps = (_RISING(x), _RISING.deriv()(x) / self.move, _RISING.deriv(2)(x) / self.move**2)
        place, velocity, acceleration = (step * way for step in steps)
        return start + place, velocity, acceleration

    @property
    def _each(self) -> float:
        """Time from reach to reach [s]."""
        return self.move + self.dwell


ToolPath = Circle | Reaches  # where a tool is to be over time; it starts and ends at rest


def plane_axes(normal: Array) -> tuple[Array, Array]:
    """Unit vectors in a plane, `(3,)` each: the base's x axis seen along the normal, and across.

    The y axis takes the place of x where the normal is along x. Both are right-handed with the
    normal.
    """
    size = float(np.linalg.norm(normal))
    if not _SAME < size < np.inf:
        raise ValueError(f"the normal {normal} has no direction")
    up = normal / size
    x, y, _ = np.eye(3)
    ahead = x - (x @ up) * up
    ahead = ahead if np.linalg.norm(ahead) > 1e-3 else y - (y @ up) * up
    ahead = ahead / np.linalg.norm(ahead)
    return ahead, np.cross(up, ahead)


def on_circle(centre: Array, radius: float, count: int, normal: Array, angle: float) -> Array:
    """Places at equal distances on a circle, shape `(count, 3)` [m]; `angle` is of the first."""
    ahead, aside = plane_axes(normal)
    angles = angle + 2.0 * np.pi * np.arange(count) / count
    spread = np.outer(np.cos(angles), ahead) + np.outer(np.sin(angles), aside)
    return np.asarray(centre + radius * spread)


def out_and_back(home: Array, targets: Array, times: int) -> Array:
    """Places of reaches from home to each target and back, `(1 + 2 times k, 3)`, from `(k, 3)`."""
    once = np.stack([targets, np.broadcast_to(home, targets.shape)], axis=1).reshape(-1, 3)
    return np.concatenate([np.reshape(home, (1, 3)), np.tile(once, (times, 1))])


_LINE_STEP = 0.05  # steps along a line are this long at most [m]
_LARGEST_CHANGE = 0.3  # most change of a joint from step to step [rad; m]; else the step is halved
_LINE_END = 1.0 - 1e-9  # a share of the line that is its end, but for rounding
_SHORTEST = 2.0**-12  # a share of the line so short that still changes a posture too much: a jump


class UnfollowableWay(DataError):
    """A way that cannot be followed; its `progress` counts the moves that were, with fractions."""

    progress: float = 0.0


@dataclass(frozen=True, eq=False)
class Followed:
    """Postures `(k, n)` along a line between two places, `(2, 3)` [m], at `shares` of it."""

    solver: InverseKinematics
    ends: Array
    shares: Array
    q: Array

    def postures(self, shares: Array) -> Array | None:
        """Postures at shares `(N,)` of the line, `(N, n)`; `None` where they leave the branch."""
        from scipy.interpolate import make_interp_spline

        targets = self.ends[0] + shares[:, None] * (self.ends[1] - self.ends[0])
        near = np.asarray(make_interp_spline(self.shares, self.q, k=3)(shares))
        found = self.solver.solve(targets, near, near=True)
        good = found.reached.all() and np.abs(found.q - near).max() < _LARGEST_CHANGE
        return found.q if good else None


def follow(
    solver: InverseKinematics,
    ends: Array,
    start: Array,
    rest: Array,
    names: Sequence[str],
    *,
    to: Array | None = None,
    where: str,
) -> Followed:
    """Follow a straight line between two places, `(2, 3)` [m], from the posture `start`.

    Spare joints are drawn to the posture `rest`; the line ends in the posture `to`, if given, each
    `(n,)` [rad; m]. The joints' names and the move are for messages.
    """
    most = 1.0 / max(4, int(np.ceil(np.linalg.norm(ends[1] - ends[0]) / _LINE_STEP)))
    shares, postures, step = [0.0], [start], most
    while shares[-1] < 1.0:
        share = shares[-1] + step if shares[-1] + step < _LINE_END else 1.0
        target = ends[0] + share * (ends[1] - ends[0])
        found = solver.solve(target[None], postures[-1][None], near=True)
        change = found.q[0] - postures[-1]
        if found.reached[0] and np.abs(change).max() < _LARGEST_CHANGE:
            shares.append(share)
            postures.append(solver.drawn(target, found.q[0], rest))
            step = min(most, 2.0 * step)
        elif step > _SHORTEST:
            step *= 0.5
        else:
            followed = Followed(solver, ends, np.array(shares), np.array(postures))
            raise _obstacle_of_line(followed, found, share, names, where)
    followed = Followed(solver, ends, np.array(shares), np.array(postures))
    return followed if to is None else _arriving(followed, to, names, where)


def _arriving(followed: Followed, to: Array, names: Sequence[str], where: str) -> Followed:
    """The same line, its spare joints led to a given posture at the end."""
    off, solver, s = to - followed.q[-1], followed.solver, followed.shares
    if solver.spare <= 0:
        q, arrives = followed.q, bool(np.abs(off).max() <= 1e-6)
    else:
        blend = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        line = followed.ends[0] + s[:, None] * (followed.ends[1] - followed.ends[0])
        found = solver.solve(line, followed.q + blend[:, None] * off, near=True)
        q, smooth = found.q, np.abs(np.diff(found.q, axis=0)).max() <= 2.0 * _LARGEST_CHANGE
        arrives = bool(np.abs(q[-1] - to).max() <= 1e-6 and found.reached.all() and smooth)
    if not arrives:
        j = int(np.argmax(np.abs(off)))
        raise unfollowable_error(
            "the posture at the end of the straight line differs from that of the motion: joint "
            f"'{names[j]}' is off by {abs(off[j]):.2f}",
            where,
            1.0,
        )
    return Followed(solver, followed.ends, s, q)


def _obstacle_of_line(
    followed: Followed, found: Postures, share: float, names: Sequence[str], where: str
) -> UnfollowableWay:
    """What stops a line: the end of a joint's range, or a posture that would have to jump."""
    solver, q, change = followed.solver, found.q[0], found.q[0] - followed.q[-1]
    at = f"after {100.0 * share:.0f} % of its way"
    ended = [
        f"'{name}' at its {end} limit"
        for name, low, high in zip(names, q <= solver.lower, q >= solver.upper, strict=True)
        for end, there in (("lower", low), ("upper", high))
        if there
    ]
    j = int(np.argmax(np.abs(change)))
    if ended:
        wrong = f"the straight line ends {at}: joint {', joint '.join(ended)}"
    elif not found.reached[0]:
        wrong = f"the straight line leaves the reachable workspace {at}"
    else:
        wrong = f"joint '{names[j]}' would have to jump by {change[j]:.2f} {at} of a straight line"
    return unfollowable_error(wrong, where, share)


def unfollowable_error(wrong: str, where: str, share: float) -> UnfollowableWay:
    """The error, with what helps against it."""
    error = UnfollowableWay(
        wrong,
        where=where,
        fix="use path = 'joint' or another start posture, leave the tool's orientation free, or "
        "move the points away from the limit of the reach and from the base",
    )
    error.progress = share
    return error


_OFF_TARGET_WEIGHT = 100.0  # a metre off the shifted target weighs as so many metres of shift
_SHIFT_FACTORS = (1.0, 1.002, 1.01, 1.03, 1.1, 1.25)  # on the least shift; the first that works
_MOST_SHIFT_STEPS = 200  # steps of the search for the least shift at most


def postures_at(solver: InverseKinematics, places: Array, start: Array, seed: int) -> Array | None:
    """A posture for each place, `(K, n)`, from one or as many; `None` where one is out of reach."""
    starts = np.broadcast_to(start, (len(places), len(solver.lower)))
    found = solver.solve(places, starts)
    q = found.q.copy()
    for k in np.flatnonzero(np.logical_not(found.reached)):
        again = solver.reach(places[k], starts[k], seed)
        if not again.reached[0]:
            return None
        q[k] = again.q[0]
    return q


def refuse_out_of_reach(
    solver: InverseKinematics, places: Array, start: Array, seed: int, *, what: str, where: str
) -> None:
    """Refuse places `(K, 3)` [m], which would be moved together, if one is out of reach.

    The error says how far, and the least move of all that would help. The search begins at `start`.
    """
    if postures_at(solver, places, start, seed) is not None:
        return
    shifts = [least_shift(solver, place[None], start, seed) for place in places]
    lengths = [np.inf if shift is None else float(np.linalg.norm(shift)) for shift in shifts]
    k = int(np.argmax(lengths))
    worst, shift = shifts[k], least_shift(solver, places, start, seed)
    missed = (
        "no reachable position with this orientation was found"
        if worst is None
        else f"the nearest reachable position is ({_point_text(places[k] + worst)}) m, "
        f"{lengths[k]:.3f} m away"
    )
    fix = (
        "no reachable shift of the whole was found: make it smaller, or relax the orientation"
        if shift is None
        else f"move {what} by ({_point_text(shift)}) m, {np.linalg.norm(shift):.3f} m in all: "
        "the smallest found that is reachable"
    )
    wrong = f"{what} is out of reach: of ({_point_text(places[k])}) m, {missed}"
    raise DataError(wrong, where=where, fix=fix)


def least_shift(solver: InverseKinematics, places: Array, start: Array, seed: int) -> Array | None:
    r"""The least common shift of places, shape `(3,)` [m], after which all can be reached.

    Minimises $\|d\|^2 + w^2 \sum_k \|p(q_k) - p_k - d\|^2$ over the shift and all postures within
    their ranges, then lengthens the shift by little until every place is seen to be reached. To the
    millimetre; `None` if no shift was found.
    """
    nearest = _nearest(solver, places, start, seed)
    off = solver.place(nearest) - places
    furthest = off[int(np.argmax(np.linalg.norm(off, axis=1)))]
    begun = (
        (np.mean(off, axis=0), nearest),
        (furthest, _nearest(solver, places + furthest, start, seed)),
    )
    shifts = [_shifted(solver, places, shift, q, seed) for shift, q in begun]
    good = [shift for shift in shifts if shift is not None]
    return min(good, key=lambda shift: float(np.linalg.norm(shift)), default=None)


def _nearest(solver: InverseKinematics, places: Array, start: Array, seed: int) -> Array:
    return np.array([solver.reach(place, start, seed).q[0] for place in places])


def _shifted(
    solver: InverseKinematics, places: Array, shift: Array, q: Array, seed: int
) -> Array | None:
    """The least shift that is found from a first one and postures `(K, n)`."""
    from scipy.optimize import least_squares

    count, n = q.shape
    wide = np.full(3, np.inf)
    lower = np.concatenate([-wide, np.tile(solver.lower, count)])
    upper = np.concatenate([wide, np.tile(solver.upper, count)])
    inside = np.clip(q, solver.lower + 1e-9, solver.upper - 1e-9)

    def rest(x: Array) -> Array:
        missing = solver.missing(x[3:].reshape(count, n), places + x[:3])
        return np.concatenate([x[:3], _OFF_TARGET_WEIGHT * missing.ravel()])

    def slopes(x: Array) -> Array:
        """How shift and misses grow with shift and postures."""
        rates = solver.rates(x[3:].reshape(count, n))
        rows = rates.shape[1]
        matrix = np.zeros((3 + count * rows, 3 + count * n))
        matrix[:3, :3] = np.eye(3)
        for k, block in enumerate(rates):
            at = 3 + k * rows
            matrix[at : at + 3, :3] = _OFF_TARGET_WEIGHT * np.eye(3)
            matrix[at : at + rows, 3 + k * n : 3 + (k + 1) * n] = -_OFF_TARGET_WEIGHT * block
        return matrix

    first = np.concatenate([shift, inside.ravel()])
    found = least_squares(rest, first, slopes, bounds=(lower, upper), max_nfev=_MOST_SHIFT_STEPS)
    for pad in _SHIFT_FACTORS:
        advised: Array = np.round(pad * found.x[:3], 3)
        if postures_at(solver, places + advised, found.x[3:].reshape(count, n), seed) is not None:
            return advised
    return None


def _point_text(place: Array) -> str:
    return ", ".join(f"{x:.3f}" for x in np.round(place, 3) + 0.0)
