r"""What holds at all times of a motion, bounds over stretches of time; limits of effort and power.

Between two breaks a motion is smooth and its snap bounded, $|q^{(4)}| \le S$, so within $r$ of a
stretch's middle the jerk is at most $J = |\dddot q_m| + S r$, or what it is over all times, and

$$|q - q_m| \le |\dot q_m| r + |\ddot q_m| r^2/2 + J r^3/6, \quad
  |\dot q - \dot q_m| \le |\ddot q_m| r + J r^2/2, \quad |\ddot q - \ddot q_m| \le J r.$$

A least margin is proven by bounding it over every stretch, and again over parts of those
stretches whose bound is still too far below the least margin that was seen at a middle. Where that
margin is small but kept, it is the sign that counts: half of it is too far then.

Friction that turns with the sign of the velocity counts the worse way at every time, so margins
are continuous and a proof need not know when a joint turns back; `effort_range` says how.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Array, Parameters, frozen, set_fields
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory, divided
from steelyard.model.equations.effort_range_over_friction_signs import effort_range
from steelyard.model.equations.frame_and_point_kinematics import frame_of, refuse_fixed
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot
from steelyard.symbolic.interval_bounds import enclosed
from steelyard.symbolic.native.compiled_programs import Code, compiled, compiled_equations
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program
from steelyard.symbolic.symbols_and_tracing import in_time, symbolic

STRETCHES = 512  # stretches of time to begin with
MOST_STRETCHES = 100_000  # stretches after which a proof ends with the bound that it has

_PIECES = 8
_ROUNDING = 1e-12
_FINEST = 0.02
_NEAR = 2.0  # over activation distances: a search may keep a reserve of margins beyond them
_STATE = ("q", "dq", "ddq")


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


class TracedConstraint(Constraint):
    """A constraint whose margins are equations over position, velocity and acceleration.

    They also take arrays that do not change in time, one each of all that stand in `cases`, so the
    margins are those of the first case, then of the second and so on. `key` is all else that the
    equations depend on, as JSON. A proof may stay the `tolerance` below the least margin at a
    sample. Subclasses are dataclasses.
    """

    def __getstate__(self) -> dict[str, Any]:
        """What pickle keeps: compiled code is of one process."""
        return {own.name: getattr(self, own.name) for own in fields(cast("Any", self))}

    @property
    @abstractmethod
    def n(self) -> int:
        """How many coordinates a state has."""

    @property
    @abstractmethod
    def key(self) -> list[Any]:
        """See the class."""

    @property
    @abstractmethod
    def tolerance(self) -> Array:
        """See the class, shape `(k,)`."""

    @property
    def cases(self) -> list[list[Array]]:
        """See the class."""
        return [[]]

    @abstractmethod
    def equations(self, q: Scalars, dq: Scalars, ddq: Scalars, *shared: Scalars) -> list[Scalar]:
        """The margins of one case."""

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """See `Constraint`; margins of twice the activation distance or more get no derivatives."""
        state = [q.T, dq.T, ddq.T]
        values = np.vstack([self._values([*state, *case]) for case in self.cases]).T
        result = [np.zeros((*values.shape, self.n)) for _ in state]
        near, count = values < _NEAR * self.activation_distance, self._values.n_outputs
        for k, case in enumerate(self.cases):
            samples, which = np.nonzero(near[:, k * count : (k + 1) * count])
            seeds = np.zeros((count, len(samples)))
            seeds[which, np.arange(len(samples))] = 1.0
            found = self._back([*(x[:, samples] for x in state), *case, seeds]).T
            for full, part in zip(result, np.split(found, 3, axis=1), strict=True):
                full[samples, k * count + which] = part
        return Margins(values, *result)

    def proven(self, trajectory: ExactTrajectory) -> Array:
        """See `Constraint`."""
        return proven_minimum(trajectory, self._bound, self.tolerance)

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        parts = [stretches.around(*self._programs, *case) for case in self.cases]
        least, _, away = (np.concatenate(x) for x in zip(*parts, strict=True))
        return least, least - away

    def _inputs(self, *state: str) -> list[Input]:
        fixed = [Input(f"shared{k}", len(x), shared=True) for k, x in enumerate(self.cases[0])]
        return [*(Input(name, self.n) for name in state), *fixed]

    @cached_property
    def _values(self) -> Code:
        """Margins; the programs of them and of their rates of change are stated beside it."""

        def rates(*x: Scalars) -> list[Scalar]:
            return in_time(lambda *state: self.equations(*state, *x[4:]), *x[:4])

        def build() -> tuple[Program, dict[str, Any]]:
            program = symbolic(self.equations, self._inputs(*_STATE))
            rated = symbolic(rates, self._inputs(*_STATE, "dddq"))
            return program, {"values": program, "rates": rated}

        return compiled(["margins", *self.key], build)

    @cached_property
    def _back(self) -> Code:
        """The reverse derivative of the margins by position, velocity and acceleration."""
        description = ["margins", *self.key]
        return compiled_equations(
            description, self.equations, self._inputs(*_STATE), back=(0, 1, 2)
        )

    @cached_property
    def _programs(self) -> tuple[Program, Program]:
        values, rates = self._values.beside("values", "rates")
        return values, rates


TORQUE_ROOM = 0.1  # share of a limit at which it begins to matter

TORQUE_TOLERANCE = 1e-3
"""A proof may stay so far below the least margin at a sample, over the limit."""


@dataclass(frozen=True, eq=False)
class EffortLimit(TracedConstraint):
    """Efforts or powers within limits, either way, in every case.

    Of those `which` have a limit, their positive limits, one each; with `power` those of every
    joint and of all together. Per case the `values` of the model, `(p,)`. Margins are case by case,
    all upper sides before all lower ones.
    """

    name: str
    labels: tuple[str, ...]
    unit: str
    model: Model
    power: bool
    which: tuple[int, ...]
    limits: Array
    values: tuple[Array, ...]
    scope: str = ""
    activation_distance: Array = field(init=False)
    how: str = field(init=False)

    def __post_init__(self) -> None:
        rubs = [name in self.model.friction_names for name in self.model.names]
        how = "interval arithmetic bounds the rate of change of efforts over every time interval"
        worse = "; friction has its worse sign" if any(x[rubs].any() for x in self.values) else ""
        set_fields(self, how=how + worse, activation_distance=TORQUE_ROOM * self.scale)

    @property
    def n(self) -> int:
        """See `TracedConstraint`."""
        return self.model.robot.n

    @property
    def key(self) -> list[Any]:
        """See `TracedConstraint`."""
        return ["effort", self.power, self.which, self.model.program_key]

    @property
    def cases(self) -> list[list[Array]]:
        """See `TracedConstraint`: parameters of the model, and limits."""
        return [[values, self.limits] for values in self.values]

    @property
    def scale(self) -> Array:
        """The limit behind every margin."""
        return np.tile(self.limits, 2 * len(self.values))

    @property
    def tolerance(self) -> Array:
        """See `TracedConstraint`."""
        return TORQUE_TOLERANCE * self.scale

    def equations(self, q: Scalars, dq: Scalars, ddq: Scalars, *shared: Scalars) -> list[Scalar]:
        """See `TracedConstraint`."""
        x = (q, dq, ddq, shared[0])
        most, least = effort_range(self._efforts(True, *x), self._rough, x, self.power)
        limited = list(zip(self.which, shared[1], strict=True))
        return [
            *(limit - most[k] for k, limit in limited),
            *(limit + least[k] for k, limit in limited),
        ]

    @cached_property
    def _rough(self) -> Program | None:
        """Efforts of the laws, which may take the sign of a velocity."""
        if all(term.role == "body" for term in self.model.terms):
            return None
        inputs = [*(Input(name, self.n) for name in _STATE), Input("x", len(self.model.parameters))]
        return symbolic(partial(self._efforts, False), inputs)

    def _efforts(self, smooth: bool, *x: Scalars) -> Scalars:
        """Efforts of the bodies or of everything else."""
        values: list[Scalar] = []
        start = 0
        for term in self.model.terms:
            stop = start + len(term.parameters(self.model.robot))
            values += [x[3][k] for k in range(start, stop) if (term.role == "body") == smooth]
            start = stop
        terms = tuple(term for term in self.model.terms if (term.role == "body") == smooth)
        return Model(self.model.robot, terms).torque_of(JointState(*x[:3]), values)


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
