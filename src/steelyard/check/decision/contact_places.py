r"""Do contacts of a floating base touch where they are declared?

A contact whose point is $\delta$ away from the declared one has the moment $\delta \times F$ about
it. These are columns beside those of free bodies and friction, along the axes of its frame: of the
measured force, or of the one that fits best where only flags are logged, behind the projection that
takes forces out. What nothing shows has no interval, and is said.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import LogError
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check
from steelyard.check.decision.small_errors_beside_free_bodies import (
    SAMPLES,
    SURE_STD,
    FreeFit,
    explained,
    placed,
)
from steelyard.check.decision.verdict_of_log import SURE
from steelyard.check.finding import Finding, Fix
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.gather import start_pass
from steelyard.robot.file.signals import BaseSignals
from steelyard.runs.run import Run

LEAST_OFF = 0.005  # distance from the declared point that matters [m]
UNKNOWN_OFF = 0.01  # distance that an offset must be seen from on to be known [m]
MOST_SAMPLES = 50_000  # samples of a run without measured forces that are fitted, about
FAR_OFF = 0.1  # distance from which on another error is as likely [m]


@dataclass(frozen=True, eq=False)
class FittedPlace:
    """Where a contact fits best."""

    frame: str
    declared: Array  # in the link's frame, shape `(3,)` [m]
    offset: Array  # from there, in the directions that are known, shape `(3,)` [m]
    half: Array  # half of the 95 % interval along the frame's axes, shape `(3,)` [m]
    least: float  # distance from which on it is another place [m]
    known: bool  # whether an offset of `UNKNOWN_OFF` would show in all directions

    @classmethod
    def of(cls, frame: str, declared: Array, offset: Array, covariance: Array) -> "FittedPlace":
        """From an estimate; an offset counts along directions that are known to be one."""
        finite = np.isfinite(np.diag(covariance))
        variances, axes = np.linalg.eigh(np.where(np.outer(finite, finite), covariance, 0.0))
        seen = SURE_STD * np.sqrt(np.maximum(variances, 0.0)) <= UNKNOWN_OFF
        along = np.where(seen, axes.T @ np.where(finite, offset, 0.0), 0.0)
        worst = float(np.sqrt(variances[seen].max(initial=0.0)))
        half = Z95 * np.sqrt(np.diag(covariance))
        least = max(LEAST_OFF, SURE_STD * worst)
        return cls(frame, declared, axes @ along, half, least, bool(seen.all() and finite.all()))

    @property
    def far(self) -> float:
        """Distance from the declared place [m]."""
        return float(np.linalg.norm(self.offset))

    @property
    def other(self) -> bool:
        """Whether it is clearly another place."""
        return self.far >= self.least

    @property
    def words(self) -> str:
        """Where it fits best, with its interval, in mm from the declared place."""
        each = (
            f"{name} {1e3 * x:+.1f} ± {1e3 * h:.1f}" if np.isfinite(h) else f"{name} unknown"
            for name, x, h in zip("xyz", self.offset, self.half, strict=True)
        )
        return f"'{self.frame}' {', '.join(each)} mm"


@dataclass(frozen=True, eq=False)
class FittedPlaces:
    """Of all contacts of a log."""

    each: tuple[FittedPlace, ...]
    gain: float  # by how much the log-likelihood rises


@case_check("contact places", "Do contacts touch where they are declared?")
def contact_places_check(case: Case) -> Iterable[Finding]:
    """The points of contacts at which free bodies fit best, of measured forces or of flags."""
    for log in case.logs:
        base = log.recording.signals.base
        if base is None or not (_points(base) if base.touches else base.contacts):
            continue
        found = _of_flags(case, log, base) if base.touches else _of_forces(case, log, base)
        yield replace(_finding(found, bool(base.touches)), log=log.name)


def _points(base: BaseSignals) -> list[int]:
    """Numbers of contacts of unknown force that have a point; a sole takes any moment."""
    return [k for k, touch in enumerate(base.touches) if not touch.sole]


def _of_forces(case: Case, log: CheckedLog, base: BaseSignals) -> FittedPlaces | None:
    """By the excerpt of a log whose contact forces are measured."""
    reading = explained(case, log)
    if reading is None:
        return None
    now = placed(reading)
    now = now.on(now.likelihood.thinned(SAMPLES))
    samples, floating = now.likelihood.excerpt.base, now.likelihood.base
    if samples is None or floating is None or now.base is None:
        return None
    levers = floating.levers(now.base, now.motion()[0], samples)
    levers = np.einsum("ij,jbk->ibk", now.into_logged(), levers)
    names = [contact.frame for contact in base.contacts]
    fits = FreeFit.of(now), FreeFit.of(now, -levers)
    return _places(names, np.zeros((len(names), 3)), *fits)


def _places(
    frames: Sequence[str], declared: Array, alone: FreeFit | None, beside: FreeFit | None
) -> FittedPlaces | None:
    """Places by fits without and with their columns."""
    if alone is None or beside is None:
        return None
    covariance = beside.covariance(3 * len(frames))
    each = tuple(
        FittedPlace.of(name, place, beside.values[part], covariance[part, part])
        for name, place, part in zip(
            frames, declared, (slice(3 * k, 3 * k + 3) for k in range(len(frames))), strict=True
        )
    )
    return FittedPlaces(each, beside.log - alone.log)


def _of_flags(case: Case, log: CheckedLog, base: BaseSignals) -> FittedPlaces | None:
    """By the run of a log whose contact forces are unknown."""
    run = log.run
    if not isinstance(run, Run):
        return None
    try:
        alone = _fit(case.regressor, run, replace(base, spread=()))
        spread = np.where(alone.weights > 0.0, alone.weights, alone.weights.max()) ** -0.5
        base = replace(base, spread=tuple(spread.tolist()))
        alone = _fit(case.regressor, run, base)
        beside = _fit(case.regressor, run, base, alone.values)
    except LogError:
        return None
    touches = [base.touches[k] for k in _points(base)]
    places = np.array([touch.place for touch in touches])
    return _places([touch.frame for touch in touches], places, alone, beside)


def _fit(regressor: Regressor, run: Run, base: BaseSignals, values: Array | None = None) -> FreeFit:
    """Of a run without contact forces, taken out by the spread of the base's signals.

    With values of the parameters, columns of the places of all points are before the others.
    """
    accumulator, pieces, _ = start_pass(regressor, run, rests=False)
    n, gains = len(regressor.layout.rows), run.recording.signals.gains
    step = max(1, ceil(run.n_samples / MOST_SAMPLES))
    points = [3 * k + x for k in _points(base) for x in range(3)]
    size = len(regressor.layout.columns) + 1 + len(points) * (values is not None)
    products, count = np.zeros((n, size, size)), np.zeros(n)
    for number, (_, stretch) in enumerate(pieces):
        outputs = accumulator.outputs(stretch.q.shape[1])
        if number % step or stretch.touching is None or not outputs:
            continue
        touching = replace(stretch.touching, base=base)
        rows, worth = accumulator.rows(replace(stretch, touching=touching))
        own = rows.reshape(n, -1, outputs) * np.sqrt(worth)[:, None]
        own[:, -1] *= gains[:, None]
        if values is not None:
            motion = stretch.q, stretch.dq, stretch.ddq
            efforts = regressor.dense(*motion) @ values - gains[:, None] * stretch.effort
            counted = None if stretch.weights is None else stretch.weights > 0.0
            levers = touching.levers(stretch.q, efforts, counted)[..., points].swapaxes(1, 2)
            smooth = [accumulator.over_taps(x, accumulator.matched.taps) for x in levers]
            own = np.concatenate((-np.array(smooth) * (worth > 0.0)[:, None], own), axis=1)
        products += own @ own.swapaxes(1, 2)
        count += worth.sum(axis=1)
    return FreeFit.fitted(products, count, 1.0 / accumulator.matched.inflation)


def _finding(found: FittedPlaces | None, flags: bool) -> Finding:
    if found is None:
        return Finding.ok("undecided: free link inertias cannot be fitted", answered=False)
    figure = (
        f"from the declared places, with 95 % intervals: {'; '.join(x.words for x in found.each)}; "
        f"log-likelihood rises by {found.gain:.0f} (doubtful from {1e3 * LEAST_OFF:g} mm and "
        f"{SURE:g} on)"
    )
    others = [x for x in found.each if x.other] if found.gain >= SURE else []
    if others:
        return _other_places(others, figure, flags)
    open_ones = [f"'{x.frame}'" for x in found.each if not x.known]
    if open_ones:
        says = (
            f"these data do not show where forces act at {', '.join(open_ones)} to "
            f"{1e3 * UNKNOWN_OFF:g} mm: intervals assume that the declared point is right"
        )
        return Finding.ok(says, figure, answered=False, headline=True)
    least = max(x.least for x in found.each)
    says = f"contacts touch within {1e3 * least:.2g} mm of the declared places"
    return Finding.ok(says, figure)


def _other_places(others: Sequence[FittedPlace], figure: str, flags: bool) -> Finding:
    each = ", ".join(f"{1e3 * x.far:.3g} mm away at '{x.frame}'" for x in others)
    says = f"contacts may touch at other points than declared: with free link inertias {each}"
    key = "position of the contact" if flags else "the frame of the contact, in the model file"
    advice = f"measure where they touch: {key}"
    if flags:
        fits = (
            f"[{', '.join(f'{x:.4f}' for x in one.declared + one.offset)}] m at '{one.frame}'"
            for one in others
        )
        advice += f" (fits best: {', '.join(fits)})"
    if any(x.far >= FAR_OFF for x in others):
        advice += "; so far off, a sign, an order or a gain that is wrong is as likely"
    return Finding.doubtful(says, figure, fix=Fix(advice))
