r"""Joint motions that lead a frame along a path, on open and closed chains.

At knots of time, positions solve the inverse kinematics, and velocities and accelerations follow
from its derivatives: $J \dot q = v$, $J \ddot q = a - \dot J \dot q$. Between knots the motion is
the quintic polynomial that has all three at both ends; knots are added until the frame keeps to
the path in the middle between them. Joints that the path does not need stand still.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.planned.inverse_kinematics import (
    Attitude,
    InverseKinematics,
    weights_of,
)
from steelyard.excite.planned.tool_paths_lines_and_reach import ToolPath, UnfollowableWay
from steelyard.excite.trajectories.exact_trajectories import (
    PiecewiseMotion,
    quintic,
    stretch_within,
)
from steelyard.model.equations.frame_and_point_kinematics import (
    FrameKinematics,
    frame_of,
    refuse_fixed,
)
from steelyard.model.equations.passive_joints import Follower, random_positions
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Frame, Robot

_CLOSE = 1e-8  # greatest distance from the path between knots [m], and turn from the attitude [rad]
_SINGULAR = 1e-3  # least over greatest singular value of the Jacobian of a singular posture
_RANK = 1e-6  # the same, below which the mechanism cannot move that way at all
_CHANGE = 0.3  # from knot to knot, no joint differs by more from its prediction [rad; m]
_ROUNDS = 20  # newton steps at most
_SHORTEST = 2.0**-14  # shortest piece, as a share of the duration
_STARTS = 48  # random starts of the search for a first posture
_BRANCHES = 8  # first postures that are tried at most


@dataclass(frozen=True, eq=False)
class PathMotion:
    """A motion that leads a frame along a path, from rest to rest.

    Joints that the path does not need are `still`. The `excess` is the greatest share of a limit of
    speed or acceleration that is used, as a factor on the speed: 1.2 means that the motion keeps
    the limits in 1.2 times the time; `limited` is its joint and limit.
    """

    trajectory: PiecewiseMotion
    still: tuple[str, ...]
    excess: float
    limited: str


@dataclass(frozen=True, eq=False)
class _Knot:
    """Joints at a time."""

    t: float
    q: Array
    dq: Array
    ddq: Array


def along_path(
    robot: Robot,
    limits: MotionLimits,
    frame: str | Frame,
    path: ToolPath,
    attitude: Attitude | None = None,
    *,
    start: ArrayLike | None = None,
    seed: int = 0,
) -> PathMotion:
    """The motion of the joints that leads the origin of a frame along a path.

    The robot may have closed loops, and the frame may hang on their passive joints. Limits of
    positions are kept; speeds and accelerations are those of the path. It begins near the posture
    `start`, `(n,)` [rad; m]; by default in the one that can move best, with closed loops in the one
    nearest to the assembly. The seed is that of the search for it.

    Raises:
        ModelError: The robot has no such frame, or it does not move.
        DataError: The start posture is none of the robot's.
        UnfollowableWay: The path cannot be followed; says where, and why.
    """
    chosen = frame_of(robot, frame)
    refuse_fixed(robot, chosen)
    posture = None if start is None else frozen(start, (robot.n,))
    if posture is not None:
        refuse_outside(robot, limits, posture)
    walk = _Walk(robot, chosen, limits, path, attitude or Attitude())
    made: list[PathMotion] = []
    failed: list[UnfollowableWay] = []
    for first in walk.first_postures(posture, seed):
        try:
            made.append(walk.run(first))
        except UnfollowableWay as error:
            failed.append(error)
        if made and made[-1].excess <= 1.0:
            break
    if not made:
        raise max(failed, key=lambda error: error.progress)
    return min(made, key=lambda motion: motion.excess)


@dataclass(frozen=True, eq=False)
class _Walk:
    robot: Robot
    frame: Frame
    limits: MotionLimits
    path: ToolPath
    attitude: Attitude

    @cached_property
    def motion(self) -> FrameKinematics:
        return FrameKinematics(self.robot, self.frame)

    @cached_property
    def loops(self) -> Follower:
        return Follower(self.robot)

    def first_postures(self, start: Array | None, seed: int) -> Array:
        """Postures to begin in, the best first, shape `(B, n)`."""
        closed, robot, limits = bool(self.robot.passive), self.robot, self.limits
        kinematics = self._from_assembly if closed else self.motion
        solver = InverseKinematics(kinematics, limits.lower, limits.upper, self.attitude)
        near, rng = start, np.random.default_rng(seed)
        if near is None:
            middle = 0.5 * (limits.lower + limits.upper)
            near = loop_equations(robot).assembly[: robot.n] if closed else middle
        starts = (
            random_positions(robot, _STARTS, rng)[0].T
            if closed
            else rng.uniform(limits.lower, limits.upper, (_STARTS, robot.n))
        )
        found = solver.nearest(self.path.at(0.0)[0], np.vstack([near, starts]))
        if not found.reached[0]:
            raise self._astray(
                f"the start of the path is out of reach: the nearest position found is "
                f"{found.missed[0]:.3g} m away"
                + (f", {found.turned[0]:.3g} rad off" if self.attitude.rows else ""),
                0.0,
            )
        q = found.q[found.reached]
        kept = q if closed or start is not None else solver.agile_first(q)
        ratios = np.array([_ratios(rates) for rates in solver.rates(kept)])
        ranks = np.sum(ratios > _RANK, axis=1)
        rank = int(ranks.max())
        kept = kept[(ranks == rank) & (ratios[:, rank - 1] > _SINGULAR)]
        if not len(kept):
            raise self._astray("the posture at the start of the path is singular", 0.0)
        return np.asarray(kept[:_BRANCHES])

    def run(self, first: Array) -> PathMotion:
        if self.robot.passive:
            self.loops.restart()
        free = self._free(first)
        knots, pieces = list[_Knot](), list[Array]()
        for knot in self._knots(first, free):
            if knots:
                pieces.append(_piece(knots[-1], knot))
            knots.append(knot)
        curve = PiecewiseMotion(np.array([knot.t for knot in knots]), np.concatenate(pieces))
        still = tuple(name for j, name in enumerate(self.robot.joint_names) if j not in free)
        return PathMotion(curve, still, *self._excess(curve))

    def _free(self, q: Array) -> list[int]:
        """Joints that move: as many as the path needs, those that move the frame best."""
        from scipy.linalg import qr

        found = self._at(q, np.zeros(self.robot.n))
        if found is None:
            raise self._astray("a loop does not close at the start of the path", 0.0)
        _, triangle, order = qr(self._rows(found[2]), mode="economic", pivoting=True)
        sizes = np.abs(np.diag(triangle))
        return sorted(int(j) for j in order[: int(np.sum(sizes > _RANK * sizes[0]))])

    def _knots(self, first: Array, free: list[int]) -> Iterator[_Knot]:
        """Knots between which the quintic polynomials keep to the path."""
        times = self.path.knots[::-1].tolist()
        duration, last = times[0], self._solved(times.pop(), first, free)
        if last is None:
            raise self._astray("the start of the path cannot be reached", 0.0)
        yield last
        while times:
            t = times[-1]
            seconds = t - last.t
            ahead = last.q + seconds * (last.dq + 0.5 * seconds * last.ddq)
            knot = self._solved(t, ahead, free)
            if knot is not None and self._close(last, knot):
                times.pop()
                yield knot
                last = knot
            elif t - last.t > _SHORTEST * duration:
                times.append(0.5 * (last.t + t))
            else:
                reason = "it is out of reach"
                reason += ", or a loop does not close" if self.robot.passive else ""
                raise self._astray(
                    f"the path cannot be followed: {reason}"
                    if knot is None
                    else "the joints would have to move too fast to follow the path",
                    t,
                )

    def _solved(self, t: float, guess: Array, free: list[int]) -> _Knot | None:
        """The knot at a time, near a guess; `None` if there is none."""
        place, velocity, acceleration = self.path.at(t)
        q, still = np.array(guess), np.zeros(self.robot.n)
        for _ in range(_ROUNDS):
            found = self._at(q, still)
            if found is None:
                return None
            rest = np.concatenate([place - found[0], self.attitude.turns(found[1][None])[0]])
            rest *= weights_of(self.attitude)
            rates = self._rows(found[2])[:, free]
            step = np.linalg.lstsq(rates, rest, rcond=_RANK)[0]
            q[free] += step * min(1.0, _CHANGE / max(float(np.abs(step).max()), _CHANGE))
            if np.abs(step).max() < 1e-12:
                break
        if np.abs(rest).max() > 1e-10 or np.abs(q - guess).max() > _CHANGE:
            return None
        passive = self._passive(q)
        if passive is None:
            return None
        if _ratios(rates)[-1] < _SINGULAR:
            raise self._astray("the posture is singular there", t)
        self._check_range(q, t)
        dq, ddq = np.zeros(self.robot.n), np.zeros(self.robot.n)
        unturned = np.zeros(self.attitude.rows)
        dq[free] = np.linalg.lstsq(rates, np.append(velocity, unturned), rcond=None)[0]
        drift = self._rows(self.motion.moving(q, passive, dq)[3][:, None])[:, 0]
        needed = np.append(acceleration, unturned) - drift
        ddq[free] = np.linalg.lstsq(rates, needed, rcond=None)[0]
        return _Knot(t, q, dq, ddq)

    def _close(self, a: _Knot, b: _Knot) -> bool:
        """Whether the polynomial between two knots keeps to the path in its middle."""
        t = 0.5 * (a.t + b.t)
        q = _piece(a, b)[0].T @ 0.5 ** np.arange(6)
        found = self._at(q, np.zeros(self.robot.n))
        if found is None:
            return False
        missed = np.linalg.norm(self.path.at(t)[0] - found[0])
        turned = np.linalg.norm(self.attitude.turns(found[1][None]))
        return bool(max(missed, turned) <= _CLOSE)

    def _from_assembly(self, q: Array) -> tuple[Array, Array, Array]:
        """Kinematics of the frame at postures `(N, n)`, each reached straight from the assembly.

        Where a loop stays open there is no pose: numbers are not finite.
        """
        still, found = np.zeros(self.robot.n), []
        for posture in q:
            self.loops.restart()
            none = np.full(3, np.nan), np.full((3, 3), np.nan), np.zeros((6, self.robot.n))
            found.append((self._at(posture, still) or none)[:3])
        places, rotations, rates = zip(*found, strict=True)
        return np.array(places), np.array(rotations), np.array(rates)

    def _at(self, q: Array, dq: Array) -> tuple[Array, Array, Array, Array] | None:
        """Kinematics of the frame at a posture; `None` where a loop does not close."""
        passive = self._passive(q)
        return None if passive is None else self.motion.moving(q, passive, dq)

    def _passive(self, q: Array) -> Array | None:
        """Positions of the passive joints; `None` where a loop does not close."""
        if not self.robot.passive:
            return np.empty(0)
        self.loops.restart(self.loops.closed)
        return self.loops.closed[1] if self.loops.step(np.array(q)) else None

    def _rows(self, rates: Array) -> Array:
        """Rates of place and turns, shape `(3 + k, m)`, from those of the frame, `(6, m)`."""
        turned = self.attitude.slopes(rates[None, 3:])[0]
        return np.asarray(np.concatenate([rates[:3], turned]) * weights_of(self.attitude)[:, None])

    def _excess(self, curve: PiecewiseMotion) -> tuple[float, str]:
        factor, order, j = stretch_within(curve, self.limits.greatest[:2])
        return factor, f"{('speed', 'acceleration')[order - 1]} of '{self.robot.joint_names[j]}'"

    def _check_range(self, q: Array, t: float) -> None:
        past = np.maximum(self.limits.lower - q, q - self.limits.upper)
        j = int(np.argmax(past))
        if past[j] > 0.0:
            end = "lower" if q[j] < self.limits.lower[j] else "upper"
            limit = getattr(self.limits, end)[j]
            joint = self.robot.coordinates[j]
            raise self._astray(
                f"joint '{joint.name}' exceeds its {end} limit of {limit:.4g} {joint.unit} there", t
            )

    def _astray(self, wrong: str, t: float) -> UnfollowableWay:
        place = ", ".join(f"{x:.3f}" for x in self.path.at(t)[0] + 0.0)
        error = UnfollowableWay(
            wrong,
            where=f"frame '{self.frame.name}' of robot '{self.robot.name}', at ({place}) m, "
            f"t = {t:.3f} s",
            fix="move the path, make it smaller, leave the tool's orientation free, or begin in "
            "another posture (start = [...])",
        )
        error.progress = t
        return error


def refuse_outside(robot: Robot, limits: MotionLimits, posture: Array) -> None:
    """Refuse a start posture `(n,)` outside the position ranges."""
    past = np.maximum(limits.lower - posture, posture - limits.upper)
    j = int(np.argmax(past))
    if past[j] > 0.0:
        joint = robot.coordinates[j]
        raise DataError(
            f"the start posture is outside the range of joint '{joint.name}' by {past[j]:.3g} "
            f"{joint.unit}",
            where=f"robot '{robot.name}'",
            fix=f"choose it from {limits.lower[j]:.4g} to {limits.upper[j]:.4g} {joint.unit}",
        )


def _ratios(rates: Array) -> Array:
    """Singular values over the greatest, descending."""
    sizes = np.linalg.svd(rates, compute_uv=False)
    return np.asarray(sizes / max(sizes[0], np.finfo(np.float64).tiny))


def _piece(a: _Knot, b: _Knot) -> Array:
    return quintic((a.q, a.dq, a.ddq), (b.q, b.dq, b.ddq), b.t - a.t)
