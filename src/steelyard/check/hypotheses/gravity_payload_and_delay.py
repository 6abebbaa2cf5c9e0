r"""Hypotheses about what is around the arm: direction of gravity, a payload, delayed efforts.

Efforts are linear in bodies and in gravity, $e = (Y_0 + \sum_a g_a Y_a) \phi$. With the bodies
eliminated by least squares (variable projection), what is left depends on the direction of $g$
alone, and is minimised from every axis.
"""

from collections.abc import Iterator
from copy import copy

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import remembered
from steelyard.check.hypotheses.evidence_with_unknown_bodies import rows_of
from steelyard.check.hypotheses.hypotheses_and_their_scores import (
    FITTED_NUMBER_COST,
    SURE,
    Hypothesis,
    choice_cost,
    likeliest,
)
from steelyard.check.hypotheses.nuisance_fit_and_score import (
    MISFIT_FLOOR,
    MOST_SAMPLE_COUNT,
    REWEIGHTINGS,
    ROUNDING,
    SHARP_DELAY_FLOOR,
    shared_fit,
)
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.robot.inertia_and_placement import Inertia

COMPENSATED = "gravity_compensated_torque"
POSSIBLE_BODY = 3.0
"""Standard deviations of moments of inertia by which second moments may be below zero."""
NEAR_AXIS_ANGLE = np.deg2rad(8.0)  # angle up to which gravity is taken to lie along an axis
LONGEST_DELAY = 0.3  # largest delay that is looked for [s]
DELAY_GRID = 31
INSIDE_DELAY_GRID = 0.95  # share of the range up to which a minimum is taken: it may lie outside
PAYLOAD_STD = np.array([30.0, *[10.0] * 3, *[3.0] * 6])
"""Standard deviations of a payload's ten numbers [kg, kg m, kg m²]."""


def gravity_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """That of the reference, none, the direction that fits, and the axis next to it."""
    own = np.asarray(reading.knowledge.robot.gravity)
    tried = [("gravity as in the reference", own, 1.0)] if reading.knowledge.identified else []
    size = float(np.linalg.norm(own)) or 9.81
    free, pulls = reading.changed(gravity=np.zeros(3)), reading.knowledge.pulls(reading.motion()[0])
    fitted = _shared_fit_beside(free, pulls, np.full(3, 30.0))
    length = 0.0 if fitted is None else float(np.linalg.norm(fitted[0]))
    if fitted is not None and 0.3 * size < length < 3.0 * size:
        says, direction, cost = _direction(fitted[0] / length)
        tried.append((says, size * direction, cost))
    for says, gravity, cost in tried:
        if not np.allclose(gravity, reading.gravity):
            yield _hypothesis("mounting", says, reading.changed(gravity=gravity), cost)
    if np.any(reading.gravity != 0.0):
        without = reading.changed(gravity=np.zeros(3), kind=COMPENSATED, held=0.0)
        yield _hypothesis("effort kind", "efforts are gravity compensated", without, choice_cost(4))
        if not reading.knowledge.identified and not reading.held:
            yield held_hypothesis(reading, 1.0)


def held_hypothesis(reading: Reading, share: float) -> Hypothesis:
    """That a controller removed the weight of the nominal bodies, or a share of it; not scored."""
    part = "" if share == 1.0 else f"{100.0 * share:.0f} % of "
    says = f"efforts lack {part}the gravity of the model file's masses, not that of the true ones"
    changed = reading.changed(held=share, kind=COMPENSATED)
    return Hypothesis("effort kind", says, changed, choice_cost(4), ())


def payload_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """The payload that fits, if it has mass; or less than the logs of the model carried."""
    columns = reading.knowledge.payload(*reading.motion(), reading.gravity)
    fitted = _shared_fit_beside(reading.changed(payload=None), columns, PAYLOAD_STD)
    if fitted is None or not (fitted[0][0] > 0.0 or _of_a_body(*fitted)):
        return
    ten, covariance = fitted
    says = f"the arm carries a payload of about {ten[0]:.2g} kg"
    if ten[0] <= 0.0:
        last = reading.knowledge.robot.bodies[carrier(reading.knowledge.robot).body].name
        says = (
            f"the arm carries about {-ten[0]:.2g} kg less on '{last}' than in the fitted logs (a "
            "tool or payload was removed)"
        )
    loaded, std = reading.changed(payload=ten), float(np.sqrt(covariance[0, 0]))
    yield _hypothesis("payload", says, loaded, 10.0 * FITTED_NUMBER_COST, std)


def _of_a_body(ten: Array, covariance: Array) -> bool:
    """Whether numbers with a negative mass are minus those of a body that can exist."""
    if ten[0] == 0.0:
        return False
    body = Inertia.from_ten(-ten)
    spread = body.moved(np.eye(3), -body.com).pseudo[:3, :3]
    slack = POSSIBLE_BODY * float(np.sqrt(np.diag(covariance)[4:].max()))
    return bool(np.linalg.eigvalsh(spread)[0] >= -slack)


def delay_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """Efforts logged late or early."""
    delay, std = delay_fit(reading)
    more = delay - reading.delay
    if np.isfinite(std) and abs(more) <= INSIDE_DELAY_GRID * _longest_delay(reading):
        changed = reading.changed(delay=delay)
        says = f"efforts are {abs(1e3 * more):.3g} ms {'late' if more > 0 else 'early'}"
        yield _hypothesis("effort delay", says, changed, FITTED_NUMBER_COST, std)


def delay_fit(reading: Reading) -> tuple[float, float]:
    """The delay at which the log agrees best, and its standard deviation, or infinity [s]."""
    columns, moving = reading.columns(reading.predicted(*reading.motion()))

    def likelihoods(delays: Array) -> Array:
        score = reading.scored(columns, moving, delays.tolist())
        return score.log_likelihood_with(SHARP_DELAY_FLOOR, np.inf)

    most = _longest_delay(reading)
    return likeliest(likelihoods, reading.delay + np.linspace(-most, most, DELAY_GRID))


def _longest_delay(reading: Reading) -> float:
    t = reading.likelihood.excerpt.t
    return min(LONGEST_DELAY, 0.1 * float(t[-1] - t[0]))


def _hypothesis(
    cause: str, says: str, reading: Reading, cost: float, spread: float = 0.0
) -> Hypothesis:
    return Hypothesis(cause, says, reading, cost, (), reading.score, spread)


def _shared_fit_beside(
    reading: Reading, columns: Array, prior: Array
) -> tuple[Array, Array] | None:
    """Numbers that all joints share beside a reading's prediction, from joint efforts per unit."""
    columns = np.array([reading.into_logged() @ x for x in columns])
    predicted, log = reading.predicted(*reading.motion()), reading.likelihood
    if not np.isfinite(predicted).all() or not np.isfinite(columns).all():
        return None
    y, moving = reading.columns(predicted)
    e = reading.efforts()
    size = MISFIT_FLOOR * np.sqrt(np.mean(np.square(e), axis=1))
    size = np.maximum(size, 1e-9 * max(float(size.max()), 1e-3))
    residual = (e - predicted) * moving
    try:
        worth = log.excerpt.worth
        return shared_fit(residual, columns, y[:, :4], log.bounds, size, worth, prior)
    except np.linalg.LinAlgError:
        return None


def _direction(fitted: Array) -> tuple[str, Array, float]:
    """A direction of gravity in words, the axis that it is near if any, and what that costs."""
    axis = axis_near(fitted)
    if axis is None:
        says = "gravity along (" + ", ".join(f"{x:.2f}" for x in fitted) + ")"
        return says, fitted, 2.0 * FITTED_NUMBER_COST
    k = int(np.argmax(np.abs(axis)))
    return f"gravity along {'+' if axis[k] > 0 else '-'}{'xyz'[k]}", axis, FITTED_NUMBER_COST


def axis_near(direction: Array) -> Array | None:
    """The axis of the base frame along which gravity is taken to lie; `None` if none is near."""
    k = int(np.argmax(np.abs(direction)))
    axis: Array = np.sign(direction[k]) * np.eye(3)[k]
    return axis if direction @ axis > np.cos(NEAR_AXIS_ANGLE) else None


def gravity_directions(reading: Reading, *, search: bool) -> Iterator[Hypothesis]:
    """Gravity along every axis, not scored; and, if asked, directions that fit any bodies."""
    size = float(np.linalg.norm(reading.gravity)) or 9.81
    axes = [*np.eye(3), *-np.eye(3)]
    free = search and reading.gravity.any() and not reading.held
    fits = _directions(reading)[:FEW_DIRECTIONS] if free else []
    for fitted in (*axes, *fits):
        says, direction, cost = _direction(fitted)
        if not np.allclose(size * direction, reading.gravity):
            yield Hypothesis("mounting", says, reading.changed(gravity=size * direction), cost, ())


FEW_DIRECTIONS = 3  # directions that are proposed
SAMPLES = 600  # samples that free bodies are fitted to
DIRECTION_RESIDUAL_FLOOR = 1e-4
"""Least residual of a row, over its effort: logs without noise have none."""
LEAST_TILT = np.deg2rad(0.5)
"""Tilt of gravity from a proposed direction from which on it is proposed too [rad]."""


def _directions(now: Reading) -> list[Array]:
    """Unit vectors that fit, the best first, none near another or the reading's own."""
    left = _DirectionResidual(now.on(now.likelihood.thinned(SAMPLES)))
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    known = now.gravity / np.linalg.norm(now.gravity)
    found: list[Array] = []
    for _, direction in sorted((left.least_near(x) for x in axes), key=lambda fit: fit[0]):
        if all(direction @ other < np.cos(NEAR_AXIS_ANGLE) for other in (known, *found)):
            found.append(direction)
    return found


@remembered
def refined_gravity(found: Reading) -> Array:
    """Gravity as the log fits it best near a direction, or that direction, shape `(3,)` [m/s²].

    Rows weigh by their residuals, which are estimated again with the direction. It stays as it is
    where no tilt of more than `LEAST_TILT` is significant.
    """
    if not found.gravity.any():
        return found.gravity
    start = found.gravity / float(np.linalg.norm(found.gravity))
    left = _DirectionResidual(found.on(found.likelihood.thinned(SAMPLES)))
    direction, known = start, left.sigma(start)
    for _ in range(REWEIGHTINGS):
        direction = left.weighted(left.sigma(direction)).least_near(direction)[1]
    gain = MOST_SAMPLE_COUNT * float(np.sum(np.log(known / left.sigma(direction))))
    tilt = float(np.arccos(np.clip(start @ direction, -1.0, 1.0)))
    significant = gain > SURE and LEAST_TILT < tilt < NEAR_AXIS_ANGLE
    return np.asarray(np.linalg.norm(found.gravity) * direction) if significant else found.gravity


class _DirectionResidual:
    """Logarithm of what is left of the efforts under a direction of gravity, any bodies taken.

    Of products of the columns without gravity and along the axes, `(n, 4, k, 4, k)`, of these with
    the efforts, and of the efforts, made once.
    """

    def __init__(self, now: Reading) -> None:
        size = float(np.linalg.norm(now.gravity))
        free, efforts, _ = rows_of(now.changed(gravity=np.zeros(3)))
        pulls = [rows_of(now.changed(gravity=size * axis))[0] - free for axis in np.eye(3)]
        lower, upper = (side.reshape(-1) for side in now.likelihood.bounds)
        kept = np.ones(free.shape[-1], dtype=np.bool_)
        kept[-len(upper) :] = upper > lower
        rows = np.stack((free, *pulls), axis=2)[..., kept]
        n, count, _, k = rows.shape
        flat = rows.reshape(n, count, 4 * k)
        self._yy = (flat.swapaxes(1, 2) @ flat / count).reshape(n, 4, k, 4, k)
        self._ye = np.einsum("jiak,ji->jak", rows, efforts) / count
        self._ee = np.maximum(np.mean(np.square(efforts), axis=1), 1e-30)
        self._weigh(self._ee)

    def _weigh(self, squares: Array) -> None:
        self._all = [np.tensordot(1.0 / squares, x, 1) for x in (self._yy, self._ye, self._ee)]
        lengths = np.einsum("akak->k", self._all[0])
        self._ridge = ROUNDING * np.diag(np.maximum(lengths, 1e-12 * lengths.max()))

    def weighted(self, sigma: Array) -> "_DirectionResidual":
        """The same with rows over their residuals, shape `(n,)`."""
        other = copy(self)
        other._weigh(np.square(sigma))
        return other

    def least_near(self, start: Array) -> tuple[float, Array]:
        from scipy.optimize import minimize

        fit = minimize(self, start + 0.05, jac=True, method="BFGS")
        return float(fit.fun), fit.x / np.linalg.norm(fit.x)

    def __call__(self, v: Array) -> tuple[float, Array]:
        """The value and its gradient; the length of `v` is of no account, and kept near 1."""
        length = float(np.linalg.norm(v))
        (yy, ye, ee), g = self._all, np.array([1.0, *v / length])
        theta = self._solved(g)
        turned = np.tensordot(yy, np.outer(g, theta), 2)
        left = float(ee - g @ ye @ theta) + len(self._ee) * DIRECTION_RESIDUAL_FLOOR**2
        slope = 2.0 * ((turned - ye) @ theta)[1:] / left
        slope = (slope - g[1:] * (g[1:] @ slope)) / length + 2.0 * (length - 1.0) * g[1:]
        return float(np.log(left)) + (length - 1.0) ** 2, slope

    def sigma(self, direction: Array) -> Array:
        """Root mean square residual of each row under a direction, shape `(n,)`."""
        g = np.array([1.0, *direction])
        theta = self._solved(g)
        explained = np.einsum("a,k,jakbl,b,l->j", g, theta, self._yy, g, theta, optimize=True)
        squares = self._ee - 2.0 * (g @ self._ye @ theta) + explained
        return np.asarray(np.sqrt(np.maximum(squares, DIRECTION_RESIDUAL_FLOOR**2 * self._ee)))

    def _solved(self, g: Array) -> Array:
        yy, ye, _ = self._all
        normal = np.tensordot(np.outer(g, g), yy, ((0, 1), (0, 2)))
        return np.asarray(np.linalg.solve(normal + self._ridge, g @ ye))
