"""Ridge regression against plain algebra and brute-force cross-validation."""

from dataclasses import replace

import numpy as np
import pytest

from drawn import motion_of, samples_of
from invented import tree
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.known_bounded_and_ridge import Ridge
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.model import Model

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
COLUMNS = REGRESSOR.layout.columns
NOISE = np.array([0.1, 1.0, 3.0, 2.0])


def nominal() -> np.ndarray:
    """Base parameters of the nominal bodies, without friction."""
    prior = MODEL.prior
    assert prior is not None
    return REGRESSOR.base.base_values(prior.values.values)


def data(
    truth: np.ndarray, seed: int = 0, count: int = 60, still: tuple[int, ...] = ()
) -> tuple[Information, np.ndarray, np.ndarray]:
    """Information, with what it was summed up from."""
    motion = motion_of(4, count, seed, still)
    dense = REGRESSOR.dense(*motion)
    rng = np.random.default_rng([seed, 1])
    effort = dense @ truth + NOISE[:, None] * rng.normal(size=(4, count))
    return samples_of(REGRESSOR, motion, effort).information(), dense, effort


def test_it_is_least_squares_with_rows_for_the_target() -> None:
    target = np.random.default_rng(3).normal(size=len(COLUMNS))
    information, dense, effort = data(target + 0.1)
    named = tuple(zip(COLUMNS, target.tolist(), strict=True))
    found = Ridge(named, "it", weight=0.02)(information)
    scale = 1.0 / WeightedLeastSquares()(information).sigma[:, None]
    stacked = (dense * scale[:, :, None]).reshape(-1, len(COLUMNS))
    lengths = np.linalg.norm(stacked, axis=0)
    rows = np.vstack([stacked, np.sqrt(0.02) * np.diag(lengths)])
    right = np.concatenate([(effort * scale).ravel(), np.sqrt(0.02) * lengths * target])
    wanted, *_ = np.linalg.lstsq(rows, right, rcond=None)
    assert np.allclose(found.parameters.values, wanted, rtol=1e-6, atol=1e-6)
    assert "shrunk towards it with weight 0.02 (given)" in found.notes


def test_the_weight_is_that_of_least_cross_validation() -> None:
    information, dense, effort = data(nominal())
    found = Ridge.nominal(REGRESSOR.base, default_knowledge(MODEL))(information)
    weight = float(found.notes[0].split("weight ")[1].split(" ")[0])
    scale = 1.0 / WeightedLeastSquares()(information).sigma[:, None]
    stacked = (dense * scale[:, :, None]).reshape(-1, len(COLUMNS))
    lengths = np.linalg.norm(stacked, axis=0)
    unit = stacked / lengths
    right = (effort * scale).ravel() - stacked @ nominal()

    def score(trial: float) -> float:
        hat = unit @ np.linalg.solve(unit.T @ unit + trial * np.eye(len(lengths)), unit.T)
        return float(np.sum((right - hat @ right) ** 2) / (len(right) - np.trace(hat)) ** 2)

    trials = np.geomspace(1e-6, 1e3, 400)
    best = min(score(trial) for trial in trials)
    assert score(weight) <= best * (1.0 + 1e-6)


def test_few_noisy_data_and_a_good_prior_beat_least_squares() -> None:
    errors = []
    for seed in range(10):
        information, dense, _ = data(nominal(), seed, 40)
        ridge = Ridge.nominal(REGRESSOR.base, default_knowledge(MODEL))
        for fit in (WeightedLeastSquares()(information), ridge(information)):
            error = dense @ (fit.parameters.values - nominal()) / NOISE[:, None]
            errors.append(np.sqrt(np.mean(np.square(error))))
    assert np.mean(errors[1::2]) < 0.7 * np.mean(errors[::2])


def test_much_data_leave_nothing_to_the_target() -> None:
    information, _, _ = data(np.random.default_rng(0).normal(size=len(COLUMNS)), count=20_000)
    found, free = Ridge()(information), WeightedLeastSquares()(information)
    assert np.all(np.abs(found.parameters.values - free.parameters.values) < free.std)
    assert found.learned is not None and found.learned.min() > 0.95


def test_what_blind_parameters_would_add_is_part_of_the_target() -> None:
    """With a great weight the torque of all nominal bodies remains, though some are blind."""
    information, dense, _ = data(nominal(), still=(3,), count=200)
    knowledge = default_knowledge(MODEL)
    towards = Ridge.nominal(REGRESSOR.base, knowledge)
    found = Ridge(towards.towards, towards.target, weight=1e6)(information)
    assert found.blind
    known = found.parameters.as_dict()
    values = np.array([known.get(name, 0.0) for name in COLUMNS])
    assert np.allclose(dense @ values, dense @ nominal(), atol=1e-3)
    assert found.learned is not None and found.learned.max() < 0.01


def test_without_priors_it_is_drawn_to_zero() -> None:
    knowledge = default_knowledge(MODEL)
    nothing = replace(knowledge, priors=(None,) * len(knowledge.bodies))
    assert Ridge.nominal(REGRESSOR.base, nothing).target == "zero"


def test_parameters_of_runs_are_not_drawn_anywhere() -> None:
    truth = nominal() + 5.0
    information, _, _ = data(truth, count=400)
    name = COLUMNS[-1]
    found = Ridge(weight=1e6, per_run=(name,))(information)
    (own,) = found.per_run
    assert abs(own.parameters[name]) > 1e-3
    others = found.parameters.values[:-1]
    assert np.abs(others).max() == pytest.approx(0.0, abs=1e-2)
