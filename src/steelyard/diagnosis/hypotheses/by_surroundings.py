"""Explanations by what is around the arm: gravity's direction, a payload, efforts logged late."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.hypothesis import FREE, Hypothesis, choice, one_of
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import FLOOR, Likelihood, regressors
from steelyard.diagnosis.likelihood.shared_fit import SharedFit, shared_fit

NEAR = np.deg2rad(8.0)
"""Angle up to which gravity is taken to lie along an axis."""
LONGEST = 0.3
"""Largest delay that is looked for [s]."""
DELAYS = 31
EARLIEST, INSIDE = -0.1, 0.95
"""Delay before which none is proposed against a model file [s], and the share of the range that is
searched up to which: at its edge the minimum may lie outside."""
SHARP = 0.002
"""Floor of misfits where two delays of one model are compared."""
HEAVY = np.array([30.0, *[10.0] * 3, *[3.0] * 6])
"""Standard deviations of a payload's ten numbers [kg, kg m, kg m²]."""


@dataclass(frozen=True, eq=False)
class Found:
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
            cost = 2.0 * FREE if axis is None else FREE
            tried[gravity_words(direction)] = size * (direction if axis is None else axis), cost
    for says, (gravity, cost) in tried.items():
        if not np.allclose(gravity, interpretation.gravity):
            yield _world(
                "mounting", says, likelihood, interpretation.changed(gravity=gravity), cost
            )
    if np.any(interpretation.gravity != 0.0):
        without = interpretation.changed(gravity=np.zeros(3), kind="gravity_compensated_torque")
        yield _world(
            "effort kind", "efforts are gravity compensated", likelihood, without, choice(4)
        )


def gravity_fit(likelihood: Likelihood, interpretation: Interpretation) -> SharedFit | None:
    """Gravity in the base frame, beside friction."""
    q, dq, ddq = likelihood.motion(interpretation)
    pulls = np.array(
        [likelihood.into_logged(interpretation) @ x for x in likelihood.knowledge.pulls(q)]
    )
    free = interpretation.changed(gravity=np.zeros(3))
    return _fit(likelihood, free, q, dq, ddq, pulls, np.full(3, 30.0))


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
    yield _world("payload", says, likelihood, loaded, 10.0 * FREE, float(std))


def payload_fit(likelihood: Likelihood, interpretation: Interpretation) -> SharedFit | None:
    """Ten numbers of what the last body carries, in its frame."""
    bare = interpretation.changed(payload=None)
    q, dq, ddq = likelihood.motion(bare)
    columns = likelihood.knowledge.payload(q, dq, ddq, bare.gravity)
    columns = np.array([likelihood.into_logged(interpretation) @ x for x in columns])
    return _fit(likelihood, bare, q, dq, ddq, columns, HEAVY)


def delay_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """Efforts logged late or early."""
    delay = delay_fit(likelihood, interpretation)
    if delay is None:
        return
    more = delay.value - interpretation.delay
    earliest = -LONGEST if likelihood.knowledge.identified else EARLIEST
    if more < earliest or abs(more) > INSIDE * _longest(likelihood):
        return
    changed = interpretation.changed(delay=delay.value)
    says = f"efforts are {abs(1e3 * more):.3g} ms {'late' if more > 0 else 'early'}"
    yield _world("effort delay", says, likelihood, changed, FREE, delay.std)


def delay_fit(likelihood: Likelihood, interpretation: Interpretation) -> Found | None:
    """The delay at which the log agrees best, and its standard deviation."""
    most = _longest(likelihood)
    grid = interpretation.delay + np.linspace(-most, most, DELAYS)
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
    return Found(float(best), float(1.0 / np.sqrt(-bend)))


def _longest(likelihood: Likelihood) -> float:
    return min(LONGEST, 0.1 * float(likelihood.excerpt.t[-1] - likelihood.excerpt.t[0]))


def _at_delays(likelihood: Likelihood, interpretation: Interpretation, delays: Array) -> Array:
    sums = likelihood.sums_later(interpretation, delays.tolist())
    effort = np.tile(interpretation.effort, (len(delays), 1))
    return likelihood.scored(sums, effort, interpretation.effort_scale).log_likelihood_with(
        SHARP, np.inf
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


def _fit(
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
    size = FLOOR * np.sqrt(np.mean(np.square(e), axis=1))
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
    return axis if direction @ axis > np.cos(NEAR) else None


def gravity_words(direction: Array) -> str:
    """A direction of gravity in a few words."""
    axis = axis_near(direction)
    if axis is None:
        return "gravity along (" + ", ".join(f"{x:.2f}" for x in direction) + ")"
    k = int(np.argmax(np.abs(axis)))
    return f"gravity along {'+' if axis[k] > 0 else '-'}{'xyz'[k]}"
