"""Joint efforts and powers of a known model that stay within limits, for several payloads.

Friction that turns with the sign of the velocity counts the worse way at every time, so margins
are continuous and a proof need not know when exactly a joint turns back; `kernel/effort_bounds`
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
from steelyard.base.progress import Progress, silent
from steelyard.excite.constraints.bounding import Stretches, proven_minimum
from steelyard.excite.constraints.constraint import Constraint, Margins
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.model.equations.effort_bounds import EffortBounds, effort_bounds
from steelyard.model.equations.inverse_dynamics import JointState, Scalar
from steelyard.model.equations.kinematics import frame_of
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import StatefulTerm, Term
from steelyard.robot.rigid_body import INERTIAL_NAMES, Inertia

TORQUE_ROOM = 0.1
"""Share of a limit at which it begins to matter."""

TORQUE_TOLERANCE = 1e-3
"""How far below the least margin at a sample a proof may stay, as a share of the limit."""


@dataclass(frozen=True, eq=False)
class EffortLimit(Constraint):
    """Efforts or powers within limits, either way, in every case.

    Attributes:
        labels: What each margin is; case by case, all upper sides before all lower ones.
        model: The model whose efforts or powers are limited.
        power: Whether the power of every joint and of all together is limited, not the effort.
        which: Numbers of those that have a limit.
        limits: Shape `(len(which),)`, positive.
        cases: Parameters of the model per case, each `(p,)`.
        scope: Whose torques these are, for certificates.
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

    def proven(self, trajectory: ExactTrajectory, progress: Progress = silent) -> Array:
        """See `Constraint`."""
        tolerance = TORQUE_TOLERANCE * self.scale
        return proven_minimum(trajectory, self._bound, tolerance, progress, self.name)

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
        """Margins at the middles of stretches, and bounds all over them, of all cases."""
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


def torque_limit(
    cases: Mapping[str, ValuedModel], limits: ArrayLike | None = None, name: str = "torque"
) -> EffortLimit:
    """Joint efforts within limits.

    Args:
        cases: The same model with values, such as without and with a payload, by name.
        limits: Greatest efforts, shape `(n,)` [Nm; N], infinite for any; the robot's if `None`.
        name: For certificates and messages.

    Raises:
        ModelError: A term remembers the motion, a chain is closed, or no joint has a limit.
    """
    model = _one_model(cases, name)
    own = [joint.limits.effort for joint in model.robot.coordinates]
    given = own if limits is None else limits
    units = model.robot.effort_units
    titles = [
        f"{'torque' if u == 'Nm' else 'force'} of '{joint}'"
        for joint, u in zip(model.robot.joint_names, units, strict=True)
    ]
    return _limit(cases, given, titles, units, name, power=False)


def power_limit(
    cases: Mapping[str, ValuedModel],
    limits: ArrayLike | None = None,
    total: float = np.inf,
    name: str = "power",
) -> EffortLimit:
    """Mechanical powers within limits, whether joints drive or brake.

    Args:
        cases: See `torque_limit`, also for the errors.
        limits: Greatest powers, shape `(n,)` [W], infinite for any; `None` for any of all joints.
        total: Greatest power of all joints together [W].
        name: For certificates and messages.
    """
    model = _one_model(cases, name)
    own = np.full(model.robot.n, np.inf) if limits is None else frozen(limits, (None,))
    titles = [f"power of '{joint}'" for joint in model.robot.joint_names]
    titles.append("power of all joints")
    return _limit(cases, [*own, total], titles, ["W"] * len(titles), name, power=True)


def loaded(arm: ValuedModel, frame: str, payload: Inertia) -> ValuedModel:
    """A model with a payload, given in one of its frames, which must move."""
    robot = arm.model.robot
    place = frame_of(robot, frame)
    body = robot.bodies[place.body].name if place.body >= 0 else None
    if body is None or f"{INERTIAL_NAMES[0]}.{body}" not in arm.values:
        raise ModelError(
            f"frame '{frame}' is fixed to the base: a payload there loads no joint"
            if body is None
            else "a payload adds to the robot's bodies, but the model's terms have none",
            where=f"robot '{robot.name}'",
            fix=f"name a frame that moves, such as '{robot.bodies[-1].name}'"
            if body is None
            else 'list the term "rigid_body"',
        )
    values = np.array(arm.values.values)
    ten = [arm.values.names.index(f"{number}.{body}") for number in INERTIAL_NAMES]
    values[ten] += payload.moved(place.rotation, place.position).ten
    return ValuedModel(arm.model, Parameters(arm.values.names, arm.values.units, values))


def _limit(
    cases: Mapping[str, ValuedModel],
    limits: ArrayLike,
    titles: Sequence[str],
    units: Sequence[str],
    name: str,
    power: bool,
) -> EffortLimit:
    """A limit of positive values, at least one of them finite."""
    every, what = frozen(limits, (len(titles),)), "power" if power else "effort"
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
    model = next(iter(cases.values())).model
    values = tuple(case.values.values for case in cases.values())
    unit = " or ".join(dict.fromkeys(units[k] for k in which))
    return EffortLimit(name, tuple(labels), unit, model, power, which, frozen(chosen), values)


def _programs(model: Model, power: bool) -> EffortBounds:
    """Programs of a model's greatest and least efforts or powers."""
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


def _one_model(cases: Mapping[str, ValuedModel], name: str) -> Model:
    """The model of all cases; it is a tree of laws without memory."""
    models = [case.model for case in cases.values()]
    if not models or len({model.fingerprint for model in models}) > 1:
        raise ModelError(
            "the cases are of different models" if models else "there is no model with values",
            where=name,
            fix="give one model, with its values in every case",
        )
    model = models[0]
    if forgetless := [term.law for term in model.terms if isinstance(term, StatefulTerm)]:
        raise ModelError(
            f"the law '{forgetless[0]}' has internal states, so its effort cannot be bounded",
            where=f"robot '{model.robot.name}', list of terms",
            fix='limit efforts with a law without internal states, such as "coulomb"',
        )
    if model.robot.passive:
        raise ModelError(
            "the robot has closed chains, whose efforts are not bounded in this version",
            where=f"robot '{model.robot.name}'",
            fix=f"leave out the limit '{name}', or describe the robot as a tree",
        )
    return model
