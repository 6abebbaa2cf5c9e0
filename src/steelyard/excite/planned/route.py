r"""Moves as fast as limits allow, and tours of places as one motion that ends where it started.

A move is a fixed curve $q(\tau)$ of joint positions over the unit of time, run through in the time
$T$: speeds are $q'/T$, accelerations $q''/T^2$, jerks $q'''/T^3$. So the shortest time that keeps
all limits is known at once from the extremes of the curve's derivatives, without iteration. The
way along the curve is the minimum-jerk one, $s = 10\tau^3 - 15\tau^4 + 6\tau^5$ [Flash1985].
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint import MotionLimits
from steelyard.excite.constraints.workspace import ToolWay
from steelyard.excite.planned.inverse_kinematics import (
    Attitude,
    InverseKinematics,
    start_posture,
    within,
)
from steelyard.excite.planned.postures import (
    Followed,
    UnfollowableWay,
    follow,
    postures_at,
    refuse_out_of_reach,
    unfollowable_error,
)
from steelyard.excite.trajectories.polynomials import SMOOTH, PiecewiseMotion, from_scipy
from steelyard.excite.trajectories.trajectory import ORDERS
from steelyard.model.equations.kinematics import frame_kinematics
from steelyard.robot.robot import Robot

_MOST_PIECES = 1024
"""Pieces of a line at most."""
_SAMPLES_PER_PIECE = 8
"""Samples of the tool's way per piece."""
_LEAST_WAY_SAMPLES = 64
"""Samples of the tool's way per move at least."""
_SAMPLED_SHARE = 0.5
"""Share of the straightness that samples may use up, before it is proven for all times."""
_PROOF_EXCESS = 0.1
"""Share of the straightness by which the proven deviation may exceed the true one."""
_TIME_TOLERANCE = 0.01
"""How far the proven time for the tool's limits may be above the shortest one, relatively."""


@dataclass(frozen=True, eq=False)
class Move:
    """A move: joint positions over times from 0 to 1.

    On lines also the greatest distance of the tool from its straight line [m], and its greatest
    turn from its attitude [rad].
    """

    curve: PiecewiseMotion
    deviation: float = 0.0
    turned: float = 0.0


@dataclass(frozen=True)
class ToolLimits:
    """Highest speed [m/s] and acceleration [m/s²] of the tool's origin."""

    speed: float = np.inf
    acceleration: float = np.inf

    def __post_init__(self) -> None:
        if not (self.speed > 0.0 and self.acceleration > 0.0):
            raise DataError(
                f"a tool speed of {self.speed} m/s and acceleration of {self.acceleration} m/s² "
                "allow no motion",
                where="tool limits of a process motion",
                fix="give a speed and an acceleration above 0, or leave them out",
            )


@dataclass(frozen=True)
class MovePace:
    """How long a move takes [s], and the limit that it meets."""

    duration: float
    limit: str


def joint_move(start: Array, end: Array) -> Move:
    """All joints together, straight in joint space."""
    coefficients = np.outer(SMOOTH, end - start)
    coefficients[0] = start
    return Move(PiecewiseMotion(np.array([0.0, 1.0]), coefficients[None]))


def line_move(followed: Followed, way: ToolWay, straightness: float, where: str) -> Move:
    """Along a straight line of the tool, as a quintic spline through exact postures.

    It keeps within `straightness` of the line [m] and of the attitude [rad].
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
        deviation, turned = _off_line(curve, followed)
        missed = max(deviation, turned)
        if missed > _SAMPLED_SHARE * straightness:
            continue
        rough = (np.inf, np.inf, _PROOF_EXCESS * straightness)
        return Move(curve, way.proven(curve, rough, followed.ends).deviation, turned)
    raise unfollowable_error(
        "the postures along the straight line change so fast that no smooth motion was found that "
        f"keeps to it within {1e3 * straightness:.3g} mm; it is missed by {1e3 * missed:.3g} mm",
        where,
        1.0,
    )


def pace(
    move: Move,
    way: ToolWay,
    limits: MotionLimits,
    tool: ToolLimits,
    share: float,
    names: tuple[str, ...],
) -> MovePace:
    """The shortest time that keeps a share of all limits, for a move that goes somewhere."""
    bounds = [limits.velocity, limits.acceleration]
    bounds += [] if limits.jerk is None else [limits.jerk]
    times: list[tuple[float, str]] = []
    for order, bound in enumerate(bounds, start=1):
        low, high = move.curve.extremes(order)
        needed = (np.maximum(-low, high) / (share * bound)) ** (1.0 / order)
        j = int(np.argmax(needed))
        times.append((float(needed[j]), f"{ORDERS[order]} of '{names[j]}'"))
    duration = max(times)[0]
    speed, bend = way.seen(move.curve, _samples(move.curve))
    tool_times = (speed / (share * tool.speed), np.sqrt(bend / (share * tool.acceleration)))
    if max(tool_times) * (1.0 + _TIME_TOLERANCE) > duration:
        extent = way.proven(
            move.curve, (_TIME_TOLERANCE * speed, 2.0 * _TIME_TOLERANCE * bend, np.inf)
        )
        times.append((extent.speed / (share * tool.speed), "speed of the tool"))
        root = float(np.sqrt(extent.acceleration / (share * tool.acceleration)))
        times.append((root, "acceleration of the tool"))
    return MovePace(*max(times))


def _samples(curve: PiecewiseMotion) -> Array:
    """Times that resolve a move's pieces."""
    between = max(_SAMPLES_PER_PIECE * (len(curve.breaks) - 1), _LEAST_WAY_SAMPLES)
    return np.linspace(0.0, 1.0, between + 1)


def _off_line(curve: PiecewiseMotion, followed: Followed) -> tuple[float, float]:
    """Greatest distance from the line [m] and turn from the attitude [rad] that samples show."""
    place, rotation = followed.solver.kinematics.pose(curve.derivative(_samples(curve), 0))
    start, way = followed.ends[0], followed.ends[1] - followed.ends[0]
    along = np.clip((place - start) @ way / (way @ way), 0.0, 1.0)
    away = place - start - along[:, None] * way
    turns = followed.solver.attitude.turns(rotation)
    return float(np.linalg.norm(away, axis=1).max()), float(np.linalg.norm(turns, axis=1).max())


@dataclass(frozen=True)
class ToolGuidance:
    """How the tool is led.

    Attributes:
        path: `line`: straight lines of the tool; `joint`: straight in joint space.
        attitude: What is required of the tool's orientation, at all times on lines, else at places.
        tool: Highest speed and acceleration of the tool's origin, beside the joints' limits.
        share: Of all limits but positions that is used.
        straightness: Greatest distance from a line [m], and turn from the attitude [rad].
        dwell: Rest at every place of the task [s].
    """

    path: Literal["line", "joint"] = "line"
    attitude: Attitude = Attitude()
    tool: ToolLimits = ToolLimits()
    share: float = 1.0
    straightness: float = 1e-4
    dwell: float = 0.0

    def __post_init__(self) -> None:
        wrong = {
            "path": self.path not in ("line", "joint"),
            "share": not 0.0 < self.share <= 1.0,
            "straightness": not self.straightness > 0.0,
            "dwell": not 0.0 <= self.dwell < np.inf,
        }
        for name in (name for name, bad in wrong.items() if bad):
            raise DataError(
                f"{name} = {getattr(self, name)!r} cannot be used",
                where="settings of a process motion",
                fix="path is 'line' or 'joint', 0 < share <= 1, straightness > 0 m, dwell >= 0 s",
            )


@dataclass(frozen=True, eq=False)
class Tour:
    """Places of the tool in the order of the visits; after the last one it goes back to the first.

    Attributes:
        places: Shape `(K, 3)` [m], in the base frame.
        dwells: Rest after arriving, per visit, `(K,)` [s]; that of the first is at the very end.
    """

    places: Array
    names: tuple[str, ...]
    dwells: Array
    cycles: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen(self.places, (len(self.names), 3)))
        object.__setattr__(self, "dwells", frozen(self.dwells, (len(self.names),)))


@dataclass(frozen=True, eq=False)
class ProcessMotion:
    """A process motion, and notes on it.

    Attributes:
        trajectory: From rest to rest, ending in the posture it started in.
        places: Places visited, the first one again at the end, shape `(K + 1, 3)` [m].
        arrivals: Times of arrival there, shape `(K + 1,)` [s].
        postures: Postures there, shape `(K + 1, n)` [rad; m].
        deviation: Greatest distance of the tool from its straight lines [m], proven for all times.
        turned: Greatest turn of the tool from its attitude on lines [rad], at samples.
        paces: Per move its time and the limit that it meets.
    """

    trajectory: PiecewiseMotion
    places: Array
    arrivals: Array
    postures: Array
    deviation: float
    turned: float
    cycles: int
    paces: tuple[MovePace, ...]

    @property
    def summary(self) -> str:
        """One line that reports it."""
        limits = [pace.limit for pace in self.paces]
        most = max(sorted(set(limits)), key=limits.count)
        straight = f"deviation from straight lines {1e3 * self.deviation:.2g} mm at most; "
        return (
            f"{self.cycles} cycles, {len(self.paces)} moves in {self.trajectory.duration:.2f} s; "
            f"{straight if self.deviation else ''}most moves are limited by the {most}"
        )


_STARTS = 48
"""Random starts of the search for first postures."""
_BRANCHES = 8
"""First postures that are tried at most."""
_HELD_UP = 6.0
"""A move that takes this many times the median may pass by a singular posture."""
_SLOWER = 1.0 + 1e-9
"""Keeps a limit that a move meets exactly from being passed by rounding."""


class Planner:
    """Plans tours of one frame of a robot, led in a `manner`.

    The inverse kinematics is solved in ranges that leave a little room for splines. Tours begin
    near the posture `start`, shape `(n,)`, or in any that lets them pass.

    Raises:
        ModelError: There is no such frame, it does not move, or loops decide where it is.
        DataError: The start posture is none of the robot's, or outside its ranges.
    """

    def __init__(
        self,
        robot: Robot,
        limits: MotionLimits,
        frame: str,
        manner: ToolGuidance,
        seed: int,
        start: ArrayLike | None,
    ) -> None:
        self._robot, self._limits, self._manner, self._seed = robot, limits, manner, seed
        self._solver = InverseKinematics.of(robot, frame, within(limits), manner.attitude)
        self._start = None if start is None else start_posture(robot, limits, start)
        middle = 0.5 * (limits.lower + limits.upper)
        self._near: Array = middle if self._start is None else self._start
        self._way = ToolWay(frame_kinematics(robot, frame))
        self._where = f"frame '{frame}' of robot '{robot.name}'"

    def refuse_out_of_reach(self, places: Array, what: str, which: str) -> None:
        """Refuse places `(K, 3)` [m] that would be moved together, if one is out of reach.

        They are such as `corners` of `the pick box`.
        """
        where = f"{self._where}, {which}"
        refuse_out_of_reach(self._solver, places, self._near, self._seed, what=what, where=where)

    def run(self, tour: Tour) -> ProcessMotion:
        """The fastest motion along a tour.

        Raises:
            DataError: A place is out of reach; says how far, and how it would have to be moved. Or
                all places are one.
            UnfollowableWay: A line cannot be followed from any of the postures tried.
        """
        if np.ptp(tour.places, axis=0).max() <= 0.0:
            raise DataError(
                "all positions of the task coincide",
                where=self._where,
                fix="give larger or separate boxes, or different positions",
            )
        if postures_at(self._solver, tour.places, self._near, self._seed) is None:
            for place, name in zip(tour.places, tour.names, strict=True):
                self.refuse_out_of_reach(place[None], name, "on its way")
        found = self._solver.reach(tour.places[0], self._near, self._seed, restarts=_STARTS)
        first_postures: Array = found.q[found.reached]
        if self._start is None:
            first_postures = self._solver.agile_first(first_postures)
        failed: list[UnfollowableWay] = []
        made: list[ProcessMotion] = []
        for first in first_postures[:_BRANCHES]:
            try:
                made.append(self._toured(tour, first))
            except UnfollowableWay as error:
                failed.append(error)
            # a move that takes so much longer than most may be done sooner by another posture
            times = [one.duration for one in made[-1].paces] if made else []
            if made and max(times) <= _HELD_UP * float(np.median(times)):
                break
        if not made:
            raise max(failed, key=lambda error: error.progress)
        return min(made, key=lambda motion: motion.trajectory.duration)

    def _toured(self, tour: Tour, first: Array) -> ProcessMotion:
        """The motion that starts in a posture; raises `UnfollowableWay` where it ends."""
        places, names = tour.places, self._robot.joint_names
        known = {places[0].tobytes(): first}
        done: dict[bytes, tuple[Move, MovePace]] = {}
        moves: list[tuple[Move, MovePace] | None] = []
        for k in range(len(places)):
            ends = places[[k, (k + 1) % len(places)]]
            key = ends.tobytes()
            if np.array_equal(ends[0], ends[1]):
                moves.append(None)
                continue
            if key not in done:
                try:
                    move = self._move(tour, k, ends, known, first)
                except UnfollowableWay as error:
                    error.progress += k
                    raise
                tool, share = self._manner.tool, self._manner.share
                done[key] = move, pace(move, self._way, self._limits, tool, share, names)
            moves.append(done[key])
        return _joined(tour, moves, known)

    def _move(
        self, tour: Tour, k: int, ends: Array, known: dict[bytes, Array], rest: Array
    ) -> Move:
        """The move after visit `k`; its end posture becomes known."""
        start, to = known[ends[0].tobytes()], known.get(ends[1].tobytes())
        where = f"{self._where}, from {tour.names[k]} to {tour.names[(k + 1) % len(tour.names)]}"
        if self._manner.path == "joint":
            q = self._next(ends[1], start, rest, where) if to is None else to
            move = joint_move(start, q)
        else:
            joints = self._robot.joint_names
            followed = follow(self._solver, ends, start, rest, joints, to=to, where=where)
            q = followed.q[-1] if to is None else to
            move = line_move(followed, self._way, self._manner.straightness, where)
        low, high = move.curve.extremes(0)
        past = np.maximum(self._limits.lower - low, high - self._limits.upper)
        j = int(np.argmax(past))
        if past[j] > 0.0:
            name = self._robot.joint_names[j]
            raise unfollowable_error(
                f"joint '{name}' exceeds its range by {past[j]:.3g}", where, 1.0
            )
        known[ends[1].tobytes()] = q
        return move

    def _next(self, place: Array, start: Array, rest: Array, where: str) -> Array:
        """The posture for a place, the nearest that is found."""
        found = self._solver.solve(place[None], start[None])
        if not found.reached[0]:
            found = self._solver.reach(place, start, self._seed, restarts=_STARTS)
        if not found.reached[0]:
            raise unfollowable_error("no posture was found for its end", where, 0.0)
        return self._solver.drawn(place, found.q[0], rest)


def _joined(
    tour: Tour, moves: list[tuple[Move, MovePace] | None], known: dict[bytes, Array]
) -> ProcessMotion:
    """All moves and rests one after another; a move that is none stays where it is."""
    order = [*range(len(moves)), 0]
    places, dwells = tour.places[order], tour.dwells[order]
    postures = np.array([known[place.tobytes()] for place in places])
    widths, coefficients, arrivals = [np.zeros(0)], [], [0.0]
    for k, done in enumerate(moves, start=1):
        if done is not None:
            move, timed = done
            widths.append(np.diff(move.curve.breaks) * timed.duration * _SLOWER)
            coefficients.append(_quintic(move.curve.coefficients))
        arrivals.append(float(np.concatenate(widths).sum()))
        if dwells[k] > 0.0:
            widths.append(dwells[k : k + 1])
            coefficients.append(_quintic(postures[None, k : k + 1]))
    breaks = np.concatenate([[0.0], np.cumsum(np.concatenate(widths))])
    made = [move for move in moves if move is not None]
    return ProcessMotion(
        PiecewiseMotion(breaks, np.concatenate(coefficients)),
        places,
        frozen(arrivals),
        frozen(postures),
        max(move.deviation for move, _ in made),
        max(move.turned for move, _ in made),
        tour.cycles,
        tuple(timed for _, timed in made),
    )


def _quintic(coefficients: Array) -> Array:
    """Polynomials `(p, d + 1, n)` of degree five or less as quintic ones."""
    lacking = 6 - coefficients.shape[1]
    return np.pad(coefficients, ((0, 0), (0, lacking), (0, 0)))
