"""Joint efforts and powers of a model that stay within limits, for several payloads.

Friction that turns with the sign of the velocity counts the worse way at every time, so margins
are continuous and a proof need not know when exactly a joint turns back; `effort_bounds`
says how.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, Parameters, frozen
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.bounds_at_all_times import Stretches, proven_minimum
from steelyard.excite.constraints.constraint import Constraint, Margins
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.model.equations.frames_and_effort_bounds import EffortBounds, effort_bounds, frame_of
from steelyard.model.equations.inverse_dynamics import JointState, Scalar
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import Term
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot

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
        object.__setattr__(self, "how", how + worse)
        object.__setattr__(self, "activation_distance", TORQUE_ROOM * self.scale)

    def __getstate__(self) -> dict[str, Any]:
        """What pickle keeps: compiled code is of one process."""
        return {own.name: getattr(self, own.name) for own in fields(self)}

    @cached_property
    def bounds(self) -> EffortBounds:
        """Programs of the greatest and least values, `K` of each."""
        return _programs(self.model, self.power)

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
        low, high = stretches.middles(self.bounds.values, case)
        slowest, fastest = stretches.throughout(self.bounds.rates, case)
        upper, lower = list(self.which), [len(low) // 2 + k for k in self.which]
        limits = self.limits[:, None] * (1.0 - 1e-12)
        values = np.concatenate([limits - high[upper], limits + low[lower]])
        away = np.maximum(np.abs(slowest), np.abs(fastest))[upper + lower] * stretches.half
        return values, values - away * (1.0 + 1e-9)


def torque_limit(cases: Mapping[str, ValuedModel], limits: ArrayLike | None = None) -> EffortLimit:
    """Joint efforts within limits, `(n,)` [Nm; N], infinite for any; the robot's if `None`.

    Cases are the same model with values, such as without and with a payload, by name. It is one of
    a tree, of terms without internal states.

    Raises:
        ModelError: No joint has a limit.
    """
    robot = _model_of(cases).robot
    own = [joint.limits.effort for joint in robot.coordinates]
    titles = [
        f"{'torque' if unit == 'Nm' else 'force'} of '{joint}'"
        for joint, unit in zip(robot.joint_names, robot.effort_units, strict=True)
    ]
    given = own if limits is None else limits
    return _limit(cases, given, titles, robot.effort_units, power=False)


def power_limit(
    cases: Mapping[str, ValuedModel], limits: ArrayLike | None = None, total: float = np.inf
) -> EffortLimit:
    """Mechanical powers within limits, `(n,)` and in total [W], whether joints drive or brake.

    Infinite for any, `None` for any of all joints. Cases and errors are those of `torque_limit`.
    """
    robot = _model_of(cases).robot
    own = np.full(robot.n, np.inf) if limits is None else frozen(limits, (None,))
    titles = [f"power of '{joint}'" for joint in robot.joint_names]
    titles.append("power of all joints")
    return _limit(cases, [*own, total], titles, ["W"] * len(titles), power=True)


def payload_numbers(robot: Robot, frame: str, payload: Inertia) -> dict[str, float]:
    """What a payload in a frame adds to standard parameters, by name; nothing on the base."""
    place = frame_of(robot, frame)
    if place.body < 0:
        return {}
    ten, body = payload.moved(place.rotation, place.position).ten, robot.bodies[place.body].name
    return {f"{name}.{body}": float(x) for name, x in zip(INERTIAL_NAMES, ten, strict=True)}


def loaded(arm: ValuedModel, frame: str, payload: Inertia) -> ValuedModel:
    """A model of rigid bodies with a payload, given in one of its frames, which must move."""
    robot = arm.model.robot
    added = payload_numbers(robot, frame, payload)
    if not added:
        raise ModelError(
            f"frame '{frame}' is fixed to the base: a payload there loads no joint",
            where=f"robot '{robot.name}'",
            fix=f"name a frame that moves, such as '{robot.bodies[-1].name}'",
        )
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
    every, what = frozen(limits, (len(titles),)), "power" if power else "effort"
    name = "power" if power else "torque"
    if not np.all(every > 0.0) or not np.isfinite(every).any():
        raise ModelError(
            f"no joint has a limit of {what}"
            if np.all(every > 0.0)
            else f"a limit of {what} is not above zero: {', '.join(f'{x:g}' for x in every)}",
            where=name,
            fix=f"give a limit of {what} above zero for at least one joint",
        )
    which = tuple(int(k) for k in np.flatnonzero(np.isfinite(every)))
    chosen = every[list(which)]
    endings = [f", {case}" if len(cases) > 1 else "" for case in cases]
    labels = [
        f"{titles[k]} {side}{size:g} {units[k]}{ending}"
        for ending in endings
        for side in ("below ", "above -")
        for k, size in zip(which, chosen, strict=True)
    ]
    model = _model_of(cases)
    values = tuple(case.values.values for case in cases.values())
    unit = " or ".join(dict.fromkeys(units[k] for k in which))
    return EffortLimit(name, tuple(labels), unit, model, power, which, frozen(chosen), values)


def _model_of(cases: Mapping[str, ValuedModel]) -> Model:
    return next(iter(cases.values())).model


def _programs(model: Model, power: bool) -> EffortBounds:
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
        power,
    )
