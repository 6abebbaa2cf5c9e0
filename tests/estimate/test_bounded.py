"""Bounds against least squares on problems whose optimum is known."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from invented import single
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.estimator_register import ESTIMATORS, Context
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.known_bounded_and_ridge import (
    BoundedLeastSquares,
    base_bounds,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import Offset, RigidBody
from steelyard.model.model import Model

MODEL = Model(single(), (RigidBody(), Coulomb(), Viscous(), Offset()))
REGRESSOR = base_regressor(MODEL)
NAMES = REGRESSOR.layout.columns
COULOMB, OFFSET = "coulomb.hinge", "offset.hinge"
TRUTH = np.array([0.3 * k + 0.5 for k in range(len(NAMES))])
NOISE = 0.05


def information(
    truth: np.ndarray = TRUTH, run: str = "run", seed: int = 0, speed: Callable[..., Any] = np.array
) -> tuple[Information, np.ndarray, np.ndarray]:
    """Information, dense regressor `(N, p)` and effort `(N,)` of a drawn motion."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 1, 300))
    dq = speed(dq)
    dense = REGRESSOR.dense(q, dq, ddq)
    effort = dense @ truth + NOISE * rng.normal(size=(1, 300))
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
    signature = Signature(MODEL.fingerprint, NAMES, ("Nm",), "none")
    made = Information(
        REGRESSOR.layout,
        signature,
        (Window(run, 0.0, 1.0),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )
    return made, dense[0], effort[0]


def distance(estimate: Estimate, wanted: Estimate) -> float:
    """Largest difference in standard deviations."""
    change = estimate.parameters.values - wanted.parameters.values
    return float(np.abs(change / wanted.std).max())


def negative_coulomb() -> np.ndarray:
    truth = TRUTH.copy()
    truth[NAMES.index(COULOMB)] = -0.4
    return truth


def test_without_bounds_it_is_weighted_least_squares() -> None:
    data, _, _ = information()
    found, wanted = BoundedLeastSquares()(data), WeightedLeastSquares()(data)
    assert distance(found, wanted) < 1e-8
    assert np.allclose(found.covariance, wanted.covariance, rtol=1e-5)
    assert np.allclose(found.sigma, wanted.sigma, rtol=1e-9)
    assert found.notes == ()


def test_a_bound_that_holds_takes_its_column_out() -> None:
    data, dense, effort = information(negative_coulomb())
    found = BoundedLeastSquares({COULOMB: (0.0, np.inf)})(data)
    others = [k for k, name in enumerate(NAMES) if name != COULOMB]
    wanted = np.linalg.lstsq(dense[:, others], effort)[0]
    assert found.parameters[COULOMB] == 0.0
    assert np.allclose(found.parameters.values[others], wanted, rtol=1e-8)
    assert found.notes == (f"at a bound: {COULOMB}",)
    left = effort - dense[:, others] @ wanted
    assert found.sigma[0] == pytest.approx(np.sqrt(left @ left / len(left)), rel=0.02)


def test_parameters_of_single_runs_stay_theirs() -> None:
    shifted = TRUTH.copy()
    shifted[NAMES.index(OFFSET)] += 3.0
    data = information()[0] + information(shifted, "other", 1)[0]
    found = BoundedLeastSquares(per_run=(OFFSET,))(data)
    wanted = WeightedLeastSquares(per_run=(OFFSET,))(data)
    assert found.parameters.names == wanted.parameters.names
    assert distance(found, wanted) < 1e-7
    for mine, theirs in zip(found.per_run, wanted.per_run, strict=True):
        assert mine.run == theirs.run
        assert np.allclose(mine.parameters.values, theirs.parameters.values, rtol=1e-8)
        assert np.allclose(mine.std, theirs.std, rtol=1e-5)


def test_bounds_of_base_parameters_follow_from_those_in_them() -> None:
    known = default_knowledge(MODEL)
    lower, upper = known.lower.copy(), known.upper.copy()
    base = REGRESSOR.base
    for k, name in enumerate(base.names):
        lower[k], upper[k] = -1.0 - k, 2.0 + k
        assert name == known.names[k]
    bounds = base_bounds(base, type(known)(known.names, known.bodies, known.priors, lower, upper))
    rng = np.random.default_rng(0)
    inside = base.lift @ rng.uniform(lower[:, None], upper[:, None], (len(lower), 2000))
    for (low, high), values, row in zip(bounds.values(), inside, base.lift, strict=True):
        assert low <= values.min()
        assert values.max() <= high
        corner = np.where(row > 0.0, upper, lower)
        assert high == pytest.approx(row @ corner)
    assert base_bounds(base, known)[COULOMB] == (0.0, np.inf)


def test_what_stands_for_others_is_not_bounded() -> None:
    data, _, _ = information(negative_coulomb(), speed=np.abs)
    found = BoundedLeastSquares({COULOMB: (0.0, np.inf)})(data)
    assert [(b.name, b.tied_to) for b in found.blind] == [(OFFSET, (COULOMB,))]
    assert found.parameters[COULOMB] == pytest.approx(
        WeightedLeastSquares()(data).parameters[COULOMB], rel=1e-8
    )


@pytest.mark.parametrize("name", ["bounded LS", "consistent"])
def test_they_are_offered(name: str) -> None:
    data = information()[0] + information(run="other", seed=1)[0]
    offer = {offer.name: offer for offer in ESTIMATORS}[name]
    context = Context(REGRESSOR, default_knowledge(MODEL), (OFFSET,))
    assert offer.needs == "information"
    estimate = offer.make(context)(data)
    assert np.isfinite(estimate.values.values).all()
    assert estimate.parameters[COULOMB] >= 0.0
    assert [own.run for own in estimate.per_run] == ["run", "other"]
