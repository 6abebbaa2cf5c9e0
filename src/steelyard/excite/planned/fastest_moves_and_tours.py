r"""Moves as fast as limits of joints and tool allow, and tours of places as one motion.

A move is a fixed curve $q(\tau)$ of joint positions over the unit of time, run through in the time
$T$: speeds are $q'/T$, accelerations $q''/T^2$, jerks $q'''/T^3$. So the shortest time that keeps
all limits is known at once from the extremes of the curve's derivatives, without iteration; those
of the tool's way are proven over all times. The way along the curve is the minimum-jerk one,
$s = 10\tau^3 - 15\tau^4 + 6\tau^5$ [Flash1985].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.collision.solids_and_shapes import axes_along
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import Stretches, proven_minimum
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.constraints.tool_workspace import Paths
from steelyard.excite.planned.inverse_kinematics import Attitude, InverseKinematics, within
from steelyard.excite.planned.tool_paths_lines_and_reach import (
    Followed,
    UnfollowableWay,
    follow,
    postures_at,
    refuse_out_of_reach,
    unfollowable_error,
)
from steelyard.excite.trajectories.exact_trajectories import (
    ORDERS,
    ExactTrajectory,
    PiecewiseMotion,
    from_scipy,
    stretch_within,
    through_postures,
)
from steelyard.model.equations.frame_and_point_kinematics import (
    FrameKinematics,
    frame_kinematics,
    points_on,
)
from steelyard.robot.robot import Frame, Robot

_FIRST_STRETCHES = 64  # stretches of time that a proof begins with


class ToolWay:
    """The way of a frame's origin."""

    def __init__(self, kinematics: FrameKinematics) -> None:
        frame = kinematics.frame
        self.kinematics = kinematics
        self.points = points_on(kinematics.robot, [frame.body], frame.position[None])

    def seen(self, motion: ExactTrajectory, t: Array) -> tuple[float, float]:
        r"""Greatest speed and acceleration at times [m/s, m/s²].

        $v = J \dot q$ and $a = J \ddot q + \dot J \dot q$, the second from the Jacobian's change
        along the way.
        """
        q, dq, ddq = (motion.derivative(t, order) for order in range(3))
        small = 1e-6
        places = q, q + small * dq, q - small * dq
        here, ahead, behind = (self.kinematics(x)[2][:, :3] for x in places)
        speeds = np.einsum("nij,nj->ni", here, dq)
        bends = np.einsum("nij,nj->ni", here, ddq)
        bends += np.einsum("nij,nj->ni", (ahead - behind) / (2.0 * small), dq)
        speed, bend = (float(np.linalg.norm(x, axis=1).max()) for x in (speeds, bends))
        return speed, bend

    def proven(
        self, motion: ExactTrajectory, tolerances: Sequence[float], ends: Array | None = None
    ) -> list[float]:
        """Bounds of speed [m/s], acceleration [m/s²] and way off a line [m] at all times.

        They may stay the tolerances above what is reached, of speed, acceleration and deviation;
        infinite where a rough bound will do. The straight line is through two `ends`, `(2, 3)` [m],
        if given.
        """
        normals = np.zeros((0, 3)) if ends is None else axes_along(ends[1] - ends[0])[:, :2].T
        levels = np.zeros(0) if ends is None else normals @ ends[0]

        def bound(stretches: Stretches) -> tuple[Array, Array]:
            path = Paths(self.points, stretches)
            speed, bend = _greatest_length(path.speeds[:, 0]), _greatest_length(path.bends[:, 0])
            sharp = _greatest_length(np.stack(stretches.middles(self.points.bend)))
            off = [path.along(0, n) - d for n, d in zip(normals, levels, strict=True)]
            sides = np.reshape(off, (-1, 2, 2, len(speed)))
            away = np.linalg.norm(np.abs(sides).max(axis=2), axis=0)
            middle = np.stack([speed, sharp, away[0]])
            over = np.stack([speed + stretches.half * bend, bend, away[1]])
            return -middle, -over

        least = proven_minimum(motion, bound, np.array(tolerances), count=_FIRST_STRETCHES)
        return [-float(x) for x in least]


def _greatest_length(bounds: Array) -> Array:
    """Greatest length of vectors within bounds `(2, 3, B)`, shape `(B,)`."""
    return np.asarray(np.linalg.norm(np.abs(bounds).max(axis=0), axis=0))


STRAIGHTNESS = 1e-4  # greatest distance from a line [m], and turn from the attitude [rad]
_MOST_PIECES = 1024  # pieces of a line at most
_SAMPLES_PER_PIECE = 8  # samples of the tool's way per piece
_LEAST_WAY_SAMPLES = 64  # samples of the tool's way per move at least
_SAMPLED_SHARE = 0.5  # share of the straightness that samples may use, before it is proven
_PROOF_EXCESS = 0.1  # share of it by which the proven deviation may exceed the true one
_TIME_TOLERANCE = 0.01  # excess of the proven time for the tool's limits over the shortest


@dataclass(frozen=True, eq=False)
class Move:
    """Joint positions over times from 0 to 1, how long they take [s], and the limit that is met.

    On lines also how far the tool leaves them [m].
    """

    curve: PiecewiseMotion
    deviation: float
    duration: float
    limit: str


@dataclass(frozen=True)
class ToolGuidance:
    """How the tool is led: on straight lines of its own, or straight in joint space.

    The attitude is kept at all times on lines, else at places. Highest speed [m/s] and acceleration
    [m/s²] are those of the tool's origin, beside the joints' limits.
    """

    path: Literal["line", "joint"] = "line"
    attitude: Attitude = Attitude()
    speed: float = np.inf
    acceleration: float = np.inf


def line_move(followed: Followed, way: ToolWay, where: str) -> tuple[PiecewiseMotion, float]:
    """Along a straight line of the tool, as a quintic spline through exact postures.

    It keeps within `STRAIGHTNESS` of the line [m] and of the attitude [rad]. Also how far it leaves
    the line [m].
    """
    from scipy.interpolate import make_interp_spline

    pieces, missed = 8, np.inf
    while pieces < _MOST_PIECES:
        pieces *= 2
        tau = np.linspace(0.0, 1.0, pieces + 1)
        postures = followed.postures(tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2))
        if postures is None:
            continue
        postures[0], postures[-1] = followed.q[0], followed.q[-1]
        rest = [(order, np.zeros(postures.shape[1])) for order in (1, 2)]
        curve = from_scipy(make_interp_spline(tau, postures, k=5, bc_type=(rest, rest)))
        missed = _off_line(curve, followed)
        if missed > _SAMPLED_SHARE * STRAIGHTNESS:
            continue
        rough = (np.inf, np.inf, _PROOF_EXCESS * STRAIGHTNESS)
        return curve, way.proven(curve, rough, followed.ends)[2]
    raise unfollowable_error(
        "the postures along the straight line change so fast that no smooth motion was found that "
        f"keeps to it within {1e3 * STRAIGHTNESS:.3g} mm; it is missed by {1e3 * missed:.3g} mm",
        where,
        1.0,
    )


def shortest_time(
    curve: PiecewiseMotion, way: ToolWay, limits: MotionLimits, guidance: ToolGuidance
) -> tuple[float, str]:
    """The shortest time of a curve that goes somewhere [s], and the limit that it meets."""
    names = way.kinematics.robot.joint_names
    duration, order, j = stretch_within(curve, limits.greatest)
    times = [(duration, f"{ORDERS[order]} of '{names[j]}'")]
    speed, bend = way.seen(curve, _samples(curve))
    tool_times = (speed / guidance.speed, np.sqrt(bend / guidance.acceleration))
    if max(tool_times) * (1.0 + _TIME_TOLERANCE) > duration:
        tolerances = (_TIME_TOLERANCE * speed, 2.0 * _TIME_TOLERANCE * bend, np.inf)
        most_speed, most_bend, _ = way.proven(curve, tolerances)
        times.append((most_speed / guidance.speed, "speed of the tool"))
        root = float(np.sqrt(most_bend / guidance.acceleration))
        times.append((root, "acceleration of the tool"))
    return max(times)


def _samples(curve: PiecewiseMotion) -> Array:
    between = max(_SAMPLES_PER_PIECE * (len(curve.breaks) - 1), _LEAST_WAY_SAMPLES)
    return np.linspace(0.0, 1.0, between + 1)


def _off_line(curve: PiecewiseMotion, followed: Followed) -> float:
    """Greatest distance from the line [m] or turn from the attitude [rad] that samples show."""
    place, rotation, _ = followed.solver.kinematics(curve.derivative(_samples(curve), 0))
    start, way = followed.ends[0], followed.ends[1] - followed.ends[0]
    along = np.clip((place - start) @ way / (way @ way), 0.0, 1.0)
    away = place - start - along[:, None] * way
    turns = followed.solver.attitude.turns(rotation)
    return max(float(np.linalg.norm(x, axis=1).max()) for x in (away, turns))


@dataclass(frozen=True, eq=False)
class Tour:
    """Places `(K, 3)` [m] of the tool in the order of the visits; at the end back to the first.

    It dwells after arriving, per visit `(K,)` [s]; at the first, at the very end. Places `(k, 3)`
    are `required` to be in reach, with what they are and which of it, such as `corners` of `the
    box`.
    """

    places: Array
    names: tuple[str, ...]
    dwells: Array
    cycles: int
    required: tuple[tuple[Array, str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class ProcessMotion:
    """A process motion, from rest to rest, ending in the posture it started in.

    Places visited, the first again at the end, `(K + 1, 3)` [m], times of arrival `(K + 1,)` [s]
    and postures there, `(K + 1, n)`; the tool's greatest distance from its straight lines [m],
    proven for all times; the `moves`, each with its time and limit.
    """

    trajectory: PiecewiseMotion
    places: Array
    arrivals: Array
    postures: Array
    deviation: float
    cycles: int
    moves: tuple[Move, ...]

    @property
    def summary(self) -> str:
        """One line that reports it."""
        limits = [move.limit for move in self.moves]
        most = max(sorted(set(limits)), key=limits.count)
        straight = f"deviation from straight lines {1e3 * self.deviation:.2g} mm at most; "
        return (
            f"{self.cycles} cycles, {len(self.moves)} moves in {self.trajectory.duration:.2f} s; "
            f"{straight if self.deviation else ''}most moves are limited by the {most}"
        )


_STARTS = 48  # random starts of the search for first postures
_BRANCHES = 8  # first postures that are tried at most
_HELD_UP = 6.0  # a move that takes this many times the median may pass by a singular posture
_SAME = 1e-6  # places nearer to each other than this are one [m]
_SLOWER = 1.0 + 1e-9  # keeps a limit that a move meets exactly from being passed by rounding


class TourPlanner:
    """Plans motions of a frame; the seed is that of the search for postures.

    Solves the inverse kinematics in ranges that leave a little room for splines.

    Raises:
        ModelError: The frame does not move, or loops decide where it is.
    """

    def __init__(
        self, robot: Robot, limits: MotionLimits, frame: Frame, guidance: ToolGuidance, seed: int
    ) -> None:
        self._robot, self._limits, self._guidance, self._seed = robot, limits, guidance, seed
        self._solver = InverseKinematics.of(robot, frame, within(limits), guidance.attitude)
        self._middle: Array = 0.5 * (limits.lower + limits.upper)
        self._way = ToolWay(frame_kinematics(robot, frame))
        self._where = f"frame '{frame.name}' of robot '{robot.name}'"

    def fastest(self, tour: Tour) -> ProcessMotion:
        """The fastest motion along a tour.

        Raises:
            DataError: A place is out of reach; says how far, and how it would have to be moved. Or
                all places are one.
            UnfollowableWay: A line cannot be followed from any of the postures tried.
        """
        solver, middle, seed = self._solver, self._middle, self._seed
        required = tour.required
        if np.ptp(tour.places, axis=0).max() <= _SAME:
            raise DataError(
                "all positions of the task coincide",
                where=self._where,
                fix="give larger or separate boxes, or different positions",
            )
        if postures_at(solver, tour.places, middle, seed) is None:
            named = zip(tour.places, tour.names, strict=True)
            required += tuple((place[None], name, "on its way") for place, name in named)
        for places, what, which in required:
            where = f"{self._where}, {which}"
            refuse_out_of_reach(solver, places, middle, seed, what=what, where=where)
        found = solver.reach(tour.places[0], middle, seed, restarts=_STARTS)
        failed: list[UnfollowableWay] = []
        made: list[ProcessMotion] = []
        for first in solver.agile_first(found.q[found.reached])[:_BRANCHES]:
            try:
                made.append(self._toured(tour, first))
            except UnfollowableWay as error:
                failed.append(error)
            # a move that takes so much longer than most may be done sooner by another posture
            times = [move.duration for move in made[-1].moves] if made else []
            if made and max(times) <= _HELD_UP * float(np.median(times)):
                break
        if not made:
            raise max(failed, key=lambda error: error.progress)
        return min(made, key=lambda motion: motion.trajectory.duration)

    def _toured(self, tour: Tour, first: Array) -> ProcessMotion:
        """The motion that starts in a posture; raises `UnfollowableWay` where it ends."""
        places = tour.places
        known = {places[0].tobytes(): first}
        done: dict[bytes, Move] = {}
        moves: list[Move | None] = []
        for k in range(len(places)):
            ends = places[[k, (k + 1) % len(places)]]
            key = ends.tobytes()
            if np.array_equal(ends[0], ends[1]):
                moves.append(None)
                continue
            if key not in done:
                try:
                    done[key] = self._move(tour, k, ends, known, first)
                except UnfollowableWay as error:
                    error.progress += k
                    raise
            moves.append(done[key])
        return _joined(tour, moves, known)

    def _move(
        self, tour: Tour, k: int, ends: Array, known: dict[bytes, Array], rest: Array
    ) -> Move:
        """The move after visit `k`; its end posture becomes known."""
        start, to, deviation = known[ends[0].tobytes()], known.get(ends[1].tobytes()), 0.0
        where = f"{self._where}, from {tour.names[k]} to {tour.names[(k + 1) % len(tour.names)]}"
        if self._guidance.path == "joint":
            q = to
            if q is None:
                found = self._solver.solve(ends[1:], start[None])
                if not found.reached[0]:
                    found = self._solver.reach(ends[1], start, self._seed, restarts=_STARTS)
                if not found.reached[0]:
                    raise unfollowable_error("no posture was found for its end", where, 0.0)
                q = self._solver.drawn(ends[1], found.q[0], rest)
            curve = through_postures([start, q], 1.0)
        else:
            joints = self._robot.joint_names
            followed = follow(self._solver, ends, start, rest, joints, to=to, where=where)
            q = followed.q[-1] if to is None else to
            curve, deviation = line_move(followed, self._way, where)
        low, high = curve.extremes(0)
        past = np.maximum(self._limits.lower - low, high - self._limits.upper)
        j = int(np.argmax(past))
        if past[j] > 0.0:
            name = self._robot.joint_names[j]
            raise unfollowable_error(
                f"joint '{name}' exceeds its range by {past[j]:.3g}", where, 1.0
            )
        known[ends[1].tobytes()] = q
        paced = shortest_time(curve, self._way, self._limits, self._guidance)
        return Move(curve, deviation, *paced)


def _joined(tour: Tour, moves: list[Move | None], known: dict[bytes, Array]) -> ProcessMotion:
    """All moves and rests one after another; a move that is none stays where it is."""
    order = [*range(len(moves)), 0]
    places, dwells = tour.places[order], tour.dwells[order]
    postures = np.array([known[place.tobytes()] for place in places])
    widths, coefficients, arrivals = [np.zeros(0)], [], [0.0]
    for k, move in enumerate(moves, start=1):
        if move is not None:
            widths.append(np.diff(move.curve.breaks) * move.duration * _SLOWER)
            coefficients.append(_quintic(move.curve.coefficients))
        arrivals.append(float(np.concatenate(widths).sum()))
        if dwells[k] > 0.0:
            widths.append(dwells[k : k + 1])
            coefficients.append(_quintic(postures[None, k : k + 1]))
    breaks = np.concatenate([[0.0], np.cumsum(np.concatenate(widths))])
    made = tuple(move for move in moves if move is not None)
    return ProcessMotion(
        PiecewiseMotion(breaks, np.concatenate(coefficients)),
        places,
        frozen(arrivals),
        frozen(postures),
        max(move.deviation for move in made),
        tour.cycles,
        made,
    )


def _quintic(coefficients: Array) -> Array:
    """Polynomials `(p, d + 1, n)` of degree five or less as quintic ones."""
    return np.pad(coefficients, ((0, 0), (0, 6 - coefficients.shape[1]), (0, 0)))
