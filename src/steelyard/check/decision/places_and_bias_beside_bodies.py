r"""Places of contacts and the bias of the accelerometer, fitted beside free bodies and friction.

A contact whose point is $\delta$ away from the declared one has the moment $\delta \times F$ about
it, of the measured force, or where only flags are logged of the one that fits best, behind the
projection that takes forces out. An accelerometer that shows $b$ too much changes the efforts by
$-\partial \tau / \partial a \, b$. Both are columns, along the axes of the contacts' frames and of
the sensor, and are fitted together.
"""

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.check.cases_and_checks import Case, CheckedLog, remembered
from steelyard.check.decision.small_errors_beside_free_bodies import (
    SAMPLES,
    SURE_STD,
    FreeFit,
    placed,
)
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.hypotheses.evidence_with_unknown_bodies import rows_of
from steelyard.check.hypotheses.nuisance_fit_and_score import NUISANCES
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.filter_and_gram import Stretch
from steelyard.estimate.information.gather import start_pass
from steelyard.robot.file.signals import BaseSignals
from steelyard.runs.run import Run

MOST_SAMPLES = 50_000  # samples of a run without measured forces that are fitted, about


@dataclass(frozen=True)
class Bounds:
    """When a vector is surely not zero, and when a direction is known."""

    least: float  # length that matters
    unknown: float  # what must be seen for it to be known
    sure: float = SURE_STD  # standard deviations from which on it is there


@dataclass(frozen=True, eq=False)
class FittedVector:
    """A vector of a fit, of which only directions that are known count."""

    value: Array  # in directions that are known, shape `(3,)`
    covariance: Array  # of all directions, shape `(3, 3)`
    least: float  # length from which on it is surely not zero, whatever its direction
    known: bool  # whether all directions are
    there: bool  # whether it is surely not zero
    gain: float  # by how much the log-likelihood rises with it and all of its kind

    @classmethod
    def of(cls, value: Array, covariance: Array, gain: float, bounds: Bounds) -> "FittedVector":
        """Of an estimate."""
        finite = np.isfinite(np.diag(covariance))
        variances, axes = np.linalg.eigh(np.where(np.outer(finite, finite), covariance, 0.0))
        far = bounds.sure * np.sqrt(np.maximum(variances, 0.0))
        seen = far <= bounds.unknown
        along = np.where(seen, axes.T @ np.where(finite, value, 0.0), 0.0)
        size = float(np.linalg.norm(along))
        own = float(np.linalg.norm(far * along)) / max(size, 1e-300)
        least = max(bounds.least, float(far[seen].max(initial=0.0)))
        known = bool(seen.all() and finite.all())
        return cls(axes @ along, covariance, least, known, size >= max(bounds.least, own), gain)

    @property
    def size(self) -> float:
        """Its length."""
        return float(np.linalg.norm(self.value))


@dataclass(frozen=True, eq=False)
class FittedBeside:
    """Columns of places, and of the bias, beside those of bodies."""

    contacts: tuple[int, ...]  # numbers of contacts that have places, measured or not
    fit: FreeFit  # three columns per contact, three of the bias, then bodies
    up: Array  # mean proper acceleration along the base link's axes, shape `(3,)` [m/s²]

    def places(self, bounds: Bounds) -> list[FittedVector]:
        """From declared places to those that fit best, along the axes of frames [m]."""
        return self._vectors(0, len(self.contacts), bounds)

    def bias(self, bounds: Bounds) -> FittedVector:
        """Of the accelerometer, along the axes of the base link [m/s²]."""
        (found,) = self._vectors(len(self.contacts), 1, bounds)
        return found

    def _vectors(self, first: int, count: int, bounds: Bounds) -> list[FittedVector]:
        covariance = self.fit.covariance(3 * len(self.contacts) + 3)
        gain = self.fit.log - self.fit.without(slice(3 * first, 3 * (first + count))).log
        parts = (slice(3 * k, 3 * k + 3) for k in range(first, first + count))
        return [FittedVector.of(self.fit.values[x], covariance[x, x], gain, bounds) for x in parts]


@remembered
def beside_bodies(case: Case, log: CheckedLog) -> FittedBeside | None:
    """Of a log of a floating base; `None` if free bodies cannot be fitted."""
    base = log.recording.signals.base
    assert base is not None
    return _of_run(case, log, base) if base.touches else _of_reading(case, log)


def _of_reading(case: Case, log: CheckedLog) -> FittedBeside | None:
    """By the excerpt of a log whose contact forces are measured."""
    decision = judge_log(case, log)
    if decision is None or decision.search is None:
        return None
    # readings that nothing names differ in what may be a place or a bias: a tilt of the sensor
    now = placed((decision.search.best if decision.winners else decision.declared).reading)
    now = now.on(now.likelihood.thinned(SAMPLES))
    samples, floating, base = now.likelihood.excerpt.base, now.likelihood.base, now.base
    alone = FreeFit.of(now)
    if samples is None or floating is None or base is None or alone is None:
        return None
    own = len(now.position) * NUISANCES
    bodies, columns = alone.values[:-own], rows_of(now)[0][..., :-own]
    q, _, ddq = now.motion()
    slopes = [
        (rows_of(now.changed(base=base.changed(bias=axis)))[0][..., :-own] - columns) @ bodies
        for axis in np.eye(3)
    ]
    levers = -np.einsum("ij,jbk->ibk", now.into_logged(), floating.levers(base, q, samples))
    fit = FreeFit.of(now, np.concatenate((levers, np.stack(slopes, axis=-1)), axis=-1))
    if fit is None:
        return None
    return FittedBeside(tuple(range(levers.shape[-1] // 3)), fit, ddq[:3].mean(axis=1))


def _of_run(case: Case, log: CheckedLog, base: BaseSignals) -> FittedBeside | None:
    """By the run of a log whose contact forces are unknown."""
    run = log.run
    if not isinstance(run, Run):
        return None
    # a sole takes any moment
    points = tuple(k for k, touch in enumerate(base.touches) if not touch.sole)
    try:
        alone, _ = _fit(case.regressor, run, replace(base, spread=()))
        spread = np.where(alone.weights > 0.0, alone.weights, alone.weights.max()) ** -0.5
        base = replace(base, spread=tuple(spread.tolist()))
        alone, _ = _fit(case.regressor, run, base)
        fit, up = _fit(case.regressor, run, base, points, alone.values)
    except LogError:
        return None
    return FittedBeside(points, fit, up)


def _fit(
    regressor: Regressor,
    run: Run,
    base: BaseSignals,
    points: tuple[int, ...] = (),
    values: Array | None = None,
) -> tuple[FreeFit, Array]:
    """Of a run without contact forces, taken out by the spread of the base's signals.

    With values of the parameters, columns of places and bias are before the others. Beside it the
    mean proper acceleration along the base link's axes, `(3,)` [m/s²].
    """
    accumulator, pieces, _ = start_pass(regressor, run, rests=False)
    n, gains = len(regressor.layout.rows), run.recording.signals.gains
    step = max(1, ceil(run.n_samples / MOST_SAMPLES))
    moved = [3 * k + x for k in points for x in range(3)]
    size = len(regressor.layout.columns) + 1 + (len(moved) + 3) * (values is not None)
    products, count, up = np.zeros((n, size, size)), np.zeros(n), list[Array]()
    for number, (_, stretch) in enumerate(pieces):
        outputs = accumulator.outputs(stretch.q.shape[1])
        if number % step or stretch.touching is None or not outputs:
            continue
        stretch = replace(stretch, touching=replace(stretch.touching, base=base))
        rows, worth = accumulator.rows(stretch)
        own = rows.reshape(n, -1, outputs) * np.sqrt(worth)[:, None]
        own[:, -1] *= gains[:, None]
        if values is not None:
            more = _columns(regressor, stretch, gains, values, moved)
            smooth = [accumulator.over_taps(x.T, accumulator.matched.taps) for x in more]
            own = np.concatenate((np.array(smooth) * (worth > 0.0)[:, None], own), axis=1)
        products += own @ own.swapaxes(1, 2)
        count += worth.sum(axis=1)
        up.append(stretch.ddq[:3].mean(axis=1))
    mean = np.mean(up, axis=0) if up else np.zeros(3)
    return FreeFit.fitted(products, count, 1.0 / accumulator.matched.inflation), mean


def _columns(
    regressor: Regressor, stretch: Stretch, gains: Array, values: Array, moved: list[int]
) -> Array:
    """Columns of places and bias at all samples, behind the projection, `(n, N, k)`."""
    assert stretch.touching is not None
    q, dq, ddq = stretch.q, stretch.dq, stretch.ddq
    efforts = regressor.dense(q, dq, ddq) @ values
    slopes = np.zeros((*q.shape, 3))
    for k in range(3):
        other = ddq.copy()
        other[k] -= 1.0
        slopes[..., k] = regressor.dense(q, dq, other) @ values - efforts
    counted = None if stretch.weights is None else stretch.weights > 0.0
    lacking = efforts - gains[:, None] * stretch.effort
    levers = stretch.touching.levers(q, lacking, counted)[..., moved]
    mixed = np.einsum("bij,jbk->ibk", stretch.touching.projection(q, counted), slopes)
    return np.concatenate((-levers, mixed), axis=-1)
