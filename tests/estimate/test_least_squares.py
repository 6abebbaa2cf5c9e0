"""Least squares from information against NumPy's on the stored regressor."""

import numpy as np
import pytest

from invented import tree
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.model.model import Model

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
ESTIMATORS = [OrdinaryLeastSquares(), WeightedLeastSquares()]
NOISE = np.array([0.01, 0.1, 1.0, 0.3])


def data(
    noise: np.ndarray, seed: int = 0, still: int | None = None, count: int = 1200
) -> tuple[Information, np.ndarray, np.ndarray, np.ndarray]:
    """Information, truth, stacked regressor and effort of a drawn motion."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 4, count))
    if still is not None:
        q[still], dq[still], ddq[still] = 0.4, 0.0, 0.0
    truth = rng.normal(size=len(REGRESSOR.layout.columns))
    dense = REGRESSOR.dense(q, dq, ddq)
    effort = dense @ truth + noise[:, None] * rng.normal(size=(4, count))
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
    information = Information(
        REGRESSOR.layout,
        Signature(MODEL.fingerprint, REGRESSOR.layout.columns, ("Nm",) * 4, "none"),
        (Window("run", 0.0, 1.0),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )
    return information, truth, dense, effort


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_exact_data_give_the_truth(estimator: OrdinaryLeastSquares | WeightedLeastSquares) -> None:
    information, truth, _, _ = data(np.zeros(4))
    estimate = estimator(information)
    assert np.abs(estimate.parameters.values - truth).max() < 1e-9
    assert estimate.blind == ()
    assert estimate.parameters.names == REGRESSOR.layout.columns


def test_ordinary_equals_lstsq_with_its_sandwich() -> None:
    information, _, dense, effort = data(NOISE)
    stacked = dense.reshape(-1, dense.shape[2])
    wanted, *_ = np.linalg.lstsq(stacked, effort.ravel(), rcond=None)
    estimate = OrdinaryLeastSquares()(information)
    assert np.abs(estimate.parameters.values - wanted).max() < 1e-9 * np.abs(wanted).max()
    inverse = np.linalg.inv(stacked.T @ stacked)
    noise = np.repeat(estimate.sigma**2, dense.shape[1])
    sandwich = inverse @ (stacked.T * noise) @ stacked @ inverse
    assert np.allclose(estimate.covariance, sandwich, rtol=1e-8, atol=0.0)
    singular = np.linalg.svd(stacked, compute_uv=False)
    assert np.isclose(estimate.condition, singular[0] / singular[-1], rtol=1e-6)
    unit = np.linalg.svd(stacked / np.linalg.norm(stacked, axis=0), compute_uv=False)
    assert np.isclose(estimate.condition_normalised, unit[0] / unit[-1], rtol=1e-6)


def test_weighted_equals_lstsq_with_its_own_weights() -> None:
    information, _, dense, effort = data(NOISE)
    estimate = WeightedLeastSquares()(information)
    assert np.allclose(estimate.sigma, NOISE, rtol=0.1)
    scale = 1.0 / estimate.sigma
    stacked = (dense * scale[:, None, None]).reshape(-1, dense.shape[2])
    wanted, *_ = np.linalg.lstsq(stacked, (effort * scale[:, None]).ravel(), rcond=None)
    assert np.abs(estimate.parameters.values - wanted).max() < 1e-6 * np.abs(wanted).max()
    assert np.allclose(
        estimate.covariance, np.linalg.inv(stacked.T @ stacked), rtol=1e-5, atol=1e-12
    )


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_intervals_hold_the_truth(estimator: OrdinaryLeastSquares | WeightedLeastSquares) -> None:
    inside = total = 0
    for seed in range(60):
        information, truth, _, _ = data(NOISE, seed, count=200)
        estimate = estimator(information)
        error = np.abs(estimate.parameters.values - truth)
        inside += int(np.sum(error <= estimate.half_width))
        total += len(truth)
    assert 0.93 < inside / total < 0.97


def test_the_weighted_estimate_is_the_better_one() -> None:
    errors = {}
    for estimator in ESTIMATORS:
        squares = [
            np.sum((estimator(found).parameters.values - truth) ** 2)
            for found, truth, _, _ in (data(NOISE, seed) for seed in range(20))
        ]
        errors[type(estimator).__name__] = np.sqrt(np.mean(squares))
    assert errors["WeightedLeastSquares"] < 0.7 * errors["OrdinaryLeastSquares"]


def test_a_joint_that_never_moved_is_named() -> None:
    information, truth, _, _ = data(np.zeros(4), still=3)
    estimate = WeightedLeastSquares()(information)
    blind = {b.name: b.tied_to for b in estimate.blind}
    for law in ("rotor_inertia", "coulomb", "viscous"):
        assert blind[f"{law}.tip_joint"] == ()
    assert not set(blind) & set(estimate.parameters.names)
    assert len(blind) + len(estimate.parameters) == len(truth)
    tied = [names for names in blind.values() if names]
    assert tied and all(set(names) <= set(estimate.parameters.names) for names in tied)
    assert estimate.sigma.max() < 1e-6


def test_no_data_is_no_estimate() -> None:
    information = data(np.zeros(4))[0].of([])
    with pytest.raises(DataError, match="none of the model's parameters is identifiable"):
        WeightedLeastSquares()(information)
