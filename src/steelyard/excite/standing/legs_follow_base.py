r"""Joints of the legs that follow base and free limbs: motion, derivatives, constraints on them.

With independent joints $q$ and passive ones $p(q)$ a margin of the tree,
$m(q, p, \dot q, \dot p, \ddot q, \ddot p)$, has the derivatives by $q$, $\dot q$ and $\ddot q$ that
follow from $\dot p = G \dot q$, $\ddot p = G \ddot q + \dot G \dot q$ and
$\partial p / \partial q = G$.

The motion that is proven and written is that of all joints: quintic polynomials through exact
positions, velocities and accelerations, so that what is proven of it holds at all times. Between
their ends feet stay where they are up to the error of interpolation, which is measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, set_fields
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins, MotionLimits
from steelyard.excite.standing.standing_robot import tree_of
from steelyard.excite.trajectories.exact_trajectories import (
    ExactTrajectory,
    PiecewiseMotion,
    divided,
    quintic,
)
from steelyard.model.equations.inverse_dynamics import JointState, completed
from steelyard.model.equations.passive_joints import Follower, passive_ways
from steelyard.robot.loop_closures import gaps
from steelyard.robot.robot import Robot, robot_to_dict
from steelyard.symbolic.native.compiled_programs import Code, compiled_equations
from steelyard.symbolic.program_and_softening import InputArray as Input

RESERVE = 0.1  # share of an activation distance that a search keeps for legs that bend
OPEN = -10.0  # margins where the legs do not reach, over their activation distance

_STEPS_PER_SECOND = 50.0
_LEAST_STEPS = 100
_INTERPOLATION = 1e-3  # share of limits that is left to the error of the polynomials
_ROOM = 0.1  # share of a leg's limit at which it begins to matter


@dataclass(frozen=True, eq=False)
class AllJoints:
    """Independent joints and legs at `N` samples, `(N, n_joints)` each, and where feet reach."""

    q: Array
    dq: Array
    ddq: Array
    reached: NDArray[np.bool_]

    def of(self, samples: NDArray[np.intp]) -> "AllJoints":
        """Some of the samples."""
        return AllJoints(
            self.q[samples], self.dq[samples], self.ddq[samples], self.reached[samples]
        )


class Legs:
    """The legs of a robot that stands, by `standing`; the last answers are kept."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.tree = robot, tree_of(robot)
        self._last: tuple[list[Array], AllJoints] | None = None
        self._whole: tuple[ExactTrajectory, PiecewiseMotion] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """What pickle keeps: compiled code is of one process."""
        return Legs, (self.robot,)

    def at(self, q: Array, dq: Array, ddq: Array) -> AllJoints:
        """All joints from the independent ones, `(N, n)` each."""
        given = [q, dq, ddq]
        if self._last is None or not all(map(np.array_equal, self._last[0], given)):
            n, follower = self.robot.n, self._follower
            follower.restart((self.robot.assembly[:n], self.robot.assembly[n:]))
            passive, reached = follower(q.T)
            rates = self._rates([q.T, dq.T, ddq.T, passive]).T
            first, second = np.hsplit(rates, 2)
            found = AllJoints(
                np.hstack([q, passive.T]), np.hstack([dq, first]), np.hstack([ddq, second]), reached
            )
            self._last = [x.copy() for x in given], found
        return self._last[1]

    def by_independent(self, whole: AllJoints, slopes: Sequence[Array]) -> list[Array]:
        """Derivatives by the independent joints of values at samples, from those by all joints.

        By position, velocity and acceleration, shape `(N, n_joints)` each, to `(N, n)`.
        """
        n = self.robot.n
        states = [x[:, :n].T for x in (whole.q, whole.dq, whole.ddq)]
        seeds = np.hstack([slopes[1][:, n:], slopes[2][:, n:]]).T
        found = self._back([*states, whole.q[:, n:].T, seeds]).T
        by_q, by_dq, by_ddq, by_passive = np.split(found, [n, 2 * n, 3 * n], axis=1)
        through = np.einsum("tpk,tp->tk", self.ways(whole.q), by_passive + slopes[0][:, n:])
        own = [slope[:, :n] for slope in slopes]
        return [own[0] + by_q + through, own[1] + by_dq, own[2] + by_ddq]

    def ways(self, q: Array) -> Array:
        """Speeds of passive joints per speed of independent ones, `(N, n_passive, n)`.

        At positions of all joints `(N, n_joints)`.
        """
        n = self.robot.n
        found = self._map([q[:, :n].T, q[:, n:].T])
        return found.T.reshape(len(q), len(self.robot.passive), n)

    def ways_back(self, q: Array, seeds: Array) -> Array:
        """Derivatives of a sum of seeds times `ways` by all positions, `(N, n_joints)`."""
        n = self.robot.n
        inputs = [q[:, :n].T, q[:, n:].T, seeds.reshape(len(seeds), -1).T]
        return self._map_back(inputs).T

    def motion(self, trajectory: ExactTrajectory) -> PiecewiseMotion:
        """The motion of all joints, in the tree's order, of one of the independent ones.

        Raises:
            DataError: A foot does not reach its place.
        """
        if self._whole is None or self._whole[0] is not trajectory:
            longest = min(1.0 / _STEPS_PER_SECOND, trajectory.duration / _LEAST_STEPS)
            edges = divided(trajectory.breaks, longest)
            # both sides of a break are asked: accelerations may jump there
            ends = [edges[:-1], np.nextafter(edges[1:], 0.0)]
            sides = [
                self.at(*(trajectory.derivative(times, order) for order in range(3)))
                for times in ends
            ]
            for times, side in zip(ends, sides, strict=True):
                if not side.reached.all():
                    raise DataError(
                        f"a foot does not reach its place at t = "
                        f"{times[int(np.argmin(side.reached))]:.3f} s",
                        where="[excitation.stance]",
                        fix="give less sway and tilt, or a posture with legs bent more",
                    )
            starts, stops = ([s.q, s.dq, s.ddq] for s in sides)
            pieces = [
                quintic([x[k] for x in starts], [x[k] for x in stops], width)
                for k, width in enumerate(np.diff(edges))
            ]
            self._whole = trajectory, PiecewiseMotion(edges, np.concatenate(pieces))
        return self._whole[1]

    def slip(self, motion: PiecewiseMotion) -> float:
        """How far feet are from their places in the middle of the polynomials, at most [m]."""
        middles = 0.5 * (motion.edges[:-1] + motion.edges[1:])
        return max(float(gaps(self.robot, q).max()) for q in motion.derivative(middles, 0))

    @cached_property
    def _follower(self) -> Follower:
        return Follower(self.robot)

    @cached_property
    def _rates(self) -> Code:
        return self._compiled()

    @cached_property
    def _back(self) -> Code:
        return self._compiled(back=(0, 1, 2, 3))

    @cached_property
    def _map(self) -> Code:
        return passive_ways(self.robot)

    @cached_property
    def _map_back(self) -> Code:
        return passive_ways(self.robot, back=(0, 1))

    def _compiled(self, back: Sequence[int] | None = None) -> Code:
        """Velocities and accelerations of the passive joints; see `compiled_equations`."""
        robot, n = self.robot, self.robot.n

        def rows(q: Any, dq: Any, ddq: Any, passive: Any) -> list[Any]:
            state, _ = completed(robot, JointState(q, dq, ddq, passive))
            return [*state.dq[n:], *state.ddq[n:]]

        inputs = [*(Input(x, n) for x in ("q", "dq", "ddq")), Input("passive", len(robot.passive))]
        return compiled_equations(["legs", robot_to_dict(robot)], rows, inputs, back=back)


@dataclass(frozen=True, eq=False)
class OnAllJoints(Constraint):
    """A constraint of the tree as one of the independent joints, which the legs follow.

    Margins at samples are less by a `reserve`, a share of the activation distance: legs bend
    between samples. What is proven is not.
    """

    legs: Legs
    inner: Constraint
    reserve: float = 0.0
    name: str = field(init=False)
    labels: tuple[str, ...] = field(init=False)
    unit: str = field(init=False)
    activation_distance: Array = field(init=False)
    scope: str = field(init=False)
    how: str = field(init=False)

    def __post_init__(self) -> None:
        names = ("name", "labels", "unit", "activation_distance", "scope", "how")
        set_fields(self, **{name: getattr(self.inner, name) for name in names})

    @property
    def scale(self) -> Array:
        """See `Constraint`."""
        return self.inner.scale

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """See `Constraint`; derivatives are those of margins below the activation distance."""
        whole = self.legs.at(q, dq, ddq)
        found = self.inner.margins(whole.q, whole.dq, whole.ddq)
        values = found.values - self.reserve * self.activation_distance
        values[~whole.reached] = OPEN * self.activation_distance
        samples, which = np.nonzero((values < self.activation_distance) & whole.reached[:, None])
        near = whole.of(samples)
        slopes = [
            np.zeros_like(near.q) if by is None else by[samples, which]
            for by in (found.by_q, found.by_dq, found.by_ddq)
        ]
        parts = self.legs.by_independent(near, slopes)
        result = [np.zeros((*values.shape, self.legs.robot.n)) for _ in parts]
        for full, part in zip(result, parts, strict=True):
            full[samples, which] = part
        return Margins(values, *result)

    def proven(self, trajectory: ExactTrajectory) -> Array:
        """Of the motion of all joints."""
        return self.inner.proven(self.legs.motion(trajectory))


@dataclass(frozen=True, eq=False)
class LegLimits(Constraint):
    """Limits of joints as margins, in shares of half of each range, of those `which` move."""

    robot: Robot
    limits: MotionLimits
    which: tuple[int, ...]
    name: str = "limits of the legs"
    unit: str = "of half the range"
    how: str = "extremes of the polynomials of all joints"
    labels: tuple[str, ...] = field(init=False)
    activation_distance: Array = field(init=False)

    def __post_init__(self) -> None:
        labels = tuple(
            f"{what} of '{self.robot.coordinates[k].name}' {side}"
            for what in ("position", "velocity", "acceleration")
            for side in ("below its most", "above its least")
            for k in self.which
        )
        set_fields(self, labels=labels, activation_distance=np.full(len(labels), _ROOM))

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """See `Constraint`."""
        chosen, blocks = list(self.which), []
        count = len(chosen)
        slopes = np.zeros((3, len(self.labels), self.robot.n))
        for order, (x, (low, high)) in enumerate(
            zip((q, dq, ddq), self.limits.bounds, strict=False)
        ):
            half = 0.5 * (high - low)[chosen]
            blocks += [(high[chosen] - x[:, chosen]) / half, (x[:, chosen] - low[chosen]) / half]
            for side, sign in enumerate((-1.0, 1.0)):
                rows = (2 * order + side) * count + np.arange(count)
                slopes[order, rows, chosen] = sign / half
        by = [np.broadcast_to(slope, (len(q), *slope.shape)) for slope in slopes]
        return Margins(np.hstack(blocks), *by)

    def proven(self, trajectory: ExactTrajectory) -> Array:
        """See `Constraint`."""
        chosen, found = list(self.which), []
        for order, (low, high) in enumerate(self.limits.bounds[:3]):
            least, most = trajectory.extremes(order)
            half = 0.5 * (high - low)
            found += [((high - most) / half)[chosen], ((least - low) / half)[chosen]]
        return np.concatenate(found)


def limits_of_first(limits: MotionLimits, count: int) -> MotionLimits:
    """Limits of the first joints, a little narrower, so that the polynomials keep the others."""
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    half = (1.0 - _INTERPOLATION) * half
    lower, upper = middle - half, middle + half
    fastest = [(1.0 - _INTERPOLATION) * x[:count] for x in (limits.velocity, limits.acceleration)]
    return replace(
        limits,
        lower=lower[:count],
        upper=upper[:count],
        velocity=fastest[0],
        acceleration=fastest[1],
        notes=(),
    )
