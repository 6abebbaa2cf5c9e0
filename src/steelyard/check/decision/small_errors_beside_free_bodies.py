r"""Errors that are small beside the floor of the evidence, fitted beside free bodies.

The place $r$ of the sensor of a floating base moves the efforts by $\partial \tau / \partial r$,
which only turning of the base shows. A controller that removes a weight $w(q)$ from the efforts of
joints leaves it in the rows of the base. Both are columns beside those of free bodies and
friction; all are fitted by least squares with rows weighted by what they leave.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check, remembered
from steelyard.check.decision.verdict_of_log import SURE, judge_log
from steelyard.check.finding import Finding, Fix
from steelyard.check.hypotheses.evidence_with_unknown_bodies import rows_of
from steelyard.check.hypotheses.nuisance_fit_and_score import NUISANCES
from steelyard.check.hypotheses.readings_and_likelihood import Reading

SAMPLES = 600  # samples of a fit
PLACE_STEP = 0.01  # step of the derivative by the place [m]
RIDGE = 1e-9  # of the columns, relative to their lengths
FITS = 3  # least squares, each with the noise that the one before leaves
ROUNDS = 3  # fits of bodies and place, one after the other
LEAST_PLACE, LEAST_SHARE = 0.05, 0.4
"""Distance from the declared place, and share of the weight that is removed, that matter."""
SURE_STD = 6.0  # standard deviations from which on one is there


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
        for _ in range(FITS):
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

    def std(self, first: int) -> Array:
        """Standard deviations of the first values."""
        return np.asarray(np.sqrt(np.diag(self.covariance(first))))


def _inverse(squares: Array) -> Array:
    """The inverse of mean squares `(n,)`, zero of rows in which nothing is."""
    known = squares > 1e-12 * squares.max()
    return np.where(known, 1.0 / np.where(known, squares, 1.0), 0.0)


def _normal(products: Array, weights: Array) -> tuple[Array, Array]:
    """Normal matrix of columns of unit length, and their lengths."""
    gram = np.tensordot(weights, products[:, :-1, :-1], 1)
    sizes = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    sizes = np.where(sizes > 1e-9 * sizes.max(), sizes, np.inf)
    return gram / sizes[:, None] / sizes + RIDGE * np.eye(len(gram)), sizes


def explained(case: Case, log: CheckedLog) -> Reading | None:
    """The reading of a log that explains it best; `None` with a reference, or without any."""
    decision = judge_log(case, log)
    if decision is None or decision.search is None:
        return None
    return decision.search.best.reading


@dataclass(frozen=True, eq=False)
class FittedPlace:
    """Where the sensor of a base fits best."""

    place: Array  # shape `(3,)` [m]
    far: float  # from that of the reading [m]
    std: float  # its standard deviation [m]
    gain: float  # by how much the log-likelihood rises

    @property
    def least(self) -> float:
        """Distance from which on it is another place [m]."""
        return max(LEAST_PLACE, SURE_STD * self.std)

    @property
    def other(self) -> bool:
        """Whether it is clearly another place."""
        return self.far >= self.least and self.gain >= SURE


@remembered
def fitted_place(reading: Reading) -> FittedPlace | None:
    """The place of the sensor at which free bodies fit best; `None` if they cannot be fitted."""
    now = reading.on(reading.likelihood.thinned(SAMPLES))
    logs, std = list[float](), np.full(3, np.inf)
    own = len(now.position) * NUISANCES
    for number in range(ROUNDS):
        fit = FreeFit.of(now)
        if fit is None:
            return None
        logs.append(fit.log)
        bodies, columns = fit.values[:-own], rows_of(now)[0][..., :-own]
        slopes = [
            (rows_of(at_place(now, place_of(now) + PLACE_STEP * axis))[0][..., :-own] - columns)
            @ bodies
            for axis in np.eye(3)
        ]
        beside = FreeFit.of(now, np.stack(slopes, axis=-1) / PLACE_STEP)
        if beside is None:
            return None
        std = beside.std(3)
        if number + 1 < ROUNDS:
            now = at_place(now, place_of(now) + beside.values[:3])
    far = float(np.linalg.norm(place_of(now) - place_of(reading)))
    return FittedPlace(place_of(now), far, float(np.linalg.norm(std)), max(logs) - logs[0])


def place_of(reading: Reading) -> Array:
    """Place of the sensor on the base link, `(3,)` [m]."""
    assert reading.base is not None
    return reading.base.place


def at_place(reading: Reading, place: Array) -> Reading:
    """A reading with the sensor on another place."""
    assert reading.base is not None
    return reading.changed(base=reading.base.changed(place=place))


def placed(reading: Reading) -> Reading:
    """A reading with the place of the sensor that fits, where that is clearly another one."""
    found = fitted_place(reading)
    return at_place(reading, found.place) if found is not None and found.other else reading


@case_check("sensor place", "Is the sensor of the base where it is declared?")
def sensor_place_check(case: Case) -> Iterable[Finding]:
    """The place of the sensor of a floating base at which free bodies fit best."""
    for log in case.logs:
        reading = explained(case, log)
        if reading is not None and reading.base is not None:
            yield replace(_place_found(fitted_place(reading)), log=log.name)


def _place_found(found: FittedPlace | None) -> Finding:
    if found is None:
        return Finding.ok("undecided: free link inertias cannot be fitted", answered=False)
    figure = (
        f"{found.far:.3f} m from the declared place, standard deviation {found.std:.2g} m, "
        f"log-likelihood rises by {found.gain:.0f} (doubtful from {found.least:.2g} m and {SURE:g} "
        "on)"
    )
    if not found.other:
        says = f"the sensor of the base is within {found.least:.2g} m of the declared place"
        return Finding.ok(says, figure, answered=found.least < 1.0)
    listed = ", ".join(f"{x:.2f}" for x in found.place)
    return Finding.doubtful(
        f"the sensor of the base may be on another place: with free link inertias ({listed}) m on "
        f"the base link fits best, {found.far:.2f} m from the declared one",
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
    share, std = float(beside.values[0]), float(beside.std(1)[0])
    gain = beside.log - alone.log
    if share < max(LEAST_SHARE, SURE_STD * std) or gain < SURE:
        return None
    return Finding.doubtful(
        f"efforts seem to lack {100.0 * share:.0f} % of the gravity of the model file's masses: "
        "with free link inertias they fit better with it",
        f"share {share:.2f} ± {2.0 * std:.2g}, log-likelihood rises by {gain:.0f} (doubtful from "
        f"{LEAST_SHARE:g} and {SURE:g} on)",
        fix=Fix("log joint torques as they are measured, with what the controller compensates"),
    )
