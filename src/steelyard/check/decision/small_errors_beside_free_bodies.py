r"""Errors that are small beside the floor of the evidence, fitted beside free bodies.

The place $r$ of the sensor of a floating base moves the efforts by $\partial \tau / \partial r$,
which only turning of the base shows. A controller that removes a weight $w(q)$ from the efforts of
joints leaves it in the rows of the base. Both are columns beside those of free bodies and
friction; all are fitted by least squares with rows weighted by what they leave.
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.check.cases_and_checks import Case, CheckedLog, log_check, remembered
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import SURE_DEVIATIONS, Finding, Fix
from steelyard.check.hypotheses.evidence_with_unknown_bodies import rows_of
from steelyard.check.hypotheses.gravity_payload_and_delay import SAMPLES
from steelyard.check.hypotheses.hypotheses_and_their_scores import SURE
from steelyard.check.hypotheses.nuisance_fit_and_score import NUISANCES, REWEIGHTINGS, ROUNDING
from steelyard.check.hypotheses.readings_and_likelihood import Reading

VECTOR_STEP = 0.01  # step of derivatives by a place or a bias [m; m/s²]
LEAST_SHARE = 0.4  # share of the weight that is removed that matters


@dataclass(frozen=True, eq=False)
class FreeFit:
    """A fit of free bodies and friction by least squares, each row with its own noise."""

    products: Array  # of the columns and the effort of each row, shape `(n, k + 1, k + 1)`
    count: Array  # samples of each row, shape `(n,)`
    worth: float  # independent samples per sample
    weights: Array  # inverse mean squares of what each row leaves, `(n,)`
    values: Array  # bodies and friction, shape `(k,)`
    log: float  # log-likelihood of what is left

    @classmethod
    def of(cls, reading: Reading, more: Array | None = None) -> "FreeFit | None":
        """The fit to a reading, with more columns `(n, N, any)` before the others.

        `None` if there is none.
        """
        columns, efforts, moving = rows_of(reading)
        if more is not None:
            columns = np.concatenate((more * moving[..., None], columns), axis=-1)
        every = np.concatenate((columns, efforts[..., None]), axis=-1)
        if not np.isfinite(every).all():
            return None
        products = every.swapaxes(1, 2) @ every
        return cls.fitted(products, moving.sum(axis=1), reading.likelihood.excerpt.worth)

    @classmethod
    def fitted(cls, products: Array, count: Array, worth: float) -> "FreeFit":
        """The fit to products of rows that are so many samples, `(n,)`, each of that worth."""
        count, squares = np.maximum(count, 1.0), products[:, -1, -1]
        weights, values = np.zeros(len(products)), np.zeros(products.shape[-1] - 1)
        for _ in range(REWEIGHTINGS):
            weights = _inverse(squares / count)
            normal, sizes = _normal(products, weights)
            right = np.tensordot(weights, products[:, :-1, -1], 1) / sizes
            values = np.linalg.solve(normal, right) / sizes
            left = np.append(-values, 1.0)
            squares = np.maximum(products @ left @ left, 0.0)
        seen = squares > 0.0
        log = float(-0.5 * worth * np.sum(count[seen] * np.log(squares[seen] / count[seen])))
        return cls(products, count, worth, weights, values, log)

    def without(self, columns: slice) -> "FreeFit":
        """The fit without some columns."""
        kept = np.delete(np.arange(len(self.values) + 1), columns)
        return FreeFit.fitted(self.products[:, kept][:, :, kept], self.count, self.worth)

    def covariance(self, first: int) -> Array:
        """Covariance of the first values; infinite variance of one that nothing shows."""
        normal, sizes = _normal(self.products, self.weights)
        found = np.linalg.inv(normal)[:first, :first] / sizes[:first, None] / sizes[:first]
        found[range(first), range(first)] += np.where(np.isfinite(sizes[:first]), 0.0, np.inf)
        return np.asarray(found / self.worth)


def _inverse(squares: Array) -> Array:
    """The inverse of mean squares `(n,)`, zero of rows in which nothing is."""
    known = squares > 1e-12 * squares.max()
    return np.where(known, 1.0 / np.where(known, squares, 1.0), 0.0)


def _normal(products: Array, weights: Array) -> tuple[Array, Array]:
    """Normal matrix of columns of unit length, and their lengths."""
    gram = np.tensordot(weights, products[:, :-1, :-1], 1)
    sizes = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    sizes = np.where(sizes > 1e-9 * sizes.max(), sizes, np.inf)
    return gram / sizes[:, None] / sizes + ROUNDING * np.eye(len(gram)), sizes


def explained(case: Case, log: CheckedLog) -> Reading | None:
    """The reading of a log that explains it best; `None` with a reference, or without any."""
    decision = judge_log(case, log)
    if decision is None or decision.search is None:
        return None
    return decision.search.best.reading


@dataclass(frozen=True)
class Bounds:
    """When a vector is surely not zero, and when a direction is known."""

    least: float  # length that matters
    unknown: float  # what must be seen for it to be known
    sure: float = SURE_DEVIATIONS  # standard deviations from which on it is there


SENSOR_PLACE = Bounds(least=0.05, unknown=1.0)  # [m]


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
        known, there = bool(seen.all() and finite.all()), size >= max(bounds.least, own)
        return cls(axes @ along, covariance, least, known, there and gain >= SURE, gain)

    @property
    def size(self) -> float:
        """Its length."""
        return float(np.linalg.norm(self.value))

    @property
    def half_widths(self) -> Array:
        """Half of the 95 % intervals along the axes, shape `(3,)`."""
        return np.asarray(Z95 * np.sqrt(np.diag(self.covariance)))


def slopes_of(now: Reading, bodies: Array, name: str) -> Array:
    """Efforts of bodies `(n, N, 3)` per unit of a vector of the base's reading, along its axes."""
    base = now.base
    assert base is not None
    columns, found = rows_of(now)[0][..., : len(bodies)], list[Array]()
    for axis in np.eye(3):
        other = base.changed(**{name: getattr(base, name) + VECTOR_STEP * axis})
        moved = rows_of(now.changed(base=other))[0][..., : len(bodies)]
        found.append((moved - columns) @ bodies / VECTOR_STEP)
    return np.stack(found, axis=-1)


@remembered
def fitted_place(reading: Reading) -> FittedVector | None:
    """From the place of the sensor to that at which free bodies fit best [m]; `None` if none do."""
    now = reading.on(reading.likelihood.thinned(SAMPLES))
    first = fit = FreeFit.of(now)
    moved, own = np.zeros(3), len(now.position) * NUISANCES
    if first is None or fit is None or reading.base is None:
        return None
    for _ in range(REWEIGHTINGS):
        skipped = len(fit.values) - len(first.values)  # those of the place
        beside = FreeFit.of(now, slopes_of(now, fit.values[skipped:-own], "place"))
        if beside is None:
            return None
        fit, moved = beside, moved + beside.values[:3]
        now = now.changed(base=reading.base.changed(place=reading.base.place + moved))
    return FittedVector.of(moved, fit.covariance(3), fit.log - first.log, SENSOR_PLACE)


def placed(reading: Reading) -> Reading:
    """A reading with the place of the sensor that fits, where that is clearly another one."""
    found, base = fitted_place(reading), reading.base
    if found is None or base is None or not found.there:
        return reading
    return reading.changed(base=base.changed(place=base.place + found.value))


NOT_FITTED = Finding.ok("undecided: free link inertias cannot be fitted", answered=False)


@log_check("sensor place", "Is the sensor of the base where it is declared?")
def sensor_place_check(case: Case, log: CheckedLog) -> Finding | None:
    """The place of the sensor of a floating base at which free bodies fit best."""
    reading = explained(case, log)
    if reading is None or reading.base is None:
        return None
    found = fitted_place(reading)
    return NOT_FITTED if found is None else _place_found(found, reading.base.place)


def _place_found(found: FittedVector, declared: Array) -> Finding:
    std = float(np.sqrt(np.trace(found.covariance)))
    figure = (
        f"{found.size:.3f} m from the declared place, standard deviation {std:.2g} m, "
        f"log-likelihood rises by {found.gain:.0f} (doubtful from {found.least:.2g} m and {SURE:g} "
        "on)"
    )
    if not found.there:
        says = f"the sensor of the base is within {found.least:.2g} m of the declared place"
        return Finding.ok(says, figure, answered=found.known)
    listed = ", ".join(f"{x:.2f}" for x in declared + found.value)
    return Finding.doubtful(
        f"the sensor of the base may be on another place: with free link inertias ({listed}) m on "
        f"the base link fits best, {found.size:.2f} m from the declared one",
        figure,
        fix=Fix(
            "measure where the sensor is: position in mounting, under [signals.base]; a delay of "
            "it, or links that bend, have a similar effect"
        ),
    )


def removed_weight(case: Case, found: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Findings of the kind of efforts, with what a controller removed of a floating robot.

    Only where nothing else is found: the weight of light limbs is small beside contacts.
    """
    return tuple(
        replace(_weight_found(case, one) or one, log=one.log, hypotheses=one.hypotheses)
        for one in found
    )


def _weight_found(case: Case, finding: Finding) -> Finding | None:
    log = next((log for log in case.logs if log.name == finding.log), None)
    reading = None if log is None else explained(case, log)
    if finding.severity or reading is None or reading.base is None or reading.held:
        return None
    now = placed(reading)
    now = now.on(now.likelihood.thinned(SAMPLES))
    motion = now.motion()
    lacking = now.changed(held=1.0).pushed(*motion) - now.pushed(*motion)
    alone, beside = FreeFit.of(now), FreeFit.of(now, -lacking[..., None])
    if alone is None or beside is None:
        return None
    share, std = float(beside.values[0]), float(np.sqrt(beside.covariance(1)[0, 0]))
    gain = beside.log - alone.log
    if share < max(LEAST_SHARE, SURE_DEVIATIONS * std) or gain < SURE:
        return None
    return Finding.doubtful(
        f"efforts seem to lack {100.0 * share:.0f} % of the gravity of the model file's masses: "
        "with free link inertias they fit better with it",
        f"share {share:.2f} ± {2.0 * std:.2g}, log-likelihood rises by {gain:.0f} (doubtful from "
        f"{LEAST_SHARE:g} and {SURE:g} on)",
        fix=Fix("log joint torques as they are measured, with what the controller compensates"),
    )
