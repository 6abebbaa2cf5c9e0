r"""Hypotheses about what is around the arm: direction of gravity, a payload, delayed efforts.

Efforts are linear in bodies and in gravity, $e = (Y_0 + \sum_a g_a Y_a) \phi$. With the bodies
eliminated by least squares (variable projection), what is left depends on the direction of $g$
alone, and is minimised from every axis.
"""

from collections.abc import Iterator
from copy import copy

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.marginal_likelihood import rows_of
from steelyard.check.hypotheses.nuisance_fit_and_score import (
    MISFIT_FLOOR,
    SHARP_DELAY_FLOOR,
    SharedFit,
    shared_fit,
)
from steelyard.check.hypotheses.readings_and_likelihood import (
    FITTED_NUMBER_COST,
    Hypothesis,
    Reading,
    choice_cost,
    likeliest,
)
from steelyard.estimate.payload.payload_frame import carrier
from steelyard.robot.inertia_and_placement import Inertia

POSSIBLE_BODY = 3.0
"""Standard deviations of moments of inertia by which second moments may be below zero."""
NEAR_AXIS_ANGLE = np.deg2rad(8.0)  # angle up to which gravity is taken to lie along an axis
LONGEST_DELAY = 0.3  # largest delay that is looked for [s]
DELAY_GRID = 31
INSIDE_DELAY_GRID = 0.95  # share of the range up to which a minimum is taken: it may lie outside
PAYLOAD_STD = np.array([30.0, *[10.0] * 3, *[3.0] * 6])
"""Standard deviations of a payload's ten numbers [kg, kg m, kg m²]."""


def world_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """All of them, by a reference."""
    yield from gravity_hypotheses(reading)
    yield from payload_hypotheses(reading)
    yield from delay_hypotheses(reading)


def gravity_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """That of the reference, none, the direction that fits, and the axis next to it."""
    own = np.asarray(reading.knowledge.robot.gravity)
    tried = [("gravity as in the reference", own, 1.0)] if reading.knowledge.identified else []
    size = float(np.linalg.norm(own)) or 9.81
    free, pulls = reading.changed(gravity=np.zeros(3)), reading.knowledge.pulls(reading.motion()[0])
    fitted = _shared_fit_beside(free, pulls, np.full(3, 30.0))
    length = 0.0 if fitted is None else float(np.linalg.norm(fitted.values))
    if fitted is not None and 0.3 * size < length < 3.0 * size:
        says, direction, cost = _direction(fitted.values / length)
        tried.append((says, size * direction, cost))
    for says, gravity, cost in tried:
        if not np.allclose(gravity, reading.gravity):
            yield _hypothesis("mounting", says, reading.changed(gravity=gravity), cost)
    if np.any(reading.gravity != 0.0):
        without = reading.changed(gravity=np.zeros(3), kind="gravity_compensated_torque")
        says = "efforts are gravity compensated"
        yield _hypothesis("effort kind", says, without, choice_cost(4))


def payload_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """The payload that fits, if it has mass; or less than the logs of the model carried."""
    fitted = payload_fit(reading)
    if fitted is None or not (fitted.values[0] > 0.0 or _of_a_body(fitted)):
        return
    mass, std = fitted.values[0], float(np.sqrt(fitted.covariance[0, 0]))
    says = f"the arm carries a payload of about {mass:.2g} kg"
    if mass <= 0.0:
        last = reading.knowledge.robot.bodies[carrier(reading.knowledge.robot).body].name
        says = (
            f"the arm carries about {-mass:.2g} kg less on '{last}' than in the fitted logs (a "
            "tool or payload was removed)"
        )
    loaded = reading.changed(payload=fitted.values)
    yield _hypothesis("payload", says, loaded, 10.0 * FITTED_NUMBER_COST, std)


def _of_a_body(fitted: SharedFit) -> bool:
    """Whether numbers with a negative mass are minus those of a body that can exist."""
    if fitted.values[0] == 0.0:
        return False
    body = Inertia.from_ten(-fitted.values)
    spread = body.moved(np.eye(3), -body.com).pseudo[:3, :3]
    slack = POSSIBLE_BODY * float(np.sqrt(np.diag(fitted.covariance)[4:].max()))
    return bool(np.linalg.eigvalsh(spread)[0] >= -slack)


def payload_fit(reading: Reading) -> SharedFit | None:
    """Ten numbers of what the last body carries, in its frame."""
    columns = reading.knowledge.payload(*reading.motion(), reading.gravity)
    return _shared_fit_beside(reading.changed(payload=None), columns, PAYLOAD_STD)


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
    return likeliest(likelihoods, reading.delay + np.linspace(-most, most, DELAY_GRID), 3)


def _longest_delay(reading: Reading) -> float:
    t = reading.likelihood.excerpt.t
    return min(LONGEST_DELAY, 0.1 * float(t[-1] - t[0]))


def _hypothesis(
    cause: str, says: str, reading: Reading, cost: float, spread: float = 0.0
) -> Hypothesis:
    return Hypothesis(cause, says, reading, cost, (), reading.score, spread)


def _shared_fit_beside(reading: Reading, columns: Array, prior: Array) -> SharedFit | None:
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
    fits = _directions(reading)[:FEW_DIRECTIONS] if search and reading.gravity.any() else []
    for fitted in (*axes, *fits):
        says, direction, cost = _direction(fitted)
        if not np.allclose(size * direction, reading.gravity):
            yield Hypothesis("mounting", says, reading.changed(gravity=size * direction), cost, ())


FEW_DIRECTIONS = 3  # directions that are proposed
DIRECTION_SAMPLES = 600  # samples that they are fitted to
DIRECTION_RIDGE = 1e-4
"""What keeps columns that a motion does not excite at zero, relative to their length."""
DIRECTION_RESIDUAL_FLOOR = 1e-4
"""Least residual of a row, over its effort: logs without noise have none."""
DIRECTION_REWEIGHTINGS = 4  # how often rows are weighed by the residuals of the last direction
LEAST_TILT = np.deg2rad(0.5)
"""Tilt of gravity from a proposed direction from which on it is proposed too [rad]."""
INDEPENDENT_DIRECTION_SAMPLES, SIGNIFICANT_DIRECTION = 100.0, 20.0
"""Independent samples of a joint at most, and the rise of the log-likelihood that a tilt needs."""


def _directions(now: Reading) -> list[Array]:
    """Unit vectors that fit, the best first, none near another or the reading's own."""
    from scipy.optimize import least_squares

    left = _DirectionResidual(now.on(now.likelihood.thinned(DIRECTION_SAMPLES)))
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    fits = [least_squares(left, start + 0.05, left.slopes, max_nfev=30) for start in axes]
    known = now.gravity / np.linalg.norm(now.gravity)
    found: list[Array] = []
    for fit in sorted(fits, key=lambda fit: float(fit.cost)):
        direction = fit.x / np.linalg.norm(fit.x)
        if all(direction @ other < np.cos(NEAR_AXIS_ANGLE) for other in (known, *found)):
            found.append(direction)
    return found


def refined_gravity(found: Reading) -> Array:
    """Gravity as the log fits it best near a direction, or that direction, shape `(3,)` [m/s²].

    Rows weigh by their residuals, which are estimated again with the direction. It stays as it is
    where no tilt of more than `LEAST_TILT` is significant.
    """
    from scipy.optimize import least_squares

    if not found.gravity.any():
        return found.gravity
    start = found.gravity / float(np.linalg.norm(found.gravity))
    left = _DirectionResidual(found.on(found.likelihood.thinned(DIRECTION_SAMPLES)))
    direction, known = start, left.sigma(start)
    for _ in range(DIRECTION_REWEIGHTINGS):
        weighted = left.weighted(left.sigma(direction))
        fit = least_squares(weighted, direction, weighted.slopes, max_nfev=30)
        direction = fit.x / np.linalg.norm(fit.x)
    gain = INDEPENDENT_DIRECTION_SAMPLES * float(np.sum(np.log(known / left.sigma(direction))))
    tilt = float(np.arccos(np.clip(start @ direction, -1.0, 1.0)))
    significant = gain > SIGNIFICANT_DIRECTION and LEAST_TILT < tilt < NEAR_AXIS_ANGLE
    return np.asarray(np.linalg.norm(found.gravity) * direction) if significant else found.gravity


class _DirectionResidual:
    """What is left of the efforts under a direction of gravity, any bodies taken."""

    def __init__(self, now: Reading) -> None:
        size = float(np.linalg.norm(now.gravity))
        free, efforts, _ = rows_of(now.changed(gravity=np.zeros(3)))
        lower, upper = (side.reshape(-1) for side in now.likelihood.bounds)
        kept = np.ones(free.shape[-1], dtype=np.bool_)
        kept[-len(upper) :] = upper > lower
        free = free[..., kept]
        pulls = [
            rows_of(now.changed(gravity=size * axis))[0][..., kept] - free for axis in np.eye(3)
        ]
        self._whole = np.sqrt(np.maximum(np.mean(np.square(efforts), axis=1), 1e-30))
        self._k = free.shape[-1]
        self._blocks = np.concatenate((free, *pulls, efforts[..., None]), axis=-1)
        self._weigh(self._whole)

    def _weigh(self, scales: Array) -> None:
        blocks = self._blocks / scales[:, None, None]
        triangle = np.asarray(np.linalg.qr(blocks.reshape(-1, blocks.shape[-1]), mode="r"))
        self._columns, self._efforts = triangle[:, :-1], triangle[:, -1]

    def weighted(self, scales: Array) -> "_DirectionResidual":
        """The same with rows over `scales`, shape `(n,)`."""
        other = copy(self)
        other._weigh(scales)
        return other

    def __call__(self, v: Array) -> Array:
        """Residuals; the length of `v` is of no account, and kept near 1."""
        length = float(np.linalg.norm(v))
        spanned, right, _ = self._solved(v / length)
        return np.concatenate((right - spanned @ (spanned.T @ right), [length - 1.0]))

    def slopes(self, v: Array) -> Array:
        """Derivatives of the residuals but for what the bodies' change takes [Kaufman1975]."""
        length = float(np.linalg.norm(v))
        direction = v / length
        spanned, _, solution = self._solved(direction)
        pulls = self._columns.reshape(len(self._columns), 4, self._k)[:, 1:] @ solution
        wide = np.concatenate((-pulls, np.zeros((self._k, 3))))
        wide -= spanned @ (spanned.T @ wide)
        turned = (np.eye(3) - np.outer(direction, direction)) / length
        return np.concatenate((wide @ turned, direction[None]))

    def sigma(self, direction: Array) -> Array:
        """Root mean square residual of each row under a direction, shape `(n,)`."""
        solution = self._solved(direction)[2]
        columns = self._under(direction, self._blocks[..., :-1])
        residuals = self._blocks[..., -1] - columns @ solution
        size = np.sqrt(np.mean(np.square(residuals), axis=1))
        return np.asarray(np.maximum(size, DIRECTION_RESIDUAL_FLOOR * self._whole))

    def _under(self, direction: Array, blocks: Array) -> Array:
        """Columns under a direction of gravity, from those without and along the axes."""
        parts = blocks.reshape(*blocks.shape[:-1], 4, self._k)
        columns: Array = parts[..., 0, :] + np.einsum("a,...ak->...k", direction, parts[..., 1:, :])
        return columns

    def _solved(self, direction: Array) -> tuple[Array, Array, Array]:
        """With the ridge: an orthonormal basis of the columns, the efforts, and the solution."""
        columns = self._under(direction, self._columns)
        lengths = np.linalg.norm(columns, axis=0)
        ridge = np.diag(DIRECTION_RIDGE * np.maximum(lengths, 1e-6 * lengths.max()))
        wide: Array = np.concatenate((columns, ridge))
        right: Array = np.concatenate((self._efforts, np.zeros(self._k)))
        spanned, triangle = np.linalg.qr(wide)
        return spanned, right, np.linalg.solve(triangle, spanned.T @ right)
