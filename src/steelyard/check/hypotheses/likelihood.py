r"""How well an interpretation of a log agrees with the robot; hypotheses that it compares.

In the units in which efforts are logged, after the gears' map $A$, a joint's effort is

$$ s\,e = A^{-1} \tau(q, \dot q, \ddot q)
        + c \tanh(u / u_0) + v u + o + I_r \dot u $$

with friction $c$, $v$ and offset $o$ that differ from day to day within bounds, and rotor inertia
$I_r$ where the known model has none. What is left, relative to the effort, is the misfit of the
joint, $m_j$; with $N_j$ independent samples its likelihood is $-\frac{N_j}{2} \log(m_j^2 + m_0^2)$.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.case import Knowledge
from steelyard.check.hypotheses.excerpt import Excerpt, Interpretation, declared_reading
from steelyard.check.hypotheses.nuisance import (
    COORDINATE_SWEEPS,
    FRICTION_DRIFT,
    NUISANCES,
    REST_SPEED,
    fit_nuisances,
    unknown_friction,
)
from steelyard.robot.file.efforts import MOTOR_KINDS
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import Robot, Transmission

MISFIT_FLOOR = 0.03
"""Misfit that no model of a real robot is expected to stay below."""
MOST_SAMPLE_COUNT = 100.0
"""Most independent samples that a joint counts for: errors of a model are not noise."""
LEAST_SAMPLE_COUNT = 8.0
"""Least independent samples of a joint in motion for it to count."""
RESTING_SPEED_SHARE = 0.01
"""Speed up to which a joint rests, relative to the fastest joint."""
LEAST_SPAN = 0.02
"""Range of positions from which on a joint counts as moving [rad; m]."""
WORST_MISFIT = 1e3
"""Largest misfit that is distinguished from larger ones."""


@dataclass(frozen=True, eq=False)
class EffortProducts:
    """Products of samples of every joint in motion with every effort column; `h` interpretations.

    Attributes:
        yy: Of tanh, speed, one, acceleration and prediction, shape `(h, n, 5, 5)`.
        ye: Of these with the effort columns, shape `(h, n, 5, n)`.
        ee: Squares of the effort columns, shape `(h, n, n)`.
        count: Independent samples in motion, shape `(h, n)`.
    """

    yy: Array
    ye: Array
    ee: Array
    count: Array

    def of(self, which: Sequence[int]) -> "EffortProducts":
        """Those of some interpretations, by number; one may be there several times."""
        rows = list(which)
        return EffortProducts(self.yy[rows], self.ye[rows], self.ee[rows], self.count[rows])


@dataclass(frozen=True, eq=False)
class LikelihoodScore:
    """How well interpretations agree with what is known; `...` interpretations.

    Attributes:
        misfits: Of every joint, 1 for one that does not count, shape `(..., n)`.
        counts: Independent samples that every joint counts for, shape `(..., n)`.
        nuisances: Friction, offset and rotor inertia, shape `(..., n, 4)`.
    """

    misfits: Array
    counts: Array
    nuisances: Array

    @property
    def log_likelihood(self) -> Array:
        """Up to a constant of the log, shape `(...)`."""
        return self.log_likelihood_with(MISFIT_FLOOR, MOST_SAMPLE_COUNT)

    def log_likelihood_with(self, floor: float, most: float) -> Array:
        """With a given floor and most samples per joint, shape `(...)`."""
        logs = np.log(np.square(self.misfits) + floor**2)
        return np.asarray(-0.5 * np.sum(np.minimum(self.counts, most) * logs, axis=-1))

    @property
    def percent(self) -> Array:
        """Typical misfit [%], shape `(...)`."""
        counts = np.minimum(self.counts, MOST_SAMPLE_COUNT)
        shares = counts / np.maximum(counts.sum(axis=-1, keepdims=True), 1e-12)
        mean = np.sum(shares * np.log(np.maximum(self.misfits, 1e-6)), axis=-1)
        return np.asarray(100.0 * np.exp(mean))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of interpretations of one log.

    Attributes:
        excerpt: Its samples.
        signals: How the robot file reads it.
        knowledge: What is known of the robot.
        declared: The robot file's interpretation.
        gains: Joint effort per base unit of the declared efforts, shape `(n,)`.
        gears: Gears between motors and joints, as the robot file has them.
        bounds: Least and largest nuisance of every joint, each `(n, 4)`, in base units.
        size: Typical effort of every joint as it should be, in base units, shape `(n,)`.
        sweeps: How carefully friction is fitted.
        scales: Logged effort over what the gains say, as a reference found it of these sensors.
    """

    excerpt: Excerpt
    signals: Signals
    knowledge: Knowledge
    declared: Interpretation
    gains: Array
    gears: Transmission | None
    bounds: tuple[Array, Array]
    size: Array
    sweeps: int = COORDINATE_SWEEPS
    scales: Array | float = 1.0
    _scores: "WeakKeyDictionary[Interpretation, LikelihoodScore]" = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    def into_logged(self, interpretation: Interpretation) -> Array:
        """$A^{-1}$: joint efforts to logged base units, shape `(n, n)`."""
        if self.signals.effort_map is not None:
            gears = self.geared(interpretation)
            own = self.signals.effort_map
            if gears is not None and self.gears is not None:
                own = gears.T @ np.linalg.solve(self.gears.matrix.T, own)
            return np.asarray(np.linalg.inv(own))
        of_motors = self.declared.kind in MOTOR_KINDS
        return np.diag(self.scales / (self.gains * (interpretation.ratios if of_motors else 1.0)))

    def geared(self, interpretation: Interpretation) -> Array | None:
        """Motor positions per joint position; `None` where nothing is logged at motors."""
        if self.gears is None:
            return None
        return self.gears.matrix + np.diag(
            np.diag(self.gears.matrix) * (interpretation.ratios - 1.0)
        )

    def motion(self, interpretation: Interpretation) -> tuple[Array, Array, Array]:
        """Joint positions, velocities and accelerations, each `(n, B)`."""
        x, s = self.excerpt, self.signals
        order, scale = list(interpretation.position), interpretation.position_scale[:, None]
        q, dq, ddq = scale * x.z[order], scale * x.dz[order], scale * x.ddz[order]
        gears = self.geared(interpretation)
        if s.position_map is not None and gears is not None:
            q, dq, ddq = (np.asarray(np.linalg.solve(gears, y)) for y in (q, dq, ddq))
        if s.position_offset is not None:
            q = q + s.position_offset[:, None]
        if interpretation.zeros is not None:
            q = q + interpretation.zeros[:, None]
        return q, dq / interpretation.time, ddq / interpretation.time**2

    def driven(self, rates: Array) -> Array:
        """What friction turns with: motors where efforts are theirs behind coupled gears."""
        if self.signals.effort_map is None or self.gears is None:
            return rates
        return np.asarray(self.gears.matrix @ rates)

    def predicted(self, interpretation: Interpretation, q: Array, dq: Array, ddq: Array) -> Array:
        """What the efforts should be without friction, in base units, shape `(n, N)`."""
        torque = self.knowledge.torque(q, dq, ddq, interpretation.gravity)
        if interpretation.payload is not None:
            columns = self.knowledge.payload(q, dq, ddq, interpretation.gravity)
            torque = torque + np.einsum("k,knb->nb", interpretation.payload, columns)
        return np.asarray(self.into_logged(interpretation) @ torque)

    def sums(self, interpretations: Sequence[Interpretation]) -> EffortProducts:
        """Products for interpretations that differ in positions and time alone."""
        motions = [self.motion(r) for r in interpretations]
        q, dq, ddq = (np.concatenate(x, axis=1) for x in zip(*motions, strict=True))
        shape = len(dq), len(interpretations), -1
        predicted = self.predicted(interpretations[0], q, dq, ddq).reshape(shape)
        q, u, du = (x.reshape(shape) for x in (q, self.driven(dq), self.driven(ddq)))
        y, moving = regressors(q, u, du, predicted)
        return self.products(y, moving, self.excerpt.later([interpretations[0].delay]))

    def sums_later(self, interpretation: Interpretation, delays: Sequence[float]) -> EffortProducts:
        """Products of one interpretation with efforts at other delays than its own."""
        q, dq, ddq = self.motion(interpretation)
        predicted = self.predicted(interpretation, q, dq, ddq)
        arrays = (x[:, None] for x in (q, self.driven(dq), self.driven(ddq), predicted))
        y, moving = regressors(*arrays)
        return self.products(y, moving, self.excerpt.later(delays))

    def products(self, y: Array, moving: Array, e: Array) -> EffortProducts:
        """Products of columns `(n, h, 5, B)` with efforts `(h or 1, n, B)`."""
        y, moving = np.moveaxis(y, 0, 1), np.moveaxis(moving, 0, 1)
        yy, count = y @ y.swapaxes(-1, -2), moving.sum(axis=-1) * self.excerpt.worth
        ye = y @ e.swapaxes(-1, -2)[:, None]
        ee = moving @ np.square(e).swapaxes(-1, -2)
        h = len(ye)
        yy, count = (np.broadcast_to(x, (h, *x.shape[1:])) for x in (yy, count))
        return EffortProducts(yy, ye, ee, count)

    def scored(
        self, sums: EffortProducts, effort: NDArray[np.intp], scale: Array
    ) -> LikelihoodScore:
        """Scores of every interpretation of the sums.

        Args:
            sums: Products.
            effort: Column of each joint's effort, shape `(..., n)`.
            scale: What a logged unit is in the base unit, shape `(..., n)`.
        """
        h, j = np.ogrid[: len(sums.count), : self.signals.n]
        ye, ee = sums.ye[h, j, :, effort], sums.ee[h, j, effort]
        lower, upper = self.bounds
        squares, nuisances = fit_nuisances(sums.yy, ye, ee, scale, lower, upper, self.sweeps)
        return score_of(squares, scale**2 * ee, sums.count, nuisances)

    def score(self, interpretation: Interpretation) -> LikelihoodScore:
        """The score of one interpretation, which several checks ask for."""
        if interpretation not in self._scores:
            sums, effort = self.sums([interpretation]), np.array([interpretation.effort])
            self._scores[interpretation] = self.scored(sums, effort, interpretation.effort_scale)
        return self._scores[interpretation]

    def compared(self, interpretation: Interpretation, joint: int) -> tuple[Array, Array, Array]:
        """Time, measured effort and what it should be, friction included, each `(B,)`."""
        q, dq, ddq = self.motion(interpretation)
        predicted, u = self.predicted(interpretation, q, dq, ddq), self.driven(dq)
        y, _ = regressors(*(x[:, None] for x in (q, u, self.driven(ddq), predicted)))
        theta = self.score(interpretation).nuisances[0, joint]
        e = self.excerpt.later([interpretation.delay])[0, interpretation.effort[joint]]
        e = e * interpretation.effort_scale[joint]
        return self.excerpt.t, e, predicted[joint] + theta @ y[joint, 0, :NUISANCES]


def regressors(q: Array, u: Array, du: Array, predicted: Array) -> tuple[Array, Array]:
    """Columns `(n, h, 5, B)`, zero where a joint rests, and where it moves, `(n, h, B)`."""
    fastest = np.quantile(np.abs(u), 0.98, axis=-1)
    low, high = np.quantile(q, (0.02, 0.98), axis=-1)
    rest = np.maximum(REST_SPEED * fastest, RESTING_SPEED_SHARE * fastest.max(axis=0))
    rest = np.maximum(rest, 1e-12)[..., None]
    moving = (np.abs(u) > rest) & (high - low > LEAST_SPAN)[..., None] & np.isfinite(predicted)
    y = np.stack((np.tanh(u / rest), u, np.ones_like(u), du, np.nan_to_num(predicted)), axis=2)
    return y * moving[:, :, None], moving.astype(np.float64)


def score_of(squares: Array, whole: Array, counts: Array, nuisances: Array) -> LikelihoodScore:
    """Misfits from squares of what is left and of the whole."""
    seen = counts >= LEAST_SAMPLE_COUNT
    misfits = np.sqrt(squares / np.maximum(whole, 1e-30))
    misfits = np.where(seen, np.minimum(misfits, WORST_MISFIT), 1.0)
    return LikelihoodScore(misfits, np.where(seen, counts, 0.0), nuisances)


def _turned(bounds: tuple[Array, Array], gain: Array) -> tuple[Array, Array]:
    """Bounds of friction in logged units: where an effort counts the other way, so does it."""
    lower, upper = bounds
    turned = (gain < 0.0)[:, None]
    return np.where(turned, -upper, lower), np.where(turned, -lower, upper)


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
    knowledge: Knowledge,
    robot: Robot,
    gains: Array,
    scales: Array | float = 1.0,
) -> Likelihood:
    """A log to be tried, with what is known of its friction.

    Args:
        excerpt: Its samples.
        signals: How the robot file reads it.
        knowledge: What is known of the robot.
        robot: As the robot file has it.
        gains: Joint effort per base unit of the declared efforts, shape `(n,)`.
        scales: Logged effort over what the gains say, likewise.
    """
    declared, gears = declared_reading(signals, robot.gravity), robot.transmission
    ones = np.ones(signals.n)
    free = unknown_friction(signals.n, declared.kind)
    bare = Likelihood(
        excerpt, signals, knowledge, declared, gains, gears, free, ones, scales=scales
    )
    motion, into = bare.motion(declared), bare.into_logged(declared)
    torque = np.nan_to_num(knowledge.torque(*motion, knowledge.robot.gravity))
    friction = into @ np.nan_to_num(knowledge.friction(*motion))
    size = np.sqrt(np.mean(np.square(into @ torque + friction), axis=1))
    if not knowledge.identified:
        turned = free if signals.effort_map is not None else _turned(free, np.diag(into))
        return replace(bare, size=size, bounds=turned)
    return replace(bare, size=size, bounds=_around(friction, size, bare.driven(motion[1])))


def keeps_evidence(likelihood: Likelihood, interpretation: Interpretation) -> bool:
    """Whether efforts that belong to motion as declared do so under an interpretation too.

    An order that gives the effort of a joint in motion to a resting position is not to be
    compared with others: what contradicts it no longer counts.
    """
    return _in_motion(likelihood, likelihood.declared) <= _in_motion(likelihood, interpretation)


def _in_motion(likelihood: Likelihood, interpretation: Interpretation) -> set[int]:
    """Effort columns of the positions that move."""
    span = likelihood.excerpt.span.tolist()
    pairs = zip(
        interpretation.position,
        interpretation.effort,
        interpretation.position_scale.tolist(),
        strict=True,
    )
    return {e for p, e, scale in pairs if abs(scale) * span[p] > LEAST_SPAN}


FITTED_NUMBER_COST = 5.0
"""What a fitted number costs [natural units of likelihood]."""

AS_DECLARED = "as declared"


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One explanation.

    Attributes:
        cause: Name of the check that it belongs to.
        says: What it supposes, in a few words.
        interpretation: How it reads the log.
        cost: Log-likelihood that its choice among others of its kind, and its fitted numbers, take.
        joints: Indices of the joints concerned.
        score: How well it agrees.
        spread: Standard deviation of the number that was fitted, if one was.
        fixed: Whether the robot file may be changed to say so; not where its numbers are poorly
            identifiable.
        compared: What the misfits are of, and the misfit before [%]; the nominal model or the
            reference, and that of the explanation before, if `None`.
    """

    cause: str
    says: str
    interpretation: Interpretation
    cost: float
    joints: tuple[int, ...]
    score: LikelihoodScore
    spread: float = 0.0
    fixed: bool = True
    compared: tuple[str, float] | None = None

    @property
    def log_likelihood(self) -> float:
        """With what its freedom costs."""
        return float(self.score.log_likelihood) - self.cost

    @property
    def misfits(self) -> Array:
        """Of every joint, shape `(n,)`."""
        return self.score.misfits

    @property
    def percent(self) -> float:
        """Typical misfit [%]."""
        return float(self.score.percent)


def one_of(score: LikelihoodScore, index: int) -> LikelihoodScore:
    """One of several scores."""
    return LikelihoodScore(score.misfits[index], score.counts[index], score.nuisances[index])


def choice_cost(count: int) -> float:
    """What the choice among so many costs."""
    return float(np.log(max(count, 1)))
