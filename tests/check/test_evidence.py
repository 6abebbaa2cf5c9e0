"""The evidence of readings: Laplace's method finds the integral over bodies and friction."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import wishart

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.decision.ranked_readings import ranking
from steelyard.check.hypotheses.evidence_with_unknown_bodies import _Products
from steelyard.check.hypotheses.laplace_over_bodies import (
    FRICTION_WIDTH,
    LENGTHS,
    OFFSET_WIDTH,
    TYPICAL_FRICTION,
    averaged,
    nominal_bodies,
)
from steelyard.check.hypotheses.nuisance_fit_and_score import NUISANCES, OFFSET_COLUMN
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import COLUMNS, ROWS

POSITIVE = np.array([[True, True, True, False]])  # friction and rotor inertia, and an offset


def drawn(width: float, count: int, rng: np.random.Generator) -> Array:
    """Unknowns of one body and one joint, from what is expected of them."""
    gamma = width**-2.0
    bodies = wishart(2.0 * gamma + 5.0, np.eye(4) / (2.0 * gamma)).rvs(count, random_state=rng)
    bodies = bodies.reshape(count, 4, 4)
    shape = FRICTION_WIDTH**-2.0
    own = rng.gamma(shape + 1.0, TYPICAL_FRICTION / shape, (count, 3))
    offset = rng.normal(0.0, OFFSET_WIDTH, (count, 1))
    return np.hstack((bodies[:, ROWS, COLUMNS] / LENGTHS, own, offset))


def products(seed: int) -> tuple[Array, Array]:
    """Columns of a body and a joint's own, and an effort near that of the nominal body."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(40, 14)) / np.sqrt(14.0)
    truth = drawn(0.2, 1, rng)[0]
    effort = columns @ truth
    effort += 0.7 * np.std(effort) * rng.normal(size=40)
    columns, effort = (x / np.sqrt(np.mean(effort**2)) for x in (columns, effort))
    return columns.T @ columns / 40.0, columns.T @ effort / 40.0


@pytest.mark.parametrize("width", [0.05, 0.2])
def test_without_samples_the_evidence_is_that_of_a_density(width: float) -> None:
    yy, ye = products(1)
    gamma = np.full((1, 1, 1), width**-2.0)
    found = averaged(
        yy[None, None], ye[None, None], np.ones((1, 1)), np.zeros((1, 1)), POSITIVE, gamma, 20
    )
    # Laplace's method misses 0.27 for each friction, whose density is wide and skew
    assert abs(float(found.logs[0, 0]) + 3.0 * 0.27) < 0.3
    np.testing.assert_allclose(found.bodies[0, 0], nominal_bodies(1), atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("width", [0.2, 0.8])
def test_the_evidence_is_the_mean_likelihood_of_bodies_that_can_exist(
    seed: int, width: float
) -> None:
    yy, ye = products(seed)
    counts, gamma = np.array([[12.0]]), np.full((1, 1, 1), width**-2.0)
    one = np.ones((1, 1))
    found = averaged(yy[None, None], ye[None, None], one, counts, POSITIVE, gamma, 60)
    unknowns = drawn(width, 60_000, np.random.default_rng(100 + seed))
    squares = 1.0 + np.einsum("ka,ab,kb->k", unknowns, yy, unknowns) - 2.0 * unknowns @ ye
    variance = float(found.misfits[0, 0, 0]) ** 2
    logs = -0.5 * 12.0 * (squares / variance + np.log(variance) - 1.0)
    mean = float(logsumexp(logs) - np.log(len(logs)))
    assert abs(float(found.logs[0, 0]) - mean) < 1.0


@pytest.mark.parametrize("weight", [0.2, 7.0])
def test_an_offset_may_balance_what_bodies_weigh_and_the_log_lacks(weight: float) -> None:
    """A lift whose controller subtracts its weight logs what is left."""
    k = 10
    yy, ye = (
        np.zeros((1, k + NUISANCES + 1, k + NUISANCES + 1)),
        np.zeros((1, k + NUISANCES + 1, 1)),
    )
    unit = nominal_bodies(1) / np.square(nominal_bodies(1)).sum()
    yy[0, :k, :k] = weight**2 * np.outer(unit, unit)  # the nominal bodies' effort has this size
    yy[0, range(k, k + NUISANCES), range(k, k + NUISANCES)] = 1.0
    products = _Products(yy, ye, np.full((1, 1), 4.0), np.array([50.0]))  # an effort of 2
    reading = cast(Any, SimpleNamespace(effort=(0,), effort_scale=np.ones(1), held=0.0, base=None))
    found = products.problem(reading, 1.0)
    sizes = np.sqrt(np.einsum("kk->k", found.yy[0, k:, k:]))
    others = [column for column in range(NUISANCES) if column != OFFSET_COLUMN]
    assert sizes[others] == pytest.approx(1.0)
    assert sizes[OFFSET_COLUMN] == pytest.approx(max(1.0, weight / 2.0))


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_an_effort_that_never_changes_is_no_evidence(arm: Arm, value: float) -> None:
    """No sign of its joint follows from it, and no other joint's effort is lost."""
    table = arm.table.copy()
    table[:, arm.at("tau{}_Nm")[-1]] = value
    case = arm.case(table, known=False)
    found = ranking(case, case.logs[0])
    assert found is not None and found.search is not None
    counts = found.search.declared.evidence.counts
    assert counts[-1] == 0.0 and (counts[:-1] > 0.0).all()
    whole = arm.case(arm.table, known=False)
    before = ranking(whole, whole.logs[0])
    assert before is not None and before.search is not None
    assert (before.search.declared.evidence.counts > 0.0).all()
