r"""Evidence of a reading: the likelihood of a log with bodies and friction that can exist averaged.

In units of each effort's root mean square, joint j's effort under a reading is

$$ \hat e_j = Z_j u + Y_j \theta_j + \varepsilon_j, \qquad \varepsilon_j \sim N(0, \sigma_j^2) $$

with bodies $u$, friction and rotor inertia $\theta_j \ge 0$ and an offset. A body's pseudo-inertia
relative to its nominal one, $X_i$, has the density $\propto |X_i|^\gamma e^{-\gamma
\operatorname{tr} X_i}$ of a Wishart distribution, which is largest at the nominal body, has the
relative width $w = \gamma^{-1/2}$ about it, and is zero where no body can exist; friction has the
same in one dimension. The integral is Laplace's, the mean over the widths a sum: a nominal model
that is accurate decides finely, one that is not does not mislead. Residuals are not expected below
a share of the effort, and joints count for a limited number of samples, as errors of a model are
not noise. What is returned is relative to efforts without any model, $\hat e_j \sim N(0, 1)$.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, multigammaln

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.check.hypotheses.consistent_bodies_of_log import dense_regressor
from steelyard.check.hypotheses.effort_hypotheses import best_factors
from steelyard.check.hypotheses.nuisance_fit_and_score import (
    LEAST_SAMPLE_COUNT,
    NUISANCES,
    LikelihoodScore,
)
from steelyard.check.hypotheses.readings_and_likelihood import Likelihood, Reading
from steelyard.estimate.consistent.unknowns_and_penalties import BASIS, ten_map
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.prior.body_priors import model_prior
from steelyard.model.compiled_evaluation import check_angles
from steelyard.robot.robot import Robot

WIDTHS = (0.05, 0.2, 0.8)  # relative widths of bodies about the nominal ones
FRICTION_WIDTH, TYPICAL_FRICTION = 2.0, 0.1
"""Relative width of friction, and its most likely size over the effort."""
OFFSET_WIDTH = 0.3  # standard deviation of an offset over the effort
EVIDENCE_SAMPLES = 300  # samples that products are made of
RESIDUAL_FLOOR = 0.03  # least residual over the effort that a model is expected to leave
MOST_EVIDENCE_SAMPLES = 60.0  # most independent samples that a joint counts for
STEPS, SCREENING_STEPS = 14, 7  # Newton steps
SCREENED_WIDTHS = (0.8,)
ABSURD = 1e3  # misfit from which on a reading is none
CARRIED = 3.0  # relative width of a body that carries something
SCALE_WIDTH, SCALE_COST, LEAST_SCALE = 0.9, 4.0, 0.3
"""Standard deviation of the logarithm of a common factor on all bodies of a model file; what its
estimate costs; the logarithm from which on bodies of that size are a case of their own."""
SMALLEST_BODY = 1e-9  # least eigenvalue of a body's `X` that is told from zero
RIDGE = 1e-9  # of the normalised Hessian
BATCH = 96  # problems that are solved at once


@dataclass(frozen=True, eq=False)
class Evidence:
    """Of one reading."""

    log: float  # log-likelihood, averaged, over that of white noise of the effort's size
    misfits: Array  # root mean square of what is left over the effort's, of each joint, `(n,)`
    counts: Array  # samples that each joint counts for, shape `(n,)`
    width: float  # the most likely relative width of bodies about the nominal ones
    bodies: Array  # entries of the most likely `X` of all bodies, shape `(10 n_bodies,)`
    scale: float  # typical effort of these bodies over that of the nominal ones
    size: float = 1.0  # of the nominal bodies that these are about, over those of the model file
    sized: float = 0.0  # log evidence of bodies of another size over that of the nominal ones

    @property
    def score(self) -> LikelihoodScore:
        """The misfits as a score."""
        return LikelihoodScore(self.misfits, self.counts, np.zeros((len(self.misfits), NUISANCES)))

    @property
    def percent(self) -> float:
        """Typical misfit [%]."""
        return float(self.score.percent)


@dataclass(frozen=True, eq=False)
class _Products:
    """Products of samples of one motion under one gravity, in the logged base unit."""

    yy: Array  # columns of bodies and of a joint's own with each other, shape `(n, K, K)`
    ye: Array  # of these with all effort columns, shape `(n, K, n)`
    ee: Array  # squares of effort columns where the joint moves, shape `(n, n)`
    count: Array  # independent samples, shape `(n,)`


class EvidenceOfLog:
    """Evidence of readings of one log; products of motions are made once."""

    def __init__(self, likelihood: Likelihood, unknown: NDArray[np.bool_]) -> None:
        """Of a log, some of whose gains are unknown, shape `(n,)`."""
        self._log, self._unknown = likelihood.thinned(EVIDENCE_SAMPLES), unknown
        self._map = body_map(likelihood.knowledge.robot)
        self._last = carrier(likelihood.knowledge.robot).body
        self._products: dict[tuple[object, ...], _Products | None] = {}
        self._columns: tuple[tuple[object, ...], tuple[Array, Array] | None] | None = None
        lower, upper = likelihood.bounds
        self._turned = np.where(upper <= 0.0, -1.0, 1.0) * np.where(lower == upper, 0.0, 1.0)
        self._positive = np.isfinite(lower) | np.isfinite(upper)

    def screened(self, readings: Sequence[Reading]) -> list[Evidence | None]:
        """Rough evidence: bodies of one width about nominal ones of the size that efforts have."""
        products = [self._products_of(reading) for reading in readings]
        problems = [
            None if x is None else self._problem(r, _nominal_scale(r, x))
            for r, x in zip(readings, products, strict=True)
        ]
        return self._solved(problems, SCREENED_WIDTHS, SCREENING_STEPS)

    def of(self, readings: Sequence[Reading]) -> list[Evidence | None]:
        """That of each reading; `None` where states are impossible or nothing moves."""
        rough = self.screened(readings)
        scales = [np.exp(0.0 if x is None else np.log(x.scale)) for x in rough]
        both = []
        for sized in (False, True):
            problems = [
                None
                if x is None or (sized and abs(np.log(c)) < LEAST_SCALE)
                else self._problem(r, c if sized else 1.0)
                for r, x, c in zip(readings, rough, scales, strict=True)
            ]
            both.append(self._solved(problems, WIDTHS, STEPS))
        return [_mixed(*pair) for pair in zip(*both, strict=True)]

    def _solved(
        self, problems: Sequence["_Problem | None"], widths: Sequence[float], steps: int
    ) -> list[Evidence | None]:
        found: list[Evidence | None] = [None] * len(problems)
        used = [k for k, one in enumerate(problems) if one is not None]
        size = max(1, BATCH // len(widths))
        for start in range(0, len(used), size):
            part = used[start : start + size]
            solved = _averaged([p for k in part if (p := problems[k])], widths, steps)
            for k, one in zip(part, solved, strict=True):
                found[k] = one if np.max(one.misfits) < ABSURD else None
        return found

    def _problem(self, reading: Reading, scale: float) -> "_Problem | None":
        products = self._products_of(reading)
        if products is None:
            return None
        if self._unknown.any():
            reading = self._with_gains(reading)
        problem = _normalised(reading, products, self._positive, scale)
        return problem if reading.payload is None else replace(problem, carrier=self._last)

    def _with_gains(self, reading: Reading) -> Reading:
        """Unknown gains as nominal bodies of the size that the other efforts have them."""
        best = best_factors(reading.on(self._log).changed(payload=None))
        known = best[~self._unknown] if not self._unknown.all() else np.ones(1)
        common = float(np.exp(np.median(np.log(known))))
        return reading.with_factors(np.where(self._unknown, best / common, 1.0))

    def _products_of(self, reading: Reading) -> "_Products | None":
        motion = (*reading.of_motion, np.round(reading.gravity, 6).tobytes())
        if reading.likelihood.signals.effort_map is not None:
            motion += (reading.ratios.tobytes(),)
        key = (*motion, reading.delay)
        if key not in self._products:
            if self._columns is None or self._columns[0] != motion:
                self._columns = motion, self._columns_of(reading.on(self._log))
            columns = self._columns[1]
            self._products[key] = None if columns is None else self._made(*columns, reading.delay)
        return self._products[key]

    def _columns_of(self, reading: Reading) -> tuple[Array, Array] | None:
        """Columns of bodies and of a joint's own `(n, K, N)`, and where joints move `(n, N)`."""
        knowledge, motion = reading.knowledge, reading.motion()
        y, moving = reading.columns()
        try:
            check_angles(motion[0])
            bodies = knowledge.under_any(reading.gravity, dense_regressor, *motion)
        except (DataError, ValueError):
            return None
        bodies = np.einsum("ij,kjb->ikb", reading.into_logged(), bodies) * moving[:, None]
        if not (np.isfinite(bodies).all() and moving.any()):
            return None
        own = y[:, :NUISANCES] * self._turned[..., None]
        return np.concatenate((self._map.T @ bodies, own), axis=1), moving

    def _made(self, columns: Array, moving: Array, delay: float) -> "_Products":
        efforts = self._log.excerpt.later([delay])[0]
        seen = np.maximum(moving.sum(axis=1), 1.0)[:, None, None]
        yy = columns @ columns.swapaxes(1, 2) / seen
        ye = columns @ efforts.T / seen
        ee = moving @ np.square(efforts).T / seen[..., 0]
        count = moving.sum(axis=1) * self._log.excerpt.worth
        return _Products(yy, ye, ee, np.where(count >= LEAST_SAMPLE_COUNT, count, 0.0))


def _nominal_scale(reading: Reading, products: "_Products") -> float:
    """Typical effort of a reading over that of the nominal bodies."""
    joints, k = np.arange(len(products.ee)), products.yy.shape[1] - NUISANCES
    one = np.tile(np.where(_DIAGONAL, 1.0, 0.0), k // 10)
    nominal = np.sqrt(np.maximum(products.yy[:, :k, :k] @ one @ one, 0.0))
    logged = np.sqrt(products.ee[joints, list(reading.effort)]) * np.abs(reading.effort_scale)
    seen = (products.count > 0.0) & (nominal > 1e-6 * nominal.max(initial=0.0)) & (logged > 0.0)
    return float(np.exp(np.median(np.log(logged[seen] / nominal[seen])))) if seen.any() else 1.0


def _mixed(nominal: Evidence | None, sized: Evidence | None) -> Evidence | None:
    """Bodies about the nominal ones, and about nominal ones of the size that the log shows."""
    if nominal is None or sized is None:
        return nominal
    rarer = 0.5 * (np.log(sized.scale) / SCALE_WIDTH) ** 2 + SCALE_COST
    better = sized if sized.log - rarer > nominal.log else nominal
    log = float(np.logaddexp(nominal.log, sized.log - rarer))
    return replace(better, log=log, sized=sized.log - rarer - nominal.log)


def body_map(robot: Robot) -> Array:
    """Ten numbers of all bodies per unknown: entries of `X` in an orthonormal basis."""
    found = np.zeros((10 * len(robot.bodies),) * 2)
    for body in range(len(robot.bodies)):
        part = slice(10 * body, 10 * body + 10)
        found[part, part] = ten_map(model_prior(robot, body).inertia) * _LENGTHS
    return found


_DIAGONAL = np.array([1, 0, 1, 0, 0, 1, 0, 0, 0, 1], dtype=np.bool_)
_LENGTHS = np.where(_DIAGONAL, 1.0, np.sqrt(0.5))
_ENTRIES = BASIS * _LENGTHS[:, None, None]  # of `X` per unknown, shape `(10, 4, 4)`


@dataclass(frozen=True, eq=False)
class _Problem:
    """A reading, in units of the efforts' root mean squares."""

    yy: Array  # of bodies and a joint's own unknowns, shape `(n, k + 4, k + 4)`
    ye: Array  # shape `(n, k + 4)`
    count: Array
    positive: NDArray[
        np.bool_
    ]  # which of the joints' own unknowns are not negative, shape `(n, 4)`
    scale: float  # of the bodies that unknowns of 1 stand for, over the nominal ones
    carrier: int = -1  # the body that carries something of any weight; -1 for none


def _normalised(
    reading: Reading, products: _Products, positive: NDArray[np.bool_], scale: float
) -> _Problem:
    n, k = products.yy.shape[0], products.yy.shape[1] - NUISANCES
    joints, effort = np.arange(n), np.array(reading.effort)
    ee = products.ee[joints, effort] * reading.effort_scale**2
    count = np.where(ee > 0.0, np.minimum(products.count, MOST_EVIDENCE_SAMPLES), 0.0)
    rms = np.sqrt(np.where(count > 0.0, ee, 1.0))
    own = np.sqrt(np.einsum("jkk->jk", products.yy[:, k:, k:]))
    sizes = np.where(own > 1e-12, 1.0 / np.maximum(own, 1e-12), 0.0)  # unit effort of each column
    factors = np.concatenate((np.full((n, k), scale), sizes * rms[:, None]), axis=1) / rms[:, None]
    yy = products.yy * factors[:, :, None] * factors[:, None, :]
    ye = products.ye[joints, :, effort] * factors * (reading.effort_scale / rms)[:, None]
    return _Problem(yy, ye, count, positive, scale)


def _averaged(problems: Sequence[_Problem], widths: Sequence[float], steps: int) -> list[Evidence]:
    """Evidence of problems of one size, averaged over the widths."""
    if not problems:
        return []
    h, k = len(problems), problems[0].ye.shape[1] - NUISANCES
    yy, ye, counts = (np.array([getattr(p, x) for p in problems]) for x in ("yy", "ye", "count"))
    positive = problems[0].positive.reshape(-1)
    gamma = np.tile(np.array(widths)[:, None] ** -2.0, (h, 1, k // 10))
    for i, problem in enumerate(problems):
        if problem.carrier >= 0:
            gamma[i, :, problem.carrier] = np.minimum(gamma[i, :, problem.carrier], CARRIED**-2)
    logs, x, left = _laplace(yy, ye, counts, positive, gamma, steps)
    best = np.argmax(logs, axis=1)
    found = []
    for i in range(h):
        top = logs[i, best[i]]
        log = float(top + np.log(np.mean(np.exp(logs[i] - top))))
        u = x[i, best[i]]
        seen = counts[i] > 0.0
        misfits = np.where(seen, left[i, best[i]], 1.0)
        one = np.tile(np.where(_DIAGONAL, 1.0, 0.0), k // 10)
        mine, nominal = (
            np.sqrt(np.maximum(np.einsum("a,jab,b->j", v, yy[i][:, :k, :k], v), 1e-300))
            for v in (u[:k], one)
        )
        ratio = np.log(mine / nominal)[seen & (nominal > 1e-9 * nominal.max(initial=0.0))]
        scale = float(np.exp(np.median(ratio))) if len(ratio) else 1.0
        size = problems[i].scale
        found.append(
            Evidence(log, misfits, counts[i], widths[best[i]], size * u[:k], size * scale, size)
        )
    return found


def _laplace(
    yy: Array, ye: Array, counts: Array, positive: NDArray[np.bool_], gamma: Array, steps: int
) -> tuple[Array, Array, Array]:
    """Log evidence `(h, w)`, unknowns there `(h, w, K)` and misfits `(h, w, n)`."""
    h, n, k = *ye.shape[:2], ye.shape[2] - NUISANCES
    whole = k + NUISANCES * n
    w = gamma.shape[1]
    bodies = k // 10
    x = np.zeros((h, w, whole))
    x[..., :k] = np.tile(np.where(_DIAGONAL, 1.0, 0.0), bodies)
    x[..., k:] = np.where(positive, TYPICAL_FRICTION, 0.0)
    variance = np.full((h, w, n), 0.1)
    g = FRICTION_WIDTH**-2
    rate = g / TYPICAL_FRICTION
    for step in range(steps):
        weight = counts[:, None] / variance  # (h, w, n)
        hessian, gradient = np.zeros((h, w, whole, whole)), np.zeros((h, w, whole))
        slopes = _products_with(yy, x, k) - ye[:, None]
        hessian[..., :k, :k] = (
            weight @ np.ascontiguousarray(yy[..., :k, :k]).reshape(h, n, -1)
        ).reshape(h, w, k, k)
        gradient[..., :k] = np.einsum("hwj,hwja->hwa", weight, slopes[..., :k])
        for j in range(n):
            at = slice(k + NUISANCES * j, k + NUISANCES * (j + 1))
            block = weight[:, :, j, None, None] * yy[:, None, j, k:, :]
            hessian[..., at, :k] = block[..., :k]
            hessian[..., :k, at] = block[..., :k].swapaxes(-1, -2)
            hessian[..., at, at] = block[..., k:]
            gradient[..., at] = weight[..., j, None] * slopes[..., j, k:]
        matrices = np.einsum("hwba,aij->hwbij", x[..., :k].reshape(h, w, bodies, 10), _ENTRIES)
        values, vectors = np.linalg.eigh(matrices)
        factor = vectors / np.sqrt(np.maximum(values, SMALLEST_BODY))[..., None, :]
        inverse = factor @ factor.swapaxes(-1, -2)
        turned = np.einsum("hwbij,ajk->hwbaik", inverse, _ENTRIES)
        slope = np.where(_DIAGONAL, 1.0, 0.0) - np.einsum("hwbaii->hwba", turned)
        bend = np.einsum("hwbaik,hwbcki->hwbac", turned, turned)
        gradient[..., :k] += (gamma[..., None] * slope).reshape(h, w, k)
        for b in range(bodies):
            part = slice(10 * b, 10 * b + 10)
            hessian[..., part, part] += gamma[..., b, None, None] * bend[..., b, :, :]
        theta = x[..., k:]
        safe = np.where(positive, theta, 1.0)
        gradient[..., k:] += np.where(positive, rate - g / safe, theta / OFFSET_WIDTH**2)
        curve = np.where(positive, g / safe**2, OFFSET_WIDTH**-2)
        hessian[..., np.arange(k, whole), np.arange(k, whole)] += curve
        sizes = np.sqrt(np.diagonal(hessian, axis1=-2, axis2=-1))
        scaled = hessian / sizes[..., :, None] / sizes[..., None, :] + RIDGE * np.eye(whole)
        move = -np.linalg.solve(scaled, (gradient / sizes)[..., None])[..., 0] / sizes
        # as far as bodies and friction can exist
        change = np.einsum("hwba,aij->hwbij", move[..., :k].reshape(h, w, bodies, 10), _ENTRIES)
        lowest = np.linalg.eigvalsh(factor.swapaxes(-1, -2) @ change @ factor)[..., 0].min(axis=-1)
        relative = np.where(positive, move[..., k:] / safe, 0.0).min(axis=-1)
        least = np.minimum(lowest, relative)
        length = np.minimum(1.0, 0.9 / np.maximum(-least, 1e-12))
        x = x + length[..., None] * move
        if step < steps - 1:
            # none is worse than no model, so that no joint is given up
            left = np.clip(_squares(yy, ye, x, k), 0.0, 1.0)
            variance = left + RESIDUAL_FLOOR**2
    weight = counts[:, None] / variance
    quadratic = _squares(yy, ye, x, k)
    data = -0.5 * np.sum(weight * quadratic + counts[:, None] * (np.log(variance) - 1.0), axis=-1)
    matrices = np.einsum("hwba,aij->hwbij", x[..., :k].reshape(h, w, bodies, 10), _ENTRIES)
    size = np.linalg.slogdet(matrices)[1] - np.trace(matrices, axis1=-2, axis2=-1)
    shape = gamma + 2.5
    norm = np.vectorize(multigammaln)(shape, 4) - 4.0 * shape * np.log(gamma) + 3.0 * np.log(2.0)
    prior = np.sum(gamma * size - norm, axis=-1)
    theta = x[..., k:]
    safe = np.where(positive, theta, 1.0)
    own_norm = gammaln(g + 1.0) - (g + 1.0) * np.log(rate)
    prior = prior + np.sum(
        np.where(
            positive,
            g * np.log(safe) - rate * theta - own_norm,
            -0.5 * (theta / OFFSET_WIDTH) ** 2 - 0.5 * np.log(2.0 * np.pi) - np.log(OFFSET_WIDTH),
        ),
        axis=-1,
    )
    volume = 0.5 * whole * np.log(2.0 * np.pi) - 0.5 * np.linalg.slogdet(hessian)[1]
    left = np.sqrt(np.maximum(quadratic, 0.0) + RESIDUAL_FLOOR**2)
    return data + prior + volume, x, left


def _compact(x: Array, n: int, k: int) -> Array:
    """The unknowns that each joint's effort depends on, `(h, w, n, k + 4)`."""
    bodies = np.broadcast_to(x[..., None, :k], (*x.shape[:2], n, k))
    return np.concatenate((bodies, x[..., k:].reshape(*x.shape[:2], n, NUISANCES)), axis=-1)


def _products_with(yy: Array, x: Array, k: int) -> Array:
    """Products of the columns with what the unknowns make of them, `(h, w, n, k + 4)`."""
    own = _compact(x, yy.shape[1], k).swapaxes(1, 2)  # (h, n, w, k + 4)
    return np.asarray((own @ yy).swapaxes(1, 2))


def _squares(yy: Array, ye: Array, x: Array, k: int) -> Array:
    """Mean squares that are left, `(h, w, n)`."""
    own = _compact(x, yy.shape[1], k)
    return np.asarray(1.0 + np.sum(own * (_products_with(yy, x, k) - 2.0 * ye[:, None]), axis=-1))
