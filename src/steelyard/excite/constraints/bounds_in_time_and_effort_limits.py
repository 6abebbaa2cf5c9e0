r"""What holds at all times of a motion, bounds over stretches of time; limits of effort and power.

Between two breaks a motion is smooth and its snap bounded, $|q^{(4)}| \le S$, so within $r$ of a
stretch's middle the jerk is at most $J = |\dddot q_m| + S r$, or what it is over all times, and

$$|q - q_m| \le |\dot q_m| r + |\ddot q_m| r^2/2 + J r^3/6, \quad
  |\dot q - \dot q_m| \le |\ddot q_m| r + J r^2/2, \quad |\ddot q - \ddot q_m| \le J r.$$

A least margin is proven by bounding it over every stretch, and again over parts of those
stretches whose bound is still too far below the least margin that was seen at a middle. Where that
margin is small but kept, it is the sign that counts: half of it is too far then.

Friction that turns with the sign of the velocity counts the worse way at every time, so margins
are continuous and a proof need not know when a joint turns back; `effort_bounds` says how.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Array, Parameters, frozen, set_fields
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory, divided
from steelyard.model.equations.effort_range_over_friction_signs import EffortBounds, effort_bounds
from steelyard.model.equations.frame_and_point_kinematics import frame_of, refuse_fixed
from steelyard.model.equations.inverse_dynamics import JointState, Scalar
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import Term
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot
from steelyard.symbolic.interval_bounds import enclosed
from steelyard.symbolic.program_and_softening import Program

STRETCHES = 512  # stretches of time to begin with
MOST_STRETCHES = 100_000  # stretches after which a proof ends with the bound that it has

_PIECES = 8
_ROUNDING = 1e-12
_FINEST = 0.02


@dataclass(frozen=True, eq=False)
class Stretches:
    """Stretches of time, by middles and half lengths `(B,)` [s], and where a motion is within them.

    Position, velocity, acceleration and jerk at the middles (`at`), their bounds over the
    stretches, `(4, n, B)` each, and how far those at the middles may be from the motion's, `(4, n,
    1)`.
    """

    middle: Array
    half: Array
    at: Array
    lower: Array
    upper: Array
    rounding: Array

    def middles(self, program: Program, *shared: Array) -> tuple[Array, Array]:
        """Bounds of a program at the middles, each `(outputs, B)`.

        It takes as many of position, velocity, acceleration and jerk, in this order, as it has
        inputs beside `shared`, which do not change in time.
        """
        count = len(program.inputs) - len(shared)
        at, rounding = self.at[:count], self.rounding[:count]
        return enclosed(program, [*(at - rounding), *shared], [*(at + rounding), *shared])

    def throughout(self, program: Program, *shared: Array) -> tuple[Array, Array]:
        """Bounds of a program over the whole stretches; see `middles`."""
        count = len(program.inputs) - len(shared)
        return enclosed(program, [*self.lower[:count], *shared], [*self.upper[:count], *shared])

    def around(self, values: Program, rates: Program, *shared: Array) -> tuple[Array, Array, Array]:
        """Bounds of a program at the middles, and how far it comes from there by its rates."""
        low, high = self.middles(values, *shared)
        slowest, fastest = self.throughout(rates, *shared)
        away = np.maximum(np.abs(slowest), np.abs(fastest)) * self.half
        return low, high, away * (1.0 + 1e-9)


Bound = Callable[[Stretches], tuple[Array, Array]]
"""Lower bounds of `k` margins at the middles of stretches and all over them, each `(k, B)`."""


class Course:
    """A motion with the bounds of its derivatives over all times."""

    def __init__(self, trajectory: ExactTrajectory) -> None:
        self._trajectory, self.duration = trajectory, trajectory.duration
        ends = np.array([trajectory.extremes(order) for order in range(4)])
        least, greatest = ends.transpose(1, 0, 2)[..., None]
        sizes = np.maximum(np.abs(least), np.abs(greatest))
        self._rounding = _ROUNDING * sizes
        self._least, self._most = least - self._rounding, greatest + self._rounding
        self._jerk = sizes[3] + self._rounding[3]
        snap = np.maximum(*(np.abs(end) for end in trajectory.extremes(4)))[:, None]
        self._snap = (1.0 + _ROUNDING) * snap

    def edges(self, count: int) -> Array:
        """Times from start to end, the breaks and about `count` more, ascending."""
        breaks = np.unique(np.concatenate([[0.0, self.duration], self._trajectory.breaks]))
        return divided(breaks, self.duration / count)

    def stretches(self, start: Array, end: Array) -> Stretches:
        """Stretches from `start` to `end`, each `(B,)` [s], none of them across a break."""
        middle = 0.5 * (start + end)
        # a little more than half: the middle is rounded
        half = 0.5 * (end - start) * (1.0 + 1e-9) + 1e-15 * self.duration
        at = np.array([self._trajectory.derivative(middle, order).T for order in range(4)])
        away = self._reach(at, half) + self._rounding
        lower, upper = np.maximum(at - away, self._least), np.minimum(at + away, self._most)
        return Stretches(middle, half, at, lower, upper, self._rounding)

    def _reach(self, at: Array, half: Array) -> Array:
        """How far position, velocity, acceleration and jerk come from the middle's, `(4, n, B)`."""
        _, speed, bend, jerk = np.abs(at) + self._rounding
        jerk = np.minimum(jerk + half * self._snap, self._jerk)
        reach = [
            half * (speed + half * (bend / 2.0 + half * jerk / 6.0)),
            half * (bend + half * jerk / 2.0),
            half * jerk,
            half * self._snap,
        ]
        return np.array(reach) * (1.0 + 1e-9)


def proven_minimum(
    trajectory: ExactTrajectory, bound: Bound, tolerance: Array, count: int = STRETCHES
) -> Array:
    """Lower bounds of margins that hold at all times, `(k,)`.

    A bound may stay the tolerance, `(k,)`, below the least margin at a middle, or a fiftieth of
    that where it decides whether the margin is kept. Begins with `count` stretches.
    """
    course = Course(trajectory)
    edges = course.edges(count)
    start, end = edges[:-1], edges[1:]
    seen = np.full(len(tolerance), np.inf)
    proven = seen.copy()
    used = len(start)
    while len(start):
        values, lower = bound(course.stretches(start, end))
        seen = np.minimum(seen, values.min(axis=1))
        spare = values - goals(seen, tolerance)[:, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = ((values - lower) / spare).max(axis=0)
        open_ = ~(ratio <= 1.0)
        pieces = np.clip(np.nan_to_num(np.ceil(ratio), nan=_PIECES), 2, _PIECES).astype(np.intp)
        used += int(pieces[open_].sum())
        if used > MOST_STRETCHES:
            open_[:] = False
        if not open_.all():
            proven = np.minimum(proven, lower[:, ~open_].min(axis=1))
        start, end, _ = cut(start[open_], end[open_], pieces[open_])
    return proven


def goals(seen: Array, tolerance: Array) -> Array:
    """The bounds of margins that are good enough, from the least margins seen, shape `(k,)`."""
    sharp = np.clip(0.5 * seen, _FINEST * tolerance, tolerance)
    return seen - np.where(seen > 0.0, sharp, tolerance)


def cut(
    start: Array, end: Array, pieces: NDArray[np.intp]
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Every stretch in as many equal parts as requested, without gaps; and whose each is."""
    owner = np.repeat(np.arange(len(pieces)), pieces)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    origin, length = start[owner], ((end - start) / pieces)[owner]
    return origin + number * length, origin + (number + 1) * length, owner


TORQUE_ROOM = 0.1  # share of a limit at which it begins to matter

TORQUE_TOLERANCE = 1e-3
"""A proof may stay so far below the least margin at a sample, over the limit."""


@dataclass(frozen=True, eq=False)
class EffortLimit(Constraint):
    """Efforts or powers within limits, either way, in every case.

    Of those `which` have a limit, their positive limits, one each; with `power` those of every
    joint and of all together. Per case the parameters of the model, `(p,)`. Margins are case by
    case, all upper sides before all lower ones.
    """

    name: str
    labels: tuple[str, ...]
    unit: str
    model: Model
    power: bool
    which: tuple[int, ...]
    limits: Array
    cases: tuple[Array, ...]
    scope: str = ""
    activation_distance: Array = field(init=False)
    how: str = field(init=False)

    def __post_init__(self) -> None:
        rubs = [name in self.model.friction_names for name in self.model.names]
        how = "interval arithmetic bounds the rate of change of efforts over every time interval"
        worse = "; friction has its worse sign" if any(x[rubs].any() for x in self.cases) else ""
        set_fields(self, how=how + worse, activation_distance=TORQUE_ROOM * self.scale)

    def __getstate__(self) -> dict[str, Any]:
        """What pickle keeps: compiled code is of one process."""
        return {own.name: getattr(self, own.name) for own in fields(self)}

    @cached_property
    def bounds(self) -> EffortBounds:
        """Programs of the greatest and least values, `K` of each."""
        model = self.model
        rough = tuple(term for term in model.terms if term.role != "body")
        smooth = tuple(term for term in model.terms if term.role == "body")

        def efforts(terms: tuple[Term, ...], *x: Sequence[Scalar]) -> list[Scalar]:
            values: list[Scalar] = []
            start = 0
            for term in model.terms:
                stop = start + len(term.parameters(model.robot))
                values += [x[3][k] for k in range(start, stop) if term in terms]
                start = stop
            return Model(model.robot, terms).torque_of(JointState(*x[:3]), values)

        return effort_bounds(
            [model.program_key],
            lambda *x: efforts(smooth, *x),
            (lambda *x: efforts(rough, *x)) if rough else None,
            model.robot.n,
            len(model.parameters),
            self.power,
        )

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """See `Constraint`."""
        parts = [self._margins([q.T, dq.T, ddq.T, case]) for case in self.cases]
        values, slopes = (np.concatenate(x, axis=1) for x in zip(*parts, strict=True))
        by_q, by_dq, by_ddq = (slopes[:, :, k] for k in range(3))
        return Margins(values, by_q, by_dq, by_ddq)

    def proven(self, trajectory: ExactTrajectory) -> Array:
        """See `Constraint`."""
        return proven_minimum(trajectory, self._bound, TORQUE_TOLERANCE * self.scale)

    @property
    def scale(self) -> Array:
        """The limit behind every margin."""
        return np.tile(self.limits, 2 * len(self.cases))

    def _margins(self, inputs: list[Array]) -> tuple[Array, Array]:
        """Margins of one case, `(N, 2m)`, and their derivatives, `(N, 2m, 3, n)`."""
        found = self.bounds.code(inputs).T
        n, count = len(inputs[0]), len(self.bounds.values.outputs)
        slopes = found[:, count:].reshape(len(found), count, 3, n)
        upper = list(self.which)
        lower = [count // 2 + k for k in self.which]
        values = np.hstack([self.limits - found[:, upper], self.limits + found[:, lower]])
        return values, np.concatenate([-slopes[:, upper], slopes[:, lower]], axis=1)

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        parts = [self._case_bound(stretches, case) for case in self.cases]
        values, lower = (np.concatenate(x) for x in zip(*parts, strict=True))
        return values, lower

    def _case_bound(self, stretches: Stretches, case: Array) -> tuple[Array, Array]:
        low, high, away = stretches.around(self.bounds.values, self.bounds.rates, case)
        upper, lower = list(self.which), [len(low) // 2 + k for k in self.which]
        limits = self.limits[:, None] * (1.0 - 1e-12)
        values = np.concatenate([limits - high[upper], limits + low[lower]])
        return values, values - away[upper + lower]


def torque_limit(cases: Mapping[str, ValuedModel], limits: ArrayLike) -> EffortLimit:
    """Joint efforts within limits above zero, `(n,)` [Nm; N], infinite for any.

    Cases are the same model with values, such as without and with a payload, by name. It is one of
    a tree, of terms without internal states.
    """
    robot = next(iter(cases.values())).model.robot
    titles = [
        f"{'torque' if unit == 'Nm' else 'force'} of '{joint}'"
        for joint, unit in zip(robot.joint_names, robot.effort_units, strict=True)
    ]
    return _limit(cases, limits, titles, robot.effort_units, power=False)


def power_limit(
    cases: Mapping[str, ValuedModel], limits: Array, total: float = np.inf
) -> EffortLimit:
    """Mechanical powers within limits, `(n,)` and in total [W], whether joints drive or brake.

    Above zero, infinite for any. Cases are those of `torque_limit`.
    """
    robot = next(iter(cases.values())).model.robot
    titles = [*(f"power of '{joint}'" for joint in robot.joint_names), "power of all joints"]
    return _limit(cases, [*limits, total], titles, ["W"] * len(titles), power=True)


def payload_numbers(robot: Robot, frame: str | None, payload: Inertia) -> dict[str, float]:
    """What a payload in a frame adds to standard parameters, by name; nothing on the base."""
    place = frame_of(robot, frame)
    if place.body < 0:
        return {}
    ten, body = payload.moved(place.rotation, place.position).ten, robot.bodies[place.body].name
    return {f"{name}.{body}": float(x) for name, x in zip(INERTIAL_NAMES, ten, strict=True)}


def with_payload(arm: ValuedModel, frame: str | None, payload: Inertia) -> ValuedModel:
    """A model of rigid bodies with a payload, given in one of its frames, which must move."""
    refuse_fixed(arm.model.robot, frame_of(arm.model.robot, frame))
    added = payload_numbers(arm.model.robot, frame, payload)
    names, values = arm.values.names, arm.values.values
    whole = [x + added.get(name, 0.0) for name, x in zip(names, values, strict=True)]
    return ValuedModel(arm.model, Parameters(names, arm.values.units, whole))


def _limit(
    cases: Mapping[str, ValuedModel],
    limits: ArrayLike,
    titles: Sequence[str],
    units: Sequence[str],
    power: bool,
) -> EffortLimit:
    every, name = frozen(limits, (len(titles),)), "power" if power else "torque"
    which = tuple(int(k) for k in np.flatnonzero(np.isfinite(every)))
    chosen = every[list(which)]
    endings = [f", {case}" if len(cases) > 1 else "" for case in cases]
    labels = [
        f"{titles[k]} {side}{size:g} {units[k]}{ending}"
        for ending in endings
        for side in ("below ", "above -")
        for k, size in zip(which, chosen, strict=True)
    ]
    model = next(iter(cases.values())).model
    values = tuple(case.values.values for case in cases.values())
    unit = " or ".join(dict.fromkeys(units[k] for k in which))
    return EffortLimit(name, tuple(labels), unit, model, power, which, frozen(chosen), values)
