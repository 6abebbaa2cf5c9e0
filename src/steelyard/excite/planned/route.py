"""A tour of places turned into one motion that keeps all limits and ends where it started."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint import MotionLimits
from steelyard.excite.constraints.markers import ToolWay
from steelyard.excite.planned.inverse_kinematics import InverseKinematics, start_posture, within
from steelyard.excite.planned.moves import (
    Move,
    MovePace,
    ProcessMotion,
    ToolGuidance,
    Tour,
    joint_move,
    line_move,
    pace,
)
from steelyard.excite.planned.postures import (
    UnfollowableWay,
    follow,
    postures_at,
    refuse_out_of_reach,
    unfollowable_error,
)
from steelyard.excite.trajectories.polynomials import PiecewiseMotion
from steelyard.model.equations.kinematics import frame_kinematics
from steelyard.robot.robot import Robot

_STARTS = 48
"""Random starts of the search for first postures."""
_BRANCHES = 8
"""First postures that are tried at most."""
_HELD_UP = 6.0
"""A move that takes this many times the median may pass by a singular posture."""
_SLOWER = 1.0 + 1e-9
"""Keeps a limit that a move meets exactly from being passed by rounding."""


@dataclass(frozen=True, eq=False)
class Planner:
    """Plans tours of one frame of a robot.

    Attributes:
        robot: The robot.
        limits: Of its joints.
        frame: The frame that visits the places.
        manner: How it is led.
        solver: Of the inverse kinematics, in ranges that leave a little room for splines.
        seed: Of its random starts.
        start: Posture near which tours begin, shape `(n,)`; `None` for any that lets them pass.
    """

    robot: Robot
    limits: MotionLimits
    frame: str
    manner: ToolGuidance
    solver: InverseKinematics
    seed: int
    start: Array | None

    @classmethod
    def of(
        cls,
        robot: Robot,
        limits: MotionLimits,
        frame: str,
        manner: ToolGuidance,
        seed: int,
        start: ArrayLike | None,
    ) -> "Planner":
        """The planner for a frame.

        Raises:
            ModelError: There is no such frame, it does not move, or loops decide where it is.
            DataError: The start posture is none of the robot's, or outside its ranges.
        """
        solver = InverseKinematics.of(robot, frame, within(limits), manner.attitude)
        posture = None if start is None else start_posture(robot, limits, start)
        return cls(robot, limits, frame, manner, solver, seed, posture)

    def demand(self, places: Array, what: str, which: str) -> None:
        """Refuse places `(K, 3)` [m] that would be moved together, if one is out of reach.

        Args:
            places: The places.
            what: What they are, such as `the pick box`.
            which: Which places of it, such as `corners`.
        """
        where = f"{self.where}, {which}"
        refuse_out_of_reach(self.solver, places, self._near, self.seed, what=what, where=where)

    def run(self, tour: Tour) -> ProcessMotion:
        """The fastest motion along a tour.

        Raises:
            DataError: A place is out of reach; says how far, and how it would have to be moved. Or
                all places are one.
            Astray: A line cannot be followed from any of the postures tried.
        """
        if np.ptp(tour.places, axis=0).max() <= 0.0:
            raise DataError(
                "all positions of the task coincide",
                where=self.where,
                fix="give larger or separate boxes, or different positions",
            )
        if postures_at(self.solver, tour.places, self._near, self.seed) is None:
            for place, name in zip(tour.places, tour.names, strict=True):
                self.demand(place[None], name, "on its way")
        walk = _Walk(self, tour, ToolWay.of(frame_kinematics(self.robot, self.frame)))
        failed: list[UnfollowableWay] = []
        made: list[ProcessMotion] = []
        for first in self._branches(tour.places[0]):
            try:
                made.append(walk.run(first))
            except UnfollowableWay as error:
                failed.append(error)
            if made and not _pauses(made[-1]):
                break
        if not made:
            raise max(failed, key=lambda error: error.progress)
        return min(made, key=_duration)

    @property
    def where(self) -> str:
        """For messages."""
        return f"frame '{self.frame}' of robot '{self.robot.name}'"

    @property
    def _near(self) -> Array:
        """Posture to search from."""
        if self.start is not None:
            return self.start
        middle: Array = 0.5 * (self.limits.lower + self.limits.upper)
        return middle

    def _branches(self, place: Array) -> Array:
        """Postures to begin in, `(B, n)`: the nearest first, or those that can move best."""
        solver = self.solver
        found = solver.reach(place, self._near, self.seed, restarts=_STARTS)
        q: Array = found.q[found.reached]
        if self.start is not None:
            return q[:_BRANCHES]
        return solver.agile_first(q)[:_BRANCHES]


@dataclass(frozen=True, eq=False)
class _Walk:
    """A tour on the way from one posture to the next."""

    planner: Planner
    tour: Tour
    way: ToolWay

    def run(self, first: Array) -> ProcessMotion:
        """The motion that starts in a posture; raises `UnfollowableWay` where it ends."""
        places, count = self.tour.places, len(self.tour.places)
        known = {places[0].tobytes(): first}
        done: dict[bytes, tuple[Move, MovePace]] = {}
        moves: list[tuple[Move, MovePace] | None] = []
        for k in range(count):
            ends = places[[k, (k + 1) % count]]
            key = ends.tobytes()
            if np.array_equal(ends[0], ends[1]):
                moves.append(None)
                continue
            if key not in done:
                try:
                    move = self._move(k, ends, known, first)
                except UnfollowableWay as error:
                    error.progress += k
                    raise
                done[key] = (move, self._pace(move))
            moves.append(done[key])
        return self._joined(moves, known)

    def _move(self, k: int, ends: Array, known: dict[bytes, Array], rest: Array) -> Move:
        """The move after visit `k`; its end posture becomes known."""
        planner, manner, names = self.planner, self.planner.manner, self.tour.names
        start, to = known[ends[0].tobytes()], known.get(ends[1].tobytes())
        where = f"{planner.where}, from {names[k]} to {names[(k + 1) % len(names)]}"
        if manner.path == "joint":
            q = self._next(ends[1], start, rest, where) if to is None else to
            move = joint_move(start, q)
        else:
            joints = planner.robot.joint_names
            followed = follow(planner.solver, ends, start, rest, joints, to=to, where=where)
            q = followed.q[-1] if to is None else to
            move = line_move(followed, self.way, manner.straightness, where)
        self._check_range(move, where)
        known[ends[1].tobytes()] = q
        return move

    def _next(self, place: Array, start: Array, rest: Array, where: str) -> Array:
        """The posture for a place, the nearest that is found."""
        solver = self.planner.solver
        found = solver.solve(place[None], start[None])
        if not found.reached[0]:
            found = solver.reach(place, start, self.planner.seed, restarts=_STARTS)
        if not found.reached[0]:
            raise unfollowable_error("no posture was found for its end", where, 0.0)
        return solver.drawn(place, found.q[0], rest)

    def _check_range(self, move: Move, where: str) -> None:
        """Refuse a move that leaves a joint's range between its postures."""
        low, high = move.curve.extremes(0)
        limits = self.planner.limits
        past = np.maximum(limits.lower - low, high - limits.upper)
        j = int(np.argmax(past))
        if past[j] > 0.0:
            name = self.planner.robot.joint_names[j]
            raise unfollowable_error(
                f"joint '{name}' exceeds its range by {past[j]:.3g}", where, 1.0
            )

    def _pace(self, move: Move) -> MovePace:
        planner, manner = self.planner, self.planner.manner
        names = planner.robot.joint_names
        return pace(move, self.way, planner.limits, manner.tool, manner.share, names)

    def _joined(
        self, moves: list[tuple[Move, MovePace] | None], known: dict[bytes, Array]
    ) -> ProcessMotion:
        """All moves and rests one after another; a move that is none stays where it is."""
        order = [*range(len(moves)), 0]
        places, dwells = self.tour.places[order], self.tour.dwells[order]
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
            self.tour.cycles,
            tuple(timed for _, timed in made),
        )


def _quintic(coefficients: Array) -> Array:
    """Polynomials `(p, d + 1, n)` of degree five or less as quintic ones."""
    lacking = 6 - coefficients.shape[1]
    return np.pad(coefficients, ((0, 0), (0, lacking), (0, 0)))


def _duration(motion: ProcessMotion) -> float:
    return motion.trajectory.duration


def _pauses(motion: ProcessMotion) -> bool:
    """Whether a move takes so much longer than most that another posture may do it sooner."""
    times = [pace.duration for pace in motion.paces]
    return max(times) > _HELD_UP * float(np.median(times))
