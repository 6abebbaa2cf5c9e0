r"""Readings of a log, how well they agree with the robot, and hypotheses that are compared.

In the units in which efforts are logged, after the gears' map $A$, a joint's effort is

$$ s\,e = A^{-1} \tau(q, \dot q, \ddot q)
        + c \tanh(u / u_0) + v u + o + I_r \dot u $$

with friction $c$, $v$ and offset $o$ that differ from day to day within bounds, and rotor inertia
$I_r$ where the known model has none. What is left, relative to the effort, is the misfit of the
joint, $m_j$; with $N_j$ independent samples its likelihood is $-\frac{N_j}{2} \log(m_j^2 + m_0^2)$.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, Parameters
from steelyard.check.cases_and_checks import EffortPredictor
from steelyard.check.hypotheses.floating_base_readings import BaseReading, FloatingBase
from steelyard.check.hypotheses.log_excerpt import Excerpt
from steelyard.check.hypotheses.nuisance_fit_and_score import (
    FRICTION_DRIFT,
    LEAST_SPAN,
    NUISANCES,
    REST_SPEED,
    EffortProducts,
    LikelihoodScore,
    fit_nuisances,
    regressors,
    score_of,
)
from steelyard.robot.file.signals import MOTOR_KINDS, Signals
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.robot import Robot, Transmission

Key = tuple[object, ...]  # of a reading


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of readings of one log."""

    excerpt: Excerpt  # its samples
    signals: Signals  # how the robot file reads it
    knowledge: EffortPredictor  # what is known of the robot
    gravity: Array  # in the base frame as the robot file has it, shape `(3,)` [m/s²]
    gains: Array  # joint effort per base unit of the declared efforts, shape `(n,)`
    gears: Transmission | None  # gears between motors and joints, as the robot file has them
    bounds: tuple[Array, Array]  # least and largest nuisances, each `(n, 4)`, in base units
    size: Array  # typical effort of every joint as it should be, in base units, shape `(n,)`
    scales: Array | float = 1.0  # logged effort over what the gains say, by a reference
    base: FloatingBase | None = None  # of a robot whose base floats
    # mean squares of what single nominal bodies do to a floating base, whatever they add up to,
    # shape `(n,)`
    carried: Array | float = 0.0
    _motions_of_base: dict[Key, Array] = field(default_factory=dict)

    @cached_property
    def declared(self) -> "Reading":
        """The reading that the robot file declares."""
        signals, joints = self.signals, tuple(range(self.signals.n))
        return Reading(
            self,
            position=joints,
            position_scale=np.asarray(signals.position_scale),
            effort=joints,
            effort_scale=np.asarray(signals.effort_scale),
            gravity=np.asarray(self.gravity),
            delay=signals.effort_delay,
            kind=signals.effort_kind,
            ratios=np.ones(signals.n),
            base=None if self.base is None else self.base.declared,
        )

    @property
    def joints(self) -> range:
        """Numbers of the joints, behind the coordinates of a floating base."""
        return range(self.signals.n_base, self.signals.n)

    def among_joints(self, x: Array) -> Array:
        """The same per joint `(n, ...)`, one for the coordinates of a floating base."""
        found = np.ones_like(x)
        found[self.signals.n_base :] = x[self.signals.n_base :]
        return found

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.knowledge.robot.joint_names

    def thinned(self, samples: int) -> "Likelihood":
        """The same with fewer samples."""
        return replace(self, excerpt=self.excerpt.thinned(samples), _motions_of_base={})

    def driven(self, rates: Array) -> Array:
        """What friction turns with: motors where efforts are theirs behind coupled gears."""
        if self.signals.effort_map is None or self.gears is None:
            return rates
        return np.asarray(self.gears.matrix @ rates)

    def driven_only(self, x: Array) -> Array:
        """What is known per joint `(n, ...)`, zero of those whose effort is not measured.

        These have no motor, or a column that never changes.
        """
        free = {*self.signals.unactuated, *self.excerpt.dead}
        if self.signals.base is not None and self.signals.base.wrench_known:
            free -= set(range(self.signals.n_base))
        if not free:
            return x
        found = x.copy()
        found[list(free)] = 0.0
        return found

    def regressors(self, q: Array, u: Array, du: Array, predicted: Array) -> tuple[Array, Array]:
        """Columns `(n, h, 5, B)` and where joints move; a floating base counts at rest too."""
        y, moving = regressors(q, u, du, predicted)
        if first := self.signals.n_base:
            known = np.isfinite(predicted[:first])
            y[:first], moving[:first] = 0.0, known
            y[:first, :, 4] = np.where(known, predicted[:first], 0.0)
        return y, moving

    def sums(self, readings: Sequence["Reading"]) -> EffortProducts:
        """Products for readings that differ in positions, zeros, gears and time alone."""
        first, flat = readings[0].on(self), (self.signals.n, -1)
        q, dq, ddq = (np.moveaxis(x, 0, 1) for x in self.motions(readings))
        predicted = first.predicted(*(x.reshape(flat) for x in (q, dq, ddq)))
        u, du = (self.driven(x.reshape(flat)).reshape(x.shape) for x in (dq, ddq))
        predicted, pushed = predicted.reshape(q.shape), np.zeros((1, 1, 1))
        if self.base is not None:
            states = zip(readings, *(np.moveaxis(x, 1, 0) for x in (q, dq, ddq)), strict=True)
            pushed = np.stack([r.pushed(*state) for r, *state in states], axis=1)
        y, moving = self.regressors(q, u, du, predicted - pushed)
        found = self.products(y, moving, self.excerpt.later([first.delay]))
        count = self.driven_only(moving).sum(axis=-1)
        squares = self.driven_only(np.square(pushed) * moving).sum(axis=-1)
        return replace(found, pushed=(squares + count * np.reshape(self.carried, (-1, 1))).T)

    def motions(self, readings: Sequence["Reading"]) -> tuple[Array, Array, Array]:
        """Joint positions, velocities and accelerations by readings, each `(h, n, B)`."""
        x, s, position = self.excerpt, self.signals, np.array([r.position for r in readings])
        scale = np.array([r.position_scale for r in readings])[..., None]
        q, dq, ddq = scale * x.z[position], scale * x.dz[position], scale * x.ddz[position]
        gears = [one.geared() for one in readings] if s.position_map is not None else [None]
        if gears[0] is not None:
            q, dq, ddq = (np.linalg.solve(np.array(gears), y) for y in (q, dq, ddq))
        if s.position_offset is not None:
            q = q + s.position_offset[:, None]
        if any(one.zeros is not None for one in readings):
            none = np.zeros(s.n)
            q = q + np.array([none if r.zeros is None else r.zeros for r in readings])[..., None]
        time = np.array([one.time for one in readings])[:, None, None]
        dq, ddq = dq / time, ddq / time**2
        if self.base is not None:
            for number, reading in enumerate(readings):
                rows = self._motion_of_base(reading.base)
                first = slice(0, self.signals.n_base)
                q[number, first], dq[number, first], ddq[number, first] = rows
        return q, dq, ddq

    def _motion_of_base(self, reading: BaseReading | None) -> Array:
        """Rows of the base in `q`, `dq` and `ddq`, `(3, 6, B)`."""
        assert self.base is not None and reading is not None
        key = (*(x.tobytes() for x in (reading.turn, reading.place, reading.bias)), reading.delay)
        if key not in self._motions_of_base:
            channels = self.excerpt.of_base(self.signals.n_base, reading.delay)
            self._motions_of_base[key] = self.base.motion(reading, channels)
        return self._motions_of_base[key]

    def products(self, y: Array, moving: Array, e: Array) -> EffortProducts:
        """Products of columns `(n, h, 5, B)` with efforts `(h or 1, n, B)`."""
        y, moving = (np.moveaxis(self.driven_only(x), 0, 1) for x in (y, moving))
        yy, count = y @ y.swapaxes(-1, -2), moving.sum(axis=-1) * self.excerpt.worth
        ye = y @ e.swapaxes(-1, -2)[:, None]
        ee = moving @ np.square(e).swapaxes(-1, -2)
        h = len(ye)
        yy, count = (np.broadcast_to(x, (h, *x.shape[1:])) for x in (yy, count))
        return EffortProducts(yy, ye, ee, count, np.zeros_like(count))

    def scored(
        self, sums: EffortProducts, effort: NDArray[np.intp], scale: Array
    ) -> LikelihoodScore:
        """Scores of every reading of the sums.

        By columns of the joints' efforts, and logged units in the base unit, `(..., n)` each.
        """
        h, j = np.ogrid[: len(sums.count), : self.signals.n]
        ye, ee = sums.ye[h, j, :, effort], sums.ee[h, j, effort]
        lower, upper = self.bounds
        squares, nuisances = fit_nuisances(sums.yy, ye, ee, scale, lower, upper)
        return score_of(squares, scale**2 * ee + sums.pushed, sums.count, nuisances)


@dataclass(frozen=True, eq=False)
class Reading:
    r"""How columns of positions and efforts of one log become joint motion and effort.

    Joint j's position is `position_scale[j] * z[position[j]]`, its effort
    `effort_scale[j] * e[effort[j]]`, behind which maps, offsets and gains of the signals count.
    """

    likelihood: Likelihood  # the log
    position: tuple[int, ...]  # column of each joint's position among those declared
    position_scale: Array  # rad or m per logged unit, sign included, shape `(n,)`
    effort: tuple[int, ...]  # column of each joint's effort among those declared
    effort_scale: Array  # what a logged unit is in the declared base unit, shape `(n,)`
    gravity: Array  # in the base frame, shape `(3,)` [m/s²]; zero where efforts come without
    delay: float  # by how much efforts are logged late [s]
    kind: str  # of the efforts
    ratios: Array  # gear ratio of every motor to its own joint over the declared one, shape `(n,)`
    time: float = 1.0  # seconds per declared second
    payload: Array | None = None  # ten numbers of what the last body carries, in its frame
    zeros: Array | None = None  # added to joint positions beside declared offsets, `(n,)` [rad; m]
    held: float = 0.0  # share of the known bodies' weight that a controller removed from efforts
    base: BaseReading | None = None  # how the sensors of a floating base are read

    @property
    def knowledge(self) -> EffortPredictor:
        """What is known of the robot."""
        return self.likelihood.knowledge

    @property
    def of_motion(self) -> tuple[Any, ...]:
        """All that the joints' motion depends on."""
        arrays = (self.position_scale, self.ratios, self.zeros)
        found = (self.position, self.time, *(None if x is None else x.tobytes() for x in arrays))
        return found if self.base is None else (*found, self.base.key)

    @cached_property
    def key(self) -> Key:
        """What makes a reading another one."""
        arrays = (self.position_scale, self.effort_scale, self.gravity, self.ratios)
        return (
            self.position,
            self.effort,
            *(tuple(f"{value:.3g}" for value in array) for array in arrays),
            round(self.delay, 3),
            round(float(np.log(self.time)), 3),
            self.payload is None,
            self.held,
            None if self.zeros is None else tuple(np.round(self.zeros, 3)),
            None if self.base is None else self.base.key,
        )

    def changed(self, **fields: Any) -> "Reading":
        """The same with some of its attributes replaced."""
        return replace(self, **fields)

    def on(self, likelihood: Likelihood) -> "Reading":
        """The same with other samples or other knowledge of the log."""
        return self if likelihood is self.likelihood else replace(self, likelihood=likelihood)

    def with_factors(self, factors: Array) -> "Reading":
        """Efforts times a factor per joint."""
        return replace(self, effort_scale=self.effort_scale * factors)

    def with_zero(self, joint: int, offset: float) -> "Reading":
        """One joint's zero moved further."""
        zeros = np.zeros(len(self.position)) if self.zeros is None else self.zeros.copy()
        zeros[joint] += offset
        return replace(self, zeros=zeros)

    def into_logged(self) -> Array:
        """$A^{-1}$: joint efforts to logged base units, shape `(n, n)`."""
        log = self.likelihood
        if log.signals.effort_map is not None:
            gears, own = self.geared(), log.signals.effort_map
            if gears is not None and log.gears is not None:
                own = gears.T @ np.linalg.solve(log.gears.matrix.T, own)
            return np.asarray(np.linalg.inv(own))
        of_motors = log.signals.effort_kind in MOTOR_KINDS
        return np.diag(log.scales / (log.gains * (self.ratios if of_motors else 1.0)))

    def geared(self) -> Array | None:
        """Motor positions per joint position; `None` where nothing is logged at motors."""
        if self.likelihood.gears is None:
            return None
        matrix = self.likelihood.gears.matrix
        return matrix + np.diag(np.diag(matrix) * (self.ratios - 1.0))

    def motion(self) -> tuple[Array, Array, Array]:
        """Joint positions, velocities and accelerations, each `(n, B)`."""
        q, dq, ddq = self.likelihood.motions([self])
        return q[0], dq[0], ddq[0]

    def efforts(self) -> Array:
        """Efforts of the joints in base units, shape `(n, B)`."""
        e = self.likelihood.excerpt.later([self.delay])[0, list(self.effort)]
        return np.asarray(e * self.effort_scale[:, None])

    def predicted(self, q: Array, dq: Array, ddq: Array) -> Array:
        """What the efforts should be without friction, in base units, shape `(n, N)`."""
        share = 1.0 - self.held if self.base is None else 1.0
        torque = self.knowledge.torque(q, dq, ddq, share * self.gravity)
        if self.payload is not None:
            columns = self.knowledge.payload(q, dq, ddq, self.gravity)
            torque = torque + np.einsum("k,knb->nb", self.payload, columns)
        return np.asarray(self.into_logged() @ torque)

    def pushed(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Efforts `(n, B)` that contacts take over, as logged ones would be."""
        log = self.likelihood
        if log.base is None or self.base is None or log.excerpt.base is None:
            return np.zeros_like(q)
        found = log.base.pushed(self.base, q, log.excerpt.base)
        if self.held:
            first, still = log.signals.n_base, np.zeros_like(ddq)
            still[:3] = ddq[:3]
            weight = self.knowledge.torque(q, np.zeros_like(q), still, self.gravity)
            found[first:] += self.held * np.nan_to_num(weight[first:])
        return np.asarray(self.into_logged() @ found)

    def columns(self, predicted: Array | float = 0.0) -> tuple[Array, Array]:
        """Columns of the nuisances and a prediction `(n, 5, B)`, and where joints move `(n, B)`."""
        q, dq, ddq = self.motion()
        rates = (self.likelihood.driven(x) for x in (dq, ddq))
        states = (x[:, None] for x in (q, *rates, predicted + np.zeros_like(q)))
        y, moving = self.likelihood.regressors(*states)
        return self.likelihood.driven_only(y[:, 0]), self.likelihood.driven_only(moving[:, 0])

    @cached_property
    def sums(self) -> EffortProducts:
        """Products of this reading alone."""
        return self.likelihood.sums([self])

    def with_efforts(
        self, factors: Array, effort: NDArray[np.intp] | None = None
    ) -> LikelihoodScore:
        """Scores with factors on the efforts, or their columns in other orders, shapes `(h, n)`."""
        columns = np.tile(self.effort, (len(factors), 1)) if effort is None else effort
        sums = self.sums.of([0] * len(factors))
        return self.likelihood.scored(sums, columns, factors * self.effort_scale)

    def scored(self, columns: Array, moving: Array, delays: Sequence[float]) -> LikelihoodScore:
        """Scores of nuisances and a prediction `(n, 5, B)` with efforts at some delays."""
        log = self.likelihood
        sums = log.products(columns[:, None], moving[:, None], log.excerpt.later(delays))
        return log.scored(sums, np.tile(self.effort, (len(delays), 1)), self.effort_scale)

    @cached_property
    def score(self) -> LikelihoodScore:
        """How well it agrees."""
        efforts = np.array([self.effort])
        return self.likelihood.scored(self.sums, efforts, self.effort_scale).one(0)

    @property
    def friction_alone(self) -> LikelihoodScore:
        """How well friction, an offset and rotor inertia explain the efforts, without any body."""
        log = self.likelihood
        y, moving = self.columns(-self.pushed(*self.motion()))
        sums = log.products(y[:, None], moving[:, None], log.excerpt.later([self.delay]))
        sums = replace(sums, pushed=self.sums.pushed)
        return log.scored(sums, np.array([self.effort]), self.effort_scale).one(0)

    @property
    def log_likelihood(self) -> float:
        """Up to a constant of the log."""
        return float(self.score.log_likelihood)

    @property
    def percent(self) -> float:
        """Typical misfit [%]."""
        return float(self.score.percent)

    def compared(self, joint: int) -> tuple[Array, Array, Array]:
        """Time, measured effort and what it should be, friction included, each `(B,)`."""
        motion = self.motion()
        predicted = self.predicted(*motion) - self.pushed(*motion)
        y, _ = self.columns(predicted)
        friction = self.score.nuisances[joint] @ y[joint, :NUISANCES]
        return self.likelihood.excerpt.t, self.efforts()[joint], predicted[joint] + friction

    @property
    def keeps_evidence(self) -> bool:
        """Whether efforts that belong to motion as declared do so under this one too.

        An order that gives the effort of a joint in motion to a resting position is not to be
        compared with others: what contradicts it no longer counts. Nor is one that gives a joint an
        effort that never changes, which says nothing of either joint.
        """
        excerpt, span = self.likelihood.excerpt, self.likelihood.excerpt.span
        if any(self.effort[j] != j for j in excerpt.dead):
            return False
        if np.all(np.min(np.abs(self.position_scale)) * span > LEAST_SPAN):
            return True  # every column moves any joint

        def in_motion(of: "Reading") -> set[int]:
            moves = np.abs(of.position_scale) * span[list(of.position)] > LEAST_SPAN
            return {of.effort[j] for j in np.flatnonzero(moves)}

        return in_motion(self.likelihood.declared) <= in_motion(self)


def _around(friction: Array, size: Array, u: Array) -> tuple[Array, Array]:
    """Bounds around the reference's friction, from its efforts `(n, B)` at speeds `u`."""
    n = len(u)
    lower, upper = np.zeros((n, NUISANCES)), np.zeros((n, NUISANCES))
    fastest = np.maximum(np.quantile(np.abs(u), 0.98, axis=1), 1e-12)
    for j in range(n):
        x = np.stack((np.tanh(u[j] / (REST_SPEED * fastest[j])), u[j], np.ones_like(u[j])))
        found = np.linalg.lstsq(x.T, friction[j], rcond=None)[0]
        ends = np.multiply.outer(FRICTION_DRIFT, found)
        ends[:, 2] = found[2] + abs(found[2]) * np.array([-1.0, 1.0])
        slack = 0.03 * size[j] * np.array([1.0, 1.0 / fastest[j], 2.0])
        lower[j, :3], upper[j, :3] = ends.min(axis=0) - slack, ends.max(axis=0) + slack
    return lower, upper


def likelihood_of(
    excerpt: Excerpt,
    signals: Signals,
    knowledge: EffortPredictor,
    robot: Robot,
    gains: Array,
    scales: Array | float = 1.0,
) -> Likelihood:
    """A log to be tried, of a robot as the robot file has it, with what is known of its friction.

    Joint effort per base unit of the declared efforts, and logged effort over what these gains
    say, have shape `(n,)`.
    """
    # friction dissipates; rotors are felt unless sensors sit on the link side
    rotor = 0.0 if signals.effort_kind == "link_torque" else np.inf
    ends = [0.0, 0.0, -np.inf, 0.0], [np.inf, np.inf, np.inf, rotor]
    lower, upper = (np.tile(end, (signals.n, 1)) for end in ends)
    gears, ones, free = robot.transmission, np.ones(signals.n), (lower, upper)
    base = None if signals.base is None else FloatingBase(signals.base, robot)
    if first := signals.n_base:  # nothing rubs there
        lower[:first], upper[:first] = 0.0, 0.0
    bare = Likelihood(
        excerpt,
        signals,
        knowledge,
        robot.gravity,
        gains,
        gears,
        free,
        ones,
        scales=scales,
        base=base,
    )
    motion, into = bare.declared.motion(), bare.declared.into_logged()
    torque = np.nan_to_num(knowledge.torque(*motion, knowledge.robot.gravity))
    friction = into @ np.nan_to_num(knowledge.friction(*motion))
    size = np.sqrt(np.mean(np.square(into @ torque + friction), axis=1))
    if knowledge.identified:
        free = _around(friction, size, bare.driven(motion[1]))
    elif signals.effort_map is None:  # where an effort counts the other way, so does its friction
        turned = (np.diag(into) < 0.0)[:, None]
        free = np.where(turned, -upper, lower), np.where(turned, -lower, upper)
    carried = _carried(bare, motion) if base is not None else 0.0
    return replace(bare, size=size, bounds=free, carried=carried)


def _carried(likelihood: Likelihood, motion: tuple[Array, Array, Array]) -> Array:
    """Mean squares `(n,)` of what single bodies do to a floating base, whatever they add up to."""
    steady, found = likelihood.knowledge.steady, np.zeros(likelihood.signals.n)
    first = likelihood.signals.n_base
    for body in likelihood.knowledge.robot.bodies:
        known = steady.values.as_dict()
        names = [f"{name}.{body.name}" for name in INERTIAL_NAMES]
        units = [steady.model.units[steady.model.names.index(name)] for name in names]
        one = Parameters(names, units, [known.get(name, 0.0) for name in names])
        alone = replace(likelihood.knowledge, steady=steady.model.at(one), _turned={})
        torque = np.nan_to_num(alone.torque(*motion, likelihood.knowledge.robot.gravity))
        found[:first] += np.mean(np.square(torque[:first]), axis=1)
    return found
