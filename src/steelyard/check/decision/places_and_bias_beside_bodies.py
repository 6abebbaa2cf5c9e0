r"""Places of contacts and the bias of the accelerometer, fitted beside free bodies and friction.

A contact whose point is $\delta$ away from the declared one has the moment $\delta \times F$ about
it, of the measured force, or where only flags are logged of the one that fits best, behind the
projection that takes forces out. An accelerometer that shows $b$ too much changes the efforts by
$-\partial \tau / \partial a \, b$. Both are columns, along the axes of the contacts' frames and of
the sensor, and are fitted together.

Of a robot that stays about upright a bias along gravity acts like masses that are $b / g$ larger;
only accelerations, and turns, tell the two apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.check.cases_and_checks import Case, CheckedLog, log_check, remembered
from steelyard.check.decision.small_errors_beside_free_bodies import (
    NOT_FITTED,
    Bounds,
    FittedVector,
    FreeFit,
    placed,
    slopes_of,
)
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Finding, Fix
from steelyard.check.hypotheses.gravity_payload_and_delay import SAMPLES
from steelyard.check.hypotheses.hypotheses_and_their_scores import SURE
from steelyard.check.hypotheses.nuisance_fit_and_score import NUISANCES
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.filter_and_gram import Stretch
from steelyard.estimate.information.gather import start_pass
from steelyard.report.words import percent
from steelyard.robot.file.signals import BaseSignals, Contact, Touch
from steelyard.runs.run import Run

MOST_SAMPLES = 50_000  # samples of a run without measured forces that are fitted, about


@dataclass(frozen=True, eq=False)
class FittedBeside:
    """Columns of places, and of the bias, beside those of bodies."""

    contacts: tuple[int, ...]  # numbers of contacts that have places, measured or not
    fit: FreeFit  # three columns per contact, three of the bias, then bodies
    up: Array  # mean proper acceleration along the base link's axes, shape `(3,)` [m/s²]

    @property
    def places(self) -> list[FittedVector]:
        """From declared places to those that fit best, along the axes of frames [m]."""
        return self._vectors(0, len(self.contacts), PLACES)

    @property
    def bias(self) -> FittedVector:
        """Of the accelerometer, along the axes of the base link [m/s²]."""
        (found,) = self._vectors(len(self.contacts), 1, BIAS)
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
    q, _, ddq = now.motion()
    slopes = slopes_of(now, alone.values[: -len(q) * NUISANCES], "bias")
    levers = -np.einsum("ij,jbk->ibk", now.into_logged(), floating.levers(base, q, samples))
    fit = FreeFit.of(now, np.concatenate((levers, slopes), axis=-1))
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


FAR_OFF = 0.1  # distance of a contact from which on another error is as likely [m]
PLACES, BIAS = Bounds(least=0.005, unknown=0.01), Bounds(least=0.05, unknown=0.5, sure=10.0)
"""Of places of contacts [m], and of a bias [m/s²]: from half a percent of masses on; slow sways are
off by 8 deviations."""
_Place = tuple[Contact | Touch, FittedVector]  # a contact, and how far off it fits best


@log_check("contact places", "Do contacts touch where they are declared?")
def contact_places_check(case: Case, log: CheckedLog) -> Finding | None:
    """The points of contacts at which free bodies fit best, of measured forces or of flags."""
    base = log.recording.signals.base
    contacts = () if base is None else base.touches or base.contacts
    if all(isinstance(contact, Touch) and contact.sole for contact in contacts):
        return None
    found = beside_bodies(case, log)
    if found is None:
        return NOT_FITTED
    pairs = zip(found.contacts, found.places, strict=True)
    return _places_found([(contacts[k], off) for k, off in pairs])


def _places_found(found: Sequence[_Place]) -> Finding:
    gain = found[0][1].gain
    figure = (
        f"from the declared places, with 95 % intervals: {'; '.join(_words(*x) for x in found)}; "
        f"log-likelihood rises by {gain:.0f} (doubtful from {1e3 * PLACES.least:g} mm and {SURE:g} "
        "on)"
    )
    if others := [x for x in found if x[1].there]:
        return _other_places(others, figure)
    if open_ones := [f"'{contact.frame}'" for contact, off in found if not off.known]:
        says = (
            f"these data do not show where forces act at {', '.join(open_ones)} to "
            f"{1e3 * PLACES.unknown:g} mm: intervals assume that the declared point is right"
        )
        return Finding.ok(says, figure, answered=False, headline=True)
    least = max(off.least for _, off in found)
    return Finding.ok(f"contacts touch within {1e3 * least:.2g} mm of the declared places", figure)


def _words(contact: Contact | Touch, off: FittedVector) -> str:
    """Where a contact fits best, with its interval, in mm from the declared place."""
    each = (
        f"{name} {1e3 * x:+.1f} ± {1e3 * h:.1f}" if np.isfinite(h) else f"{name} unknown"
        for name, x, h in zip("xyz", off.value, off.half_widths, strict=True)
    )
    return f"'{contact.frame}' {', '.join(each)} mm"


def _other_places(others: Sequence[_Place], figure: str) -> Finding:
    each = ", ".join(f"{1e3 * off.size:.3g} mm away at '{x.frame}'" for x, off in others)
    says = f"contacts may touch at other points than declared: with free link inertias {each}"
    fits = [
        f"[{', '.join(f'{x:.4f}' for x in np.array(contact.place) + off.value)}] m at "
        f"'{contact.frame}'"
        for contact, off in others
        if isinstance(contact, Touch)
    ]
    advice = "measure where they touch: "
    advice += (
        f"position of the contact (fits best: {', '.join(fits)})"
        if fits
        else "the frame of the contact, in the model file"
    )
    if any(off.size >= FAR_OFF for _, off in others):
        advice += "; so far off, a sign, an order or a gain that is wrong is as likely"
    return Finding.doubtful(says, figure, fix=Fix(advice))


@log_check("accelerometer bias", "Is the accelerometer of the base without bias?")
def accelerometer_bias_check(case: Case, log: CheckedLog) -> Finding | None:
    """The bias with which free bodies fit best, and the masses that it could be."""
    base = log.recording.signals.base
    if base is None or base.tracked:
        return None
    found = beside_bodies(case, log)
    return NOT_FITTED if found is None else _bias_found(found, base)


def _bias_found(found: FittedBeside, base: BaseSignals) -> Finding:
    axes, bias = np.reshape(base.axes, (3, 3)), found.bias
    size = float(np.linalg.norm(found.up))
    if not np.isfinite(bias.covariance).all() or size == 0.0:
        says = "these data do not show a bias of the accelerometer"
        return Finding.ok(says, answered=False)
    turned = replace(bias, value=axes.T @ bias.value, covariance=axes.T @ bias.covariance @ axes)
    up = found.up / size
    each = ", ".join(
        f"{name} {x:+.3f} ± {h:.2g}"
        for name, x, h in zip("xyz", turned.value, turned.half_widths, strict=True)
    )
    figure = (
        f"{each} m/s² along the sensor's axes, with 95 % intervals; log-likelihood rises by "
        f"{bias.gain:.0f} (doubtful from {bias.least:.2g} m/s² and {SURE:g} on)"
    )
    if not bias.there:
        far = BIAS.sure * float(np.sqrt(up @ bias.covariance @ up))
        hidden = max(BIAS.least, far)
        says = (
            f"a bias of the accelerometer along gravity below {hidden:.2g} m/s² would not be seen, "
            f"and is not in the intervals: {percent(100.0 * hidden / size)} of all masses"
        )
        return Finding.ok(says, figure, answered=False, headline=True)
    whole = ", ".join(f"{x:.3f}" for x in np.array(base.bias) + turned.value)
    along = float(up @ bias.value)
    tilt = float(np.rad2deg(np.linalg.norm(bias.value - along * up) / size))
    return Finding.doubtful(
        f"the accelerometer may have a bias of {bias.size:.2g} m/s²: with free link inertias that "
        f"fits better, and without it {percent(100.0 * abs(along) / size)} of all masses would be "
        "wrong",
        figure,
        fix=Fix(
            "measure it, with the base at rest on all its sides, and state it in [signals.base]: "
            f"acceleration_bias = [{whole}] fits best; a mounting that is off by {tilt:.2g}° has a "
            "similar effect across gravity"
        ),
    )
