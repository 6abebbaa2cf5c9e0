r"""Hypotheses about what is around the arm: direction of gravity, a payload, delayed efforts.

Efforts are linear in bodies and in gravity, $e = (Y_0 + \sum_a g_a Y_a) \phi$. With the bodies
eliminated by least squares (variable projection), what is left depends on the direction of $g$
alone, and is minimised from every axis. The likeliest directions are then compared with physically
consistent bodies.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.bodies import (
    BODY_SAMPLES,
    ConsistentBodies,
    consistent_bodies,
    rows_of,
)
from steelyard.check.hypotheses.excerpt import Interpretation
from steelyard.check.hypotheses.likelihood import (
    FITTED_NUMBER_COST,
    MISFIT_FLOOR,
    Hypothesis,
    Likelihood,
    choice_cost,
    one_of,
    regressors,
)
from steelyard.check.hypotheses.nuisance import SharedFit, shared_fit

NEAR_AXIS_ANGLE = np.deg2rad(8.0)
"""Angle up to which gravity is taken to lie along an axis."""
LONGEST_DELAY = 0.3
"""Largest delay that is looked for [s]."""
DELAY_GRID = 31
EARLIEST_DELAY, INSIDE_DELAY_GRID = -0.1, 0.95
"""Delay before which none is proposed against a model file [s], and the share of the range that is
searched up to which: at its edge the minimum may lie outside."""
SHARP_DELAY_FLOOR = 0.002
"""Floor of misfits where two delays of one model are compared."""
PAYLOAD_STD = np.array([30.0, *[10.0] * 3, *[3.0] * 6])
"""Standard deviations of a payload's ten numbers [kg, kg m, kg m²]."""


@dataclass(frozen=True, eq=False)
class FittedNumber:
    """A fitted number with its standard deviation."""

    value: float
    std: float


def world_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """All of them."""
    yield from gravity_hypotheses(likelihood, interpretation)
    yield from payload_hypotheses(likelihood, interpretation)
    yield from delay_hypotheses(likelihood, interpretation)


def gravity_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """That of the reference, none, the direction that fits, and the axis next to it."""
    tried: dict[str, tuple[Array, float]] = {}
    own = np.asarray(likelihood.knowledge.robot.gravity)
    if likelihood.knowledge.identified and not np.allclose(own, interpretation.gravity):
        tried["gravity as in the reference"] = own, 1.0
    size = float(np.linalg.norm(own)) or 9.81
    fitted = gravity_fit(likelihood, interpretation)
    if fitted is not None:
        length = float(np.linalg.norm(fitted.values))
        if 0.3 * size < length < 3.0 * size:
            direction = fitted.values / length
            axis = axis_near(direction)
            cost = 2.0 * FITTED_NUMBER_COST if axis is None else FITTED_NUMBER_COST
            tried[gravity_words(direction)] = size * (direction if axis is None else axis), cost
    for says, (gravity, cost) in tried.items():
        if not np.allclose(gravity, interpretation.gravity):
            yield _world(
                "mounting", says, likelihood, interpretation.changed(gravity=gravity), cost
            )
    if np.any(interpretation.gravity != 0.0):
        without = interpretation.changed(gravity=np.zeros(3), kind="gravity_compensated_torque")
        yield _world(
            "effort kind", "efforts are gravity compensated", likelihood, without, choice_cost(4)
        )


def gravity_fit(likelihood: Likelihood, interpretation: Interpretation) -> SharedFit | None:
    """Gravity in the base frame, beside friction."""
    q, dq, ddq = likelihood.motion(interpretation)
    pulls = np.array(
        [likelihood.into_logged(interpretation) @ x for x in likelihood.knowledge.pulls(q)]
    )
    free = interpretation.changed(gravity=np.zeros(3))
    return _shared_fit_beside(likelihood, free, q, dq, ddq, pulls, np.full(3, 30.0))


def payload_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """The payload that fits, if it has mass."""
    fitted = payload_fit(likelihood, interpretation)
    if fitted is None or fitted.values[0] <= 0.0:
        return
    mass, std = fitted.values[0], np.sqrt(fitted.covariance[0, 0])
    loaded = interpretation.changed(payload=fitted.values)
    says = f"the arm carries a payload of about {mass:.2g} kg"
    if not likelihood.knowledge.identified:
        says += " (if the model file's masses are right)"
    yield _world("payload", says, likelihood, loaded, 10.0 * FITTED_NUMBER_COST, float(std))


def payload_fit(likelihood: Likelihood, interpretation: Interpretation) -> SharedFit | None:
    """Ten numbers of what the last body carries, in its frame."""
    bare = interpretation.changed(payload=None)
    q, dq, ddq = likelihood.motion(bare)
    columns = likelihood.knowledge.payload(q, dq, ddq, bare.gravity)
    columns = np.array([likelihood.into_logged(interpretation) @ x for x in columns])
    return _shared_fit_beside(likelihood, bare, q, dq, ddq, columns, PAYLOAD_STD)


def delay_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """Efforts logged late or early."""
    delay = delay_fit(likelihood, interpretation)
    if delay is None:
        return
    more = delay.value - interpretation.delay
    earliest = -LONGEST_DELAY if likelihood.knowledge.identified else EARLIEST_DELAY
    if more < earliest or abs(more) > INSIDE_DELAY_GRID * _longest_delay(likelihood):
        return
    changed = interpretation.changed(delay=delay.value)
    says = f"efforts are {abs(1e3 * more):.3g} ms {'late' if more > 0 else 'early'}"
    yield _world("effort delay", says, likelihood, changed, FITTED_NUMBER_COST, delay.std)


def delay_fit(likelihood: Likelihood, interpretation: Interpretation) -> FittedNumber | None:
    """The delay at which the log agrees best, and its standard deviation."""
    most = _longest_delay(likelihood)
    grid = interpretation.delay + np.linspace(-most, most, DELAY_GRID)
    values = _at_delays(likelihood, interpretation, grid)
    for _ in range(3):
        k = int(np.clip(np.argmax(values), 1, len(grid) - 2))
        grid = np.linspace(grid[k - 1], grid[k + 1], 9)
        values = _at_delays(likelihood, interpretation, grid)
    k = int(np.clip(np.argmax(values), 1, len(grid) - 2))
    step = grid[1] - grid[0]
    bend = (values[k - 1] - 2.0 * values[k] + values[k + 1]) / step**2
    if not np.isfinite(bend) or bend >= 0.0:
        return None
    best = grid[k] - 0.5 * (values[k + 1] - values[k - 1]) / step / bend
    return FittedNumber(float(best), float(1.0 / np.sqrt(-bend)))


def _longest_delay(likelihood: Likelihood) -> float:
    return min(LONGEST_DELAY, 0.1 * float(likelihood.excerpt.t[-1] - likelihood.excerpt.t[0]))


def _at_delays(likelihood: Likelihood, interpretation: Interpretation, delays: Array) -> Array:
    sums = likelihood.sums_later(interpretation, delays.tolist())
    effort = np.tile(interpretation.effort, (len(delays), 1))
    return likelihood.scored(sums, effort, interpretation.effort_scale).log_likelihood_with(
        SHARP_DELAY_FLOOR, np.inf
    )


def _world(
    cause: str,
    says: str,
    likelihood: Likelihood,
    interpretation: Interpretation,
    cost: float,
    spread: float = 0.0,
) -> Hypothesis:
    return Hypothesis(
        cause, says, interpretation, cost, (), one_of(likelihood.score(interpretation), 0), spread
    )


def _shared_fit_beside(
    likelihood: Likelihood,
    interpretation: Interpretation,
    q: Array,
    dq: Array,
    ddq: Array,
    columns: Array,
    prior: Array,
) -> SharedFit | None:
    """Shared numbers beside an interpretation's prediction."""
    predicted = likelihood.predicted(interpretation, q, dq, ddq)
    if not np.isfinite(predicted).all() or not np.isfinite(columns).all():
        return None
    u, du = likelihood.driven(dq), likelihood.driven(ddq)
    y, moving = regressors(q[:, None], u[:, None], du[:, None], predicted[:, None])
    y, moving = y[:, 0], moving[:, 0]
    e = (
        likelihood.excerpt.later([interpretation.delay])[0, list(interpretation.effort)]
        * interpretation.effort_scale[:, None]
    )
    size = MISFIT_FLOOR * np.sqrt(np.mean(np.square(e), axis=1))
    size = np.maximum(size, 1e-9 * max(float(size.max()), 1e-3))
    residual = (e - predicted) * moving
    try:
        worth = likelihood.excerpt.worth
        return shared_fit(residual, columns, y[:, :4], likelihood.bounds, size, worth, prior)
    except np.linalg.LinAlgError:
        return None


def axis_near(direction: Array) -> Array | None:
    """The axis of the base frame along which gravity is taken to lie; `None` if none is near."""
    axis = np.zeros(3)
    k = int(np.argmax(np.abs(direction)))
    axis[k] = np.sign(direction[k])
    return axis if direction @ axis > np.cos(NEAR_AXIS_ANGLE) else None


def gravity_words(direction: Array) -> str:
    """A direction of gravity in a few words."""
    axis = axis_near(direction)
    if axis is None:
        return "gravity along (" + ", ".join(f"{x:.2f}" for x in direction) + ")"
    k = int(np.argmax(np.abs(axis)))
    return f"gravity along {'+' if axis[k] > 0 else '-'}{'xyz'[k]}"


FEW_DIRECTIONS = 3
"""Directions that are compared with physically consistent bodies."""
DIRECTION_RIDGE = 1e-4
"""What keeps columns that a motion does not excite at zero, relative to their length."""
DIRECTION_RESIDUAL_FLOOR = 1e-4
"""Least residual of a row, over its effort: logs without noise have none."""
DIRECTION_REWEIGHTINGS = 4
"""How often rows are weighed by the residuals of the last direction."""
LEAST_TILT = np.deg2rad(0.5)
"""Tilt of gravity from a proposed direction from which on it is proposed too [rad]."""
INDEPENDENT_DIRECTION_SAMPLES, SIGNIFICANT_DIRECTION = 100.0, 20.0
"""Independent samples of a joint at most, and the rise of the log-likelihood that a tilt needs."""


def mounting_hypotheses(
    likelihood: Likelihood, now: Interpretation
) -> list[tuple[Hypothesis, ConsistentBodies]]:
    """Interpretations that differ in gravity alone, the likeliest first, with the bodies of each.

    Args:
        likelihood: The log.
        now: The interpretation that they start from.
    """
    size = float(np.linalg.norm(now.gravity))
    if size == 0.0:
        return []
    found = []
    for direction in _directions(likelihood, now)[:FEW_DIRECTIONS]:
        axis = axis_near(direction)
        gravity = size * (direction if axis is None else axis)
        cost = 2.0 * FITTED_NUMBER_COST if axis is None else FITTED_NUMBER_COST
        interpretation = now.changed(gravity=gravity)
        bodies = consistent_bodies(likelihood, interpretation)
        if bodies is not None:
            says = gravity_words(direction)
            found.append(
                (Hypothesis("mounting", says, interpretation, cost, (), bodies.score), bodies)
            )
    return sorted(found, key=lambda pair: -pair[0].log_likelihood)


def _directions(likelihood: Likelihood, now: Interpretation) -> list[Array]:
    """Unit vectors that fit, the best first, none near another or the interpretation's own."""
    from scipy.optimize import least_squares

    thin = replace(likelihood, excerpt=likelihood.excerpt.thinned(BODY_SAMPLES))
    left = _DirectionResidual(thin, now)
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    fits = [least_squares(left, start + 0.05, left.slopes, max_nfev=30) for start in axes]
    known = now.gravity / np.linalg.norm(now.gravity)
    found: list[Array] = []
    for fit in sorted(fits, key=lambda fit: float(fit.cost)):
        direction = fit.x / np.linalg.norm(fit.x)
        if all(direction @ other < np.cos(NEAR_AXIS_ANGLE) for other in (known, *found)):
            found.append(direction)
    return found


def refined_gravity(likelihood: Likelihood, found: Interpretation) -> Array:
    """Gravity as the log fits it best near a direction, or that direction, shape `(3,)` [m/s²].

    Rows weigh by their residuals, which are estimated again with the direction. It stays as it is
    where no tilt of more than `LEAST_TILT` is significant.

    Args:
        likelihood: The log.
        found: Its interpretation, gravity along an axis for example.
    """
    from scipy.optimize import least_squares

    thin = replace(likelihood, excerpt=likelihood.excerpt.thinned(BODY_SAMPLES))
    start = found.gravity / max(float(np.linalg.norm(found.gravity)), 1e-12)
    left = _DirectionResidual(thin, found)
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

    def __init__(self, likelihood: Likelihood, now: Interpretation) -> None:
        size = float(np.linalg.norm(now.gravity))
        free, efforts, _ = rows_of(likelihood, now.changed(gravity=np.zeros(3)))
        lower, upper = (side.reshape(-1) for side in likelihood.bounds)
        kept = np.ones(free.shape[-1], dtype=np.bool_)
        kept[-len(upper) :] = upper > lower
        free = free[..., kept]
        pulls = [
            rows_of(likelihood, now.changed(gravity=size * axis))[0][..., kept] - free
            for axis in np.eye(3)
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
