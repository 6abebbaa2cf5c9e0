"""Evidence of a reading: the likelihood of a log with bodies and friction that can exist averaged.

Products of a motion's columns are made once; readings of one motion differ by them only. The mean
over several widths of bodies about the nominal ones is a sum: a nominal model that is accurate
decides finely, one that is not does not mislead. Joints count for a limited number of samples, as
errors of a model are not noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.check.cases_and_checks import remembered
from steelyard.check.hypotheses.laplace_over_bodies import LENGTHS, averaged, nominal_bodies
from steelyard.check.hypotheses.nuisance_fit_and_score import (
    LEAST_SAMPLE_COUNT,
    NUISANCES,
    OFFSET_COLUMN,
    WORST_MISFIT,
    LikelihoodScore,
)
from steelyard.check.hypotheses.position_and_effort_hypotheses import best_factors
from steelyard.check.hypotheses.readings_and_likelihood import Key, Likelihood, Reading
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import ten_map
from steelyard.estimate.information.base_parameters_and_regressor import (
    Regressor,
    base_parameters,
    chosen_regressor,
)
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.prior.body_priors import model_prior
from steelyard.model.compiled_quantity import check_angles
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot

WIDTHS = (0.05, 0.2, 0.8)  # relative widths of bodies about the nominal ones
EVIDENCE_SAMPLES = 300  # samples that products are made of
MOST_EVIDENCE_SAMPLES = 60.0  # most independent samples that a joint counts for
STEPS, SCREENING_STEPS = 14, 7  # Newton steps
SCREENED_WIDTHS = (0.8,)
CARRIED_WIDTH, CARRIED_MASS, CARRIED_SIZE = 1.4, 0.03, 0.1
"""Relative width about the likeliest payload, its mass over the arm's, and its size and distance
from the last link's frame [m]: masses of 0.05 to 0.4 of the arm's are expected."""
SCALE_WIDTH, SCALE_COST, LEAST_SCALE = 0.9, 4.0, 0.3
"""Standard deviation of the logarithm of a common factor on all bodies of a model file; what its
estimate costs; the logarithm from which on bodies of that size are a case of their own."""
BATCH = 96  # problems that are solved at once, if there is room for them
MOST_WORK, LEAST_SCREENED = 1e9, 40
"""Of readings that are screened at once: their number times the cube of that of the unknowns; so
many are in any case."""
ROOM = 2**28  # for products of motions that are kept, and for problems solved at once [bytes]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Of one reading."""

    log: float  # log-likelihood, averaged, over that of white noise of the effort's size
    misfits: Array  # root mean square of what is left over the effort's, of each joint, `(n,)`
    counts: Array  # samples that each joint counts for, shape `(n,)`
    width: float  # the most likely relative width of bodies about the nominal ones
    # entries of the most likely `X` of all bodies, then of a payload's if one is read, `(10 m,)`
    bodies: Array
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
    """Products of samples of one motion under one gravity, in the logged base unit.

    The last column is the nominal weight, or with a floating base what contacts take over.
    """

    yy: Array  # columns of bodies, a joint's own and that, `(n, K + 1, K + 1)`
    ye: Array  # of these with all effort columns, shape `(n, K + 1, n)`
    ee: Array  # squares of effort columns where the joint moves, shape `(n, n)`
    count: Array  # independent samples, shape `(n,)`
    carried: Array | float = 0.0  # mean squares of what single bodies do to a floating base, `(n,)`

    def logged(self, reading: Reading) -> tuple[Array, Array, Array]:
        """Products of columns with each joint's effort `(n, K)`, its squares, and those logged.

        With a floating base the last ones are of logged efforts and of contacts beside each other.
        """
        joints, effort, s = np.arange(len(self.ee)), list(reading.effort), reading.effort_scale
        ye, ee = self.ye[joints, :, effort] * s[:, None], self.ee[joints, effort] * s**2
        share = reading.held if reading.base is None else 1.0
        held = share * self.yy[:, -1]
        squares = ee + share * (2.0 * ye[:, -1] + held[:, -1])
        if reading.base is not None:
            ee = ee + held[:, -1] + self.carried
        return (ye + held)[:, :-1], squares, ee

    def nominal(self, reading: Reading) -> Array:
        """Root mean square effort of each joint by the nominal bodies, shape `(n,)`."""
        bodies = nominal_bodies(self.yy.shape[1] // 10)
        held = reading.held if reading.base is None else 0.0
        one = np.concatenate((bodies, np.zeros(NUISANCES), [-held]))
        return np.asarray(np.sqrt(np.maximum(self.yy @ one @ one, 0.0)))

    def with_columns(self, combined: Array) -> "_Products":
        """With combinations of the bodies' columns beside them, `(k, m)`."""
        (k, m), rest = combined.shape, NUISANCES + 1
        of = np.block([[np.eye(k), combined, np.zeros((k, rest))]])
        of = np.concatenate((of, np.eye(rest, k + m + rest, k + m)))
        return replace(self, yy=of.T @ self.yy @ of, ye=of.T @ self.ye)

    def problem(self, reading: Reading, scale: float, carrier: int = -1) -> "_Problem":
        """The reading in units of efforts, about nominal bodies of a scale."""
        n, k = self.yy.shape[0], self.yy.shape[1] - NUISANCES - 1
        ye, squares, ee = self.logged(reading)
        count = np.where(ee > 0.0, np.minimum(self.count, MOST_EVIDENCE_SAMPLES), 0.0)
        rms = np.sqrt(np.where(count > 0.0, ee, 1.0))
        own = np.sqrt(np.einsum("jkk->jk", self.yy[:, k:-1, k:-1]))
        sizes = np.where(own > 1e-12, 1.0 / np.maximum(own, 1e-12), 0.0)  # unit effort of columns
        # an offset may balance what bodies weigh, which the logged effort then lacks
        balanced = scale * self.nominal(reading) / rms
        sizes[:, OFFSET_COLUMN] *= np.maximum(balanced, 1.0)
        bodies = np.full((n, k), scale)
        factors = np.concatenate((bodies, sizes * rms[:, None]), axis=1) / rms[:, None]
        yy = self.yy[:, :-1, :-1] * factors[:, :, None] * factors[:, None, :]
        ee = np.where(ee > 0.0, squares / rms**2, 0.0)
        return _Problem(yy, ye * factors / rms[:, None], ee, count, scale, carrier)


class EvidenceOfLog:
    """Evidence of readings of one log; products of motions are made once."""

    def __init__(self, likelihood: Likelihood, unknown: NDArray[np.bool_]) -> None:
        """Of a log, some of whose gains are unknown, shape `(n,)`."""
        self._log, self._unknown = likelihood.thinned(EVIDENCE_SAMPLES), unknown
        self._whole = likelihood.excerpt
        robot = likelihood.knowledge.robot
        self._map, self._last = body_map(robot), carrier(robot).body
        part = slice(10 * self._last, 10 * self._last + 10)
        self._carried = np.zeros((len(self._map), 10))
        self._carried[part] = np.linalg.solve(self._map[part, part], payload_map(robot))
        count = len(self._map) + NUISANCES + 1
        self.most = max(LEAST_SCREENED, int(MOST_WORK / len(self._map) ** 3))
        if robot.floating:  # there are more readings, and the base's rows tell them apart
            self.most = LEAST_SCREENED
        self._room = max(1, ROOM // (8 * robot.n * count**2))
        self._products: dict[Key, _Products | None] = {}
        self._rough: dict[Key, Evidence | None] = {}
        self._columns: tuple[Key, tuple[Array, Array] | None] | None = None
        lower, upper = likelihood.bounds
        self._turned = np.where(upper <= 0.0, -1.0, 1.0) * np.where(lower == upper, 0.0, 1.0)
        self._positive = np.isfinite(lower) | np.isfinite(upper)

    def screened(self, readings: Sequence[Reading]) -> list[Evidence | None]:
        """Rough evidence: bodies of one width about nominal ones of the size that efforts have."""
        new = {key: r for r in readings if (key := r.key) not in self._rough}
        sizes = [None] * len(new)
        found = self._solved(list(new.values()), sizes, SCREENED_WIDTHS, SCREENING_STEPS)
        self._rough.update(zip(new, found, strict=True))
        return [self._rough[reading.key] for reading in readings]

    def of(self, readings: Sequence[Reading]) -> list[Evidence | None]:
        """That of each reading; `None` where states are impossible or nothing moves."""
        rough = self.screened(readings)
        both = []
        for sized in (False, True):
            tried = {
                k: x.scale if sized else 1.0
                for k, x in enumerate(rough)
                if x is not None and not (sized and abs(np.log(x.scale)) < LEAST_SCALE)
            }
            some = [readings[k] for k in tried]
            solved = self._solved(some, [*tried.values()], WIDTHS, STEPS)
            found = dict(zip(tried, solved, strict=True))
            both.append([found.get(k) for k in range(len(readings))])
        return [_mixed(*pair) for pair in zip(*both, strict=True)]

    def _solved(
        self,
        readings: Sequence[Reading],
        scales: Sequence[float | None],
        widths: Sequence[float],
        steps: int,
    ) -> list[Evidence | None]:
        """Evidence about nominal bodies of given scales; those that efforts have if `None`."""
        found: list[Evidence | None] = [None] * len(readings)
        size = max(1, min(BATCH // len(widths), self._room))
        waiting: dict[int, dict[int, _Problem]] = {}
        for number, (reading, scale) in enumerate(zip(readings, scales, strict=True)):
            if (problem := self._problem(reading, scale)) is not None:
                waiting.setdefault(problem.carrier, {})[number] = problem
            last = number + 1 == len(readings)
            for part in [one for one in waiting.values() if len(one) == size or (last and one)]:
                solved = _averaged(list(part.values()), self._positive, widths, steps)
                for k, one in zip(part, solved, strict=True):
                    found[k] = one if np.max(one.misfits) < WORST_MISFIT else None
                part.clear()
        return found

    def _problem(self, reading: Reading, scale: float | None) -> "_Problem | None":
        products = self._products_of(reading)
        if products is None:
            return None
        if scale is None:  # typical effort over that of the nominal bodies
            nominal, logged = products.nominal(reading), np.sqrt(products.logged(reading)[1])
            seen = (products.count > 0.0) & (nominal > 1e-6 * nominal.max(initial=0.0))
            seen &= logged > 0.0
            ratios = np.log(logged[seen] / nominal[seen])
            scale = float(np.exp(np.median(ratios))) if len(ratios) else 1.0
        if self._unknown.any():
            reading = self._with_gains(reading)
        last = -1 if reading.payload is None else self._last
        if last >= 0:
            products = products.with_columns(self._carried)
        return products.problem(reading, scale, last)

    def _with_gains(self, reading: Reading) -> Reading:
        """Unknown gains as nominal bodies of the size that the other efforts have them."""
        best = best_factors(reading.on(self._log).changed(payload=None))
        known = best[~self._unknown] if not self._unknown.all() else np.ones(1)
        common = float(np.exp(np.median(np.log(known))))
        return reading.with_factors(np.where(self._unknown, best / common, 1.0))

    def _products_of(self, reading: Reading) -> "_Products | None":
        motion = (*reading.of_motion, np.round(reading.gravity, 6).tobytes(), reading.held > 0.0)
        if reading.likelihood.signals.effort_map is not None:
            motion += (reading.ratios.tobytes(),)
        if reading.base is not None:
            motion += (reading.held,)
        key = (*motion, reading.delay)
        if key not in self._products:
            if self._columns is None or self._columns[0] != motion:
                self._columns = motion, self._columns_of(reading.on(self._log))
            columns = self._columns[1]
            self._products[key] = None if columns is None else self._made(*columns, reading.delay)
            if len(self._products) > self._room:
                self._products.pop(next(iter(self._products)))
        return self._products[key]

    def _columns_of(self, reading: Reading) -> tuple[Array, Array] | None:
        """Columns of products, `(n, K + 1, N)`, the last 0 if not asked; where joints move."""
        y, moving = reading.columns()
        weight = np.zeros_like(y[:, :1])
        if reading.base is not None:
            weight = (reading.pushed(*reading.motion()) * moving)[:, None]
        elif reading.held:
            pulls = reading.into_logged() @ reading.knowledge.pulls(reading.motion()[0])
            weight = np.tensordot(reading.gravity, pulls, 1)[:, None] * moving[:, None]
        bodies = _body_columns(reading) * moving[:, None]
        if not (np.isfinite(bodies).all() and moving.any()):
            return None
        own = y[:, :NUISANCES] * self._turned[..., None]
        return np.concatenate((self._map.T @ bodies, own, weight), axis=1), moving

    def _made(self, columns: Array, moving: Array, delay: float) -> "_Products":
        # shifted before they are thinned, as few samples do not show what is between them
        efforts = self._whole.later([delay])[0][:, :: self._whole.step(EVIDENCE_SAMPLES)]
        seen = np.maximum(moving.sum(axis=1), 1.0)[:, None, None]
        yy = columns @ columns.swapaxes(1, 2) / seen
        ye = columns @ efforts.T / seen
        ee = moving @ np.square(efforts).T / seen[..., 0]
        count = moving.sum(axis=1) * self._log.excerpt.worth
        count = np.where(count >= LEAST_SAMPLE_COUNT, count, 0.0)
        return _Products(yy, ye, ee, count, self._log.carried)


def _mixed(nominal: Evidence | None, sized: Evidence | None) -> Evidence | None:
    """Bodies about the nominal ones, and about nominal ones of the size that the log shows."""
    if sized is None:
        return nominal
    rarer = 0.5 * (np.log(sized.scale) / SCALE_WIDTH) ** 2 + SCALE_COST
    if nominal is None:
        return replace(sized, log=sized.log - rarer, sized=np.inf)
    better = sized if sized.log - rarer > nominal.log else nominal
    log = float(np.logaddexp(nominal.log, sized.log - rarer))
    return replace(better, log=log, sized=sized.log - rarer - nominal.log)


def body_map(robot: Robot) -> Array:
    """Ten numbers of all bodies per unknown: entries of `X` in an orthonormal basis."""
    found = np.zeros((10 * len(robot.bodies),) * 2)
    for body in range(len(robot.bodies)):
        part = slice(10 * body, 10 * body + 10)
        found[part, part] = ten_map(model_prior(robot, body).inertia) * LENGTHS
    return found


def payload_map(robot: Robot) -> Array:
    """Ten numbers of a payload per unknown, in the frame of the last link."""
    mass = CARRIED_MASS * sum(model_prior(robot, b).inertia.mass for b in range(len(robot.bodies)))
    typical = Inertia.from_pseudo(mass * np.diag([*[CARRIED_SIZE**2] * 3, 1.0]))
    return np.asarray(ten_map(typical) * LENGTHS)


@dataclass(frozen=True, eq=False)
class _Problem:
    """A reading, in units of the efforts' root mean squares."""

    yy: Array  # of bodies and a joint's own unknowns, shape `(n, k + 4, k + 4)`
    ye: Array  # shape `(n, k + 4)`
    ee: Array  # shape `(n,)`
    count: Array
    scale: float  # of the bodies that unknowns of 1 stand for, over the nominal ones
    carrier: int = -1  # the body that carries a payload, which is the last of them; -1 for none


def _averaged(
    problems: Sequence[_Problem], positive: NDArray[np.bool_], widths: Sequence[float], steps: int
) -> list[Evidence]:
    """Evidence of problems of one number of bodies, averaged over the widths."""
    h, k = len(problems), problems[0].ye.shape[1] - NUISANCES
    names = "yy", "ye", "ee", "count"
    yy, ye, ee, counts = (np.array([getattr(p, x) for p in problems]) for x in names)
    gamma = np.tile(np.array(widths)[:, None] ** -2.0, (h, 1, k // 10))
    arm = k - 10 * (problems[0].carrier >= 0)
    if problems[0].carrier >= 0:
        unknown = [problems[0].carrier, -1]  # the last link may weigh less, too
        gamma[..., unknown] = np.minimum(gamma[..., unknown], CARRIED_WIDTH**-2)
    fit = averaged(yy, ye, ee, counts, positive, gamma, steps)
    found = []
    for i, best in enumerate(np.argmax(fit.logs, axis=1)):
        log = float(np.logaddexp.reduce(fit.logs[i]) - np.log(len(widths)))
        u, seen, size = fit.bodies[i, best], counts[i] > 0.0, problems[i].scale
        misfits = np.where(seen, fit.misfits[i, best], 1.0)
        mine, nominal = (
            np.sqrt(np.maximum(np.einsum("a,jab,b->j", v, yy[i][:, :arm, :arm], v), 1e-300))
            for v in (u[:arm], nominal_bodies(arm // 10))
        )
        ratio = np.log(mine / nominal)[seen & (nominal > 1e-9 * nominal.max(initial=0.0))]
        scale = float(np.exp(np.median(ratio))) if len(ratio) else 1.0
        found.append(Evidence(log, misfits, counts[i], widths[best], size * u, size * scale, size))
    return found


def rows_of(reading: Reading) -> tuple[Array, Array, Array]:
    """Columns of bodies and nuisances `(n, N, k)`, efforts and where joints move `(n, N)`.

    Those of contacts are among the efforts. NaN where the states are impossible.
    """
    y, moving = reading.columns()
    joints, own = np.arange(len(moving)), np.zeros((*moving.shape, len(moving), NUISANCES))
    own[joints, :, joints] = y[:, :NUISANCES].swapaxes(1, 2)
    free = _body_columns(reading).swapaxes(1, 2) * moving[..., None]
    columns = np.concatenate((free, own.reshape(*moving.shape, -1)), axis=-1)
    efforts = reading.efforts() + reading.pushed(*reading.motion())
    return columns, efforts * moving, moving


def _body_columns(reading: Reading) -> Array:
    """Columns of the bodies in logged units, `(n, k, N)`; NaN where the states are impossible."""
    knowledge, motion = reading.knowledge, reading.motion()
    try:
        check_angles(motion[0])
        bodies = knowledge.under_any(reading.gravity, dense_regressor, *motion)
    except (DataError, ValueError):
        bodies = np.full((10 * len(knowledge.robot.bodies), *motion[0].shape), np.nan)
    return np.asarray(np.einsum("ij,kjb->ikb", reading.into_logged(), bodies))


def dense_regressor(valued: ValuedModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Columns of the bodies of one model, shape `(10 bodies, n, N)`."""
    return np.moveaxis(_regressor(valued.model).dense(q, dq, ddq), -1, 0).copy()


@remembered
def _regressor(model: Model) -> Regressor:
    return chosen_regressor(model, base_parameters(model), range(10 * len(model.robot.bodies)))
