r"""What a log supports by itself: consistent bodies, fitted under one interpretation of it.

A nominal model is weak evidence: links may be several times heavier or lighter than it says. So a
interpretation is also compared with bodies of the log's own, which need only be possible, with
friction and rotor inertia that are not negative:

$$ \min \sum_j \frac{\|s_j e_j - (A^{-1} Y \phi)_j - Y_j \theta_j\|^2}{\|s_j e_j\|^2 (m_j^2 +
   m_0^2)} + \gamma \sum_i D(X_i) $$

with a prior so wide that a factor of three costs next to nothing. An interpretation that leaves a
large misfit even so contradicts the data; one that leaves a small one does not, whatever the
nominal model says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.knowledge import AXES, Knowledge
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import FLOOR, Likelihood, Score, regressors, score_of
from steelyard.diagnosis.likelihood.nuisance import NUISANCES
from steelyard.dynamics.compiled import check_angles
from steelyard.errors import DataError
from steelyard.estimation.consistent.conic import solved
from steelyard.estimation.consistent.consistency_penalties import Entropic
from steelyard.estimation.consistent.newton_refinement import polished
from steelyard.estimation.consistent.program import ConicConstraints, Program
from steelyard.estimation.consistent.unknowns import Unknowns, ten_map
from steelyard.estimation.payload.load_case import carrier
from steelyard.estimation.prior.prior import model_prior
from steelyard.model import Model
from steelyard.regression.base import base_parameters
from steelyard.regression.regressor import Regressor, chosen_regressor

SAMPLES = 600
"""Samples that bodies are fitted to."""
WEIGHT = 0.1
"""Weight of the prior: links are known to a factor of three or so."""
PASSES = 3
"""Times that joints weigh by what is left of their efforts."""
AIM, ENOUGH = 1e-7, 1e-2
"""Gap that is required of the solver, and that is enough to compare misfits."""
WIDEST = 100.0
"""Standard deviation of friction, in the whole effort."""


@dataclass(frozen=True, eq=False)
class Possible:
    """Bodies of a log's own under one interpretation.

    Attributes:
        score: How well they agree.
        scale: Typical effort of the bodies over that of the nominal ones.
    """

    score: Score
    scale: float

    @property
    def percent(self) -> float:
        """Typical misfit [%]."""
        return float(self.score.percent)


_KNOWN: "WeakKeyDictionary[Interpretation, Possible | None]" = WeakKeyDictionary()


def possible(likelihood: Likelihood, interpretation: Interpretation) -> Possible | None:
    """Physically consistent bodies that agree best; `None` where they cannot be found."""
    if interpretation not in _KNOWN:
        _KNOWN[interpretation] = _possible(likelihood, interpretation)
    return _KNOWN[interpretation]


def _possible(likelihood: Likelihood, interpretation: Interpretation) -> Possible | None:
    thin = replace(likelihood, excerpt=likelihood.excerpt.thinned(SAMPLES))
    bare = interpretation.changed(payload=None)
    columns, efforts, moving = rows_of(thin, bare)
    if not (np.isfinite(columns).all() and moving.any() and efforts.any()):
        return None
    bodies = range(len(thin.knowledge.robot.bodies))
    problem = _Problem(thin.knowledge, columns, likelihood.bounds, thin.excerpt.worth, bodies)
    counts = moving.sum(axis=1) * thin.excerpt.worth
    found = problem.agreeing(efforts, efforts, counts)
    return None if found is None else Possible(found[1], problem.typical(found[0]))


def other_link(likelihood: Likelihood, interpretation: Interpretation) -> Array | None:
    """Ten numbers by which the last link differs from the model file, all other links as there.

    The link that they make is physically consistent. `None` where none can be found.

    Args:
        likelihood: The log.
        interpretation: How it is read; what it says of a payload does not count.
    """
    thin = replace(likelihood, excerpt=likelihood.excerpt.thinned(SAMPLES))
    knowledge, bare = thin.knowledge, interpretation.changed(payload=None)
    columns, efforts, moving = rows_of(thin, bare)
    predicted = thin.predicted(bare, *thin.motion(bare))
    if not (np.isfinite(columns).all() and np.isfinite(predicted).all() and efforts.any()):
        return None
    last = carrier(knowledge.robot).body
    mine = slice(10 * last, 10 * last + 10)
    nominal = knowledge.steady.values.values[mine]
    nuisances = columns[..., 10 * len(knowledge.robot.bodies) :]
    columns = np.concatenate((columns[..., mine], nuisances), axis=-1)
    rest = efforts - predicted * moving + columns[..., :10] @ nominal
    problem = _Problem(knowledge, columns, likelihood.bounds, thin.excerpt.worth, (last,))
    found = problem.agreeing(rest, efforts, moving.sum(axis=1) * thin.excerpt.worth)
    return None if found is None else np.asarray((problem.scale @ found[0])[:10] - nominal)


def rows_of(likelihood: Likelihood, interpretation: Interpretation) -> tuple[Array, Array, Array]:
    """Columns of bodies and nuisances `(n, N, k)`, efforts and where joints move `(n, N)`."""
    q, dq, ddq = likelihood.motion(interpretation)
    bodies = columns_of(likelihood.knowledge, q, dq, ddq, interpretation.gravity)
    bodies = np.einsum("ij,kjb->kib", likelihood.into_logged(interpretation), bodies)
    u, du = likelihood.driven(dq), likelihood.driven(ddq)
    y, moving = regressors(q[:, None], u[:, None], du[:, None], np.zeros_like(q)[:, None])
    y, moving = y[:, 0, :NUISANCES], moving[:, 0]
    n, count = moving.shape
    columns = np.zeros((n, count, len(bodies) + NUISANCES * n))
    columns[..., : len(bodies)] = np.moveaxis(bodies, 0, -1) * moving[..., None]
    for j in range(n):
        start = len(bodies) + NUISANCES * j
        columns[j, :, start : start + NUISANCES] = y[j].T
    e = likelihood.excerpt.later([interpretation.delay])[0, list(interpretation.effort)]
    return columns, e * interpretation.effort_scale[:, None] * moving, moving


def columns_of(knowledge: Knowledge, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
    """Joint efforts per unit of every body's ten numbers, shape `(10 bodies, n, N)`.

    NaN where the states are impossible.
    """
    try:
        check_angles(q)
        return _columns_under(knowledge, q, dq, ddq, gravity)
    except (DataError, ValueError):
        return np.full((10 * len(knowledge.robot.bodies), *q.shape), np.nan)


def _columns_under(knowledge: Knowledge, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
    """Columns are linear in gravity: under another one they are put together from four models."""
    if np.allclose(gravity, knowledge.robot.gravity):
        return _dense(knowledge.steady.model, q, dq, ddq)
    still = np.zeros_like(q)
    free = knowledge.under(np.zeros(3)).model
    columns, rest = _dense(free, q, dq, ddq), _dense(free, q, still, still)
    for axis, part in zip(AXES, gravity, strict=True):
        if part != 0.0:
            columns += part * (_dense(knowledge.under(axis).model, q, still, still) - rest)
    return columns


def _dense(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Columns of the bodies of one model, shape `(10 bodies, n, N)`."""
    if model not in _REGRESSORS:
        count = 10 * len(model.robot.bodies)
        _REGRESSORS[model] = chosen_regressor(model, base_parameters(model), range(count))
    return np.moveaxis(_REGRESSORS[model].dense(q, dq, ddq), -1, 0).copy()


_REGRESSORS: "WeakKeyDictionary[Model, Regressor]" = WeakKeyDictionary()


class _Problem:
    """The convex program of one interpretation, for those bodies whose columns come first.

    Attributes:
        scale: Numbers of the bodies and nuisances per unknown, shape `(k, k)`.
    """

    def __init__(
        self,
        knowledge: Knowledge,
        columns: Array,
        bounds: tuple[Array, Array],
        worth: float,
        which: Sequence[int],
    ) -> None:
        bodies, n = len(which), len(columns)
        self._columns, self._worth, self._bodies = columns, worth, bodies
        k = columns.shape[-1]
        self.scale = np.zeros((k, k))
        for place, body in enumerate(which):
            part = slice(10 * place, 10 * place + 10)
            self.scale[part, part] = ten_map(model_prior(knowledge.robot, body).inertia)
        lower, upper = (side.reshape(-1) for side in bounds)
        self._lower, self._upper = lower, upper
        self._names = tuple(str(j) for j in range(k))
        self._places = 10 * bodies + np.arange(NUISANCES * n)

    def agreeing(
        self, efforts: Array, measured: Array, counts: Array
    ) -> tuple[Array, Score] | None:
        """The unknowns that agree best, and how well; joints weigh by what is left of them.

        Args:
            efforts: What these bodies and the nuisances make, shape `(n, N)`.
            measured: What the misfit is relative to, shape `(n, N)`.
            counts: Independent samples of every joint, shape `(n,)`.
        """
        whole = np.maximum(np.sum(np.square(measured), axis=1), 1e-30)
        misfits = np.full(len(efforts), 0.3)
        # squares of a joint's residual need the triangle of its rows alone
        rows = np.concatenate((self._columns, efforts[..., None]), axis=-1)
        rows = np.asarray(np.linalg.qr(rows, mode="r"))
        near: Array | None = None
        try:
            for _ in range(PASSES):
                weights = 1.0 / np.sqrt(whole / np.maximum(counts, 1.0) * (misfits**2 + FLOOR**2))
                u = self.solved(rows, weights, near)
                near = self.scale @ u
                left = rows[..., -1] - rows[..., :-1] @ near
                score = score_of(np.sum(np.square(left), axis=1), whole, counts, np.zeros((0,)))
                misfits = score.misfits
        except DataError:
            return None
        return u, score

    def solved(self, rows: Array, weights: Array, near: Array | None) -> Array:
        """The unknowns, rows of joint j times `weights[j]`.

        Args:
            rows: Columns of bodies and nuisances, and the efforts last, shape `(n, N, k + 1)`.
            weights: Shape `(n,)`.
            near: Numbers of bodies and nuisances with other weights, if there are any.
        """
        scaled = weights * np.sqrt(self._worth)
        rows = (rows * scaled[:, None, None]).reshape(-1, rows.shape[-1])
        rows, right = rows[:, :-1], rows[:, -1]
        size = np.linalg.norm(right)
        strength = np.linalg.norm(rows[:, self._places], axis=0)
        sizes = size / np.where(strength > 1e-9 * size, strength, size)
        self.scale[self._places, self._places] = sizes
        matrix = rows @ self.scale
        triangle = np.asarray(np.linalg.qr(np.column_stack((matrix, right)), mode="r"))
        k = matrix.shape[1]
        bodies = self._bodies
        weak = np.where(np.arange(k) < 10 * bodies, 0.0, WIDEST**-2)
        unknowns = Unknowns(
            self._names,
            (True,) * bodies,
            tuple(int(p) for p in self._places),
            self.scale,
            weak,
            triangle[:, :k],
            triangle[:, k],
        )
        eye = np.eye(k)[self._places]
        constraints = ConicConstraints((), eye, self._lower / sizes, self._upper / sizes)
        program = Program(unknowns, constraints, Entropic())
        if near is not None:
            end = polished(program, unknowns.of_standard(near), WEIGHT)
            if end is not None:
                return end
        return solved(program.conic(WEIGHT), "bodies of the log's own", aim=AIM, enough=ENOUGH)[:k]

    def typical(self, u: Array) -> float:
        """Geometric mean over joints of the bodies' effort over that of the prior."""
        k = 10 * self._bodies
        prior = np.zeros(len(u))
        prior[:k] = np.tile([1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], self._bodies)
        mine, nominal = (
            np.linalg.norm(self._columns[..., :k] @ (self.scale[:k, :k] @ x[:k]), axis=1)
            for x in (u, prior)
        )
        seen = nominal > 1e-9 * nominal.max(initial=1e-300)
        logs = np.log(np.maximum(mine[seen], 1e-300) / nominal[seen])
        return float(np.exp(np.median(logs))) if seen.any() else 1.0
