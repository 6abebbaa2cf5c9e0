"""Recursive least squares: the same as all at once, and drift that is followed."""

import numpy as np
import pytest

from drawn import motion_of, samples_of
from invented import single, tree
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    MOST_WINDOWS_APART,
    Recursive,
    WeightedLeastSquares,
    after,
)
from steelyard.model.model import Model

TREE, SINGLE = base_regressor(Model(tree())), base_regressor(Model(single()))
SECONDS, RATE = 60, 100


def drifting(
    amount: float, seed: int = 0, seconds: int = SECONDS
) -> tuple[Information, np.ndarray]:
    """One window a second; one parameter grows by `amount` over the run; its values."""
    rng = np.random.default_rng([seed, 1])
    truth = np.ones(len(SINGLE.layout.columns))
    parts, track = [], []
    for second in range(seconds):
        motion = motion_of(1, RATE, 1000 * seed + second)
        value = 1.0 + amount * second / seconds
        truth[-1] = value
        effort = SINGLE.dense(*motion) @ truth + 0.1 * rng.normal(size=(1, RATE))
        samples = samples_of(SINGLE, motion, effort, start=float(second))
        parts.append(samples.information().merged(1))
        track.append(value)
    return sum(parts[1:], parts[0]), np.array(track)


def test_without_forgetting_it_is_all_at_once() -> None:
    motion, rng = motion_of(4, 1200, 0), np.random.default_rng(1)
    truth = rng.normal(size=len(TREE.layout.columns))
    noise = np.array([0.01, 0.1, 1.0, 0.3])[:, None] * rng.normal(size=(4, 1200))
    information = samples_of(TREE, motion, TREE.dense(*motion) @ truth + noise).information()
    found, wanted = Recursive()(information), WeightedLeastSquares()(information)
    assert np.allclose(found.parameters.values, wanted.parameters.values, rtol=1e-12, atol=1e-12)
    assert np.allclose(found.covariance, wanted.covariance, rtol=1e-9)
    assert np.array_equal(found.n_samples, wanted.n_samples)


def test_forgetting_weighs_windows_by_their_age() -> None:
    """Against weighted least squares on the samples themselves."""
    rng = np.random.default_rng(0)
    rows, weights, parts = [], [], []
    for second in range(20):
        motion = motion_of(1, RATE, second)
        effort = rng.normal(size=(1, RATE))
        samples = samples_of(SINGLE, motion, effort, start=float(second))
        parts.append(samples.information().merged(1))
        rows.append(samples.rows[0])
        weights.append(np.full(RATE, 0.8 ** (0.99 * (19 - second))))
    whole, root = np.vstack(rows), np.sqrt(np.concatenate(weights))[:, None]
    wanted, *_ = np.linalg.lstsq(whole[:, :-1] * root, whole[:, -1] * root[:, 0], rcond=None)
    found = Recursive(0.8)(sum(parts[1:], parts[0]))
    assert np.allclose(found.parameters.values, wanted, rtol=1e-9)
    inverse = np.linalg.inv((whole[:, :-1] * root).T @ (whole[:, :-1] * root))
    noise = (whole[:, :-1] * root**2).T @ (whole[:, :-1] * root**2)
    assert np.allclose(found.covariance, found.sigma[0] ** 2 * inverse @ noise @ inverse, rtol=1e-6)
    assert "data 4.48 s old have weight 1/e" in found.notes


def test_it_is_constant_in_size_however_long_it_goes_on() -> None:
    information, _ = drifting(0.0, seconds=3 * MOST_WINDOWS_APART)
    kept = information.of(())
    for k in range(len(information.windows)):
        kept = after(kept, 1.0, information.of([k]))
        assert len(kept.windows) <= MOST_WINDOWS_APART
    found, wanted = Recursive()(information), WeightedLeastSquares()(information)
    assert np.allclose(found.parameters.values, wanted.parameters.values, rtol=1e-9)


def test_drift_is_followed() -> None:
    information, track = drifting(2.0)
    fading, stiff = Recursive(0.7), Recursive()
    for recursive, near in ((fading, True), (stiff, False)):
        values = np.empty(len(track))
        for number in range(len(track)):
            found = recursive(information.of(range(number + 1)))
            values[number] = found.parameters.values[-1]
        error = np.abs(values - track)[20:]
        assert (error.max() < 0.3) == near


@pytest.mark.slow
def test_intervals_hold_the_truth_where_nothing_drifts() -> None:
    inside = total = 0
    for seed in range(30):
        information, track = drifting(0.0, seed, 15)
        found = Recursive(0.8)(information)
        inside += int(np.sum(np.abs(found.parameters.values - track[0]) <= found.half_width))
        total += len(found.parameters)
    assert 0.92 < inside / total < 0.98
