"""Maximum likelihood with motion noise: slopes, bias, intervals, and least squares without it."""

from dataclasses import replace

import numpy as np
import pytest

from drawn import motion_of, samples_of
from invented import dh_arm, single
from steelyard.estimate.covariance_and_band_widths import covariance_root
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.least_squares.errors_in_variables import MotionNoise, slopes
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model

SMOOTH = base_regressor(Model(dh_arm(), (RigidBody(), Viscous())))
SINGLE = base_regressor(Model(single(), (RigidBody(), Viscous())))


def truth_of(regressor: Regressor) -> np.ndarray:
    model = regressor.model
    standard = [0.5 if p.prior is None else p.prior for p in model.parameters]
    return regressor.base.base_values(standard)


def noisy(seed: int, position: float, effort: float = 0.02, count: int = 800) -> FilteredSamples:
    """The arm, with noise on `q`, `dq` and `ddq` alike, and on the effort."""
    rng = np.random.default_rng([seed, 1])
    motion = motion_of(3, count, seed)
    tau = SMOOTH.dense(*motion) @ truth_of(SMOOTH) + effort * rng.normal(size=(3, count))
    measured = motion + position * rng.normal(size=motion.shape)
    return samples_of(SMOOTH, measured, tau, position=position)


def test_roots_make_up_the_covariance() -> None:
    rng = np.random.default_rng(0)
    half = rng.normal(size=(4, 3, 3)) * np.array([1e-6, 1e-3, 1.0])[:, None]
    covariance = half @ half.transpose(0, 2, 1)
    roots = covariance_root(covariance)
    assert np.allclose(roots @ roots.transpose(0, 2, 1), covariance, rtol=1e-9, atol=1e-30)


def test_variances_are_those_of_drawn_motions() -> None:
    samples, truth = noisy(0, 1e-3, count=5), truth_of(SMOOTH)
    root = covariance_root(np.diag([1e-6, 4e-6, 1e-4]) * np.ones((3, 1, 1)))
    variances, _ = slopes(SMOOTH, samples, [root], truth)
    rng = np.random.default_rng(0)
    for k in range(5):
        state = np.array([samples.q[k], samples.dq[k], samples.ddq[k]])[:, :, None]
        moved = state + np.array([1e-3, 2e-3, 1e-2])[:, None, None] * rng.normal(
            size=(3, 3, 20_000)
        )
        wanted = (SMOOTH.dense(*moved) @ truth).var(axis=1)
        mine = np.array([variance[k] for variance in variances])
        assert np.allclose(mine, wanted, rtol=0.05)


def test_bends_are_half_the_change_of_the_variances() -> None:
    samples, truth = noisy(0, 1e-3, count=7), truth_of(SMOOTH)
    roots = [covariance_root(np.eye(3) * np.full((3, 1, 1), 1e-4))]
    _, bends = slopes(SMOOTH, samples, roots, truth)
    for column in (0, 4, 9):
        step = np.zeros(len(truth))
        step[column] = 1e-4
        above, below = (slopes(SMOOTH, samples, roots, truth + s)[0] for s in (step, -step))
        for row, seen in enumerate(SMOOTH.layout.sees):
            change = (above[row] - below[row]) / 4e-4
            wanted = bends[row][:, seen.index(column)] if column in seen else 0.0
            assert np.allclose(change, wanted, rtol=1e-6, atol=1e-9)


def test_without_noise_of_the_motion_it_is_weighted_least_squares() -> None:
    samples = noisy(0, 1e-12)
    found = MotionNoise(SMOOTH)(samples)
    wanted = WeightedLeastSquares()(samples.information())
    assert np.all(np.abs(found.parameters.values - wanted.parameters.values) < 0.05 * wanted.std)
    assert np.allclose(found.std, wanted.std, rtol=0.2)
    assert np.allclose(found.sigma, wanted.sigma, rtol=0.02)


@pytest.mark.slow
def test_it_beats_least_squares_where_positions_are_noisy() -> None:
    plain, likely, inside, total = [], [], 0, 0
    for seed in range(10):
        samples, truth = noisy(seed, 0.05), truth_of(SMOOTH)
        found = MotionNoise(SMOOTH)(samples)
        free = WeightedLeastSquares()(samples.information())
        plain.append(np.square(free.parameters.values - truth))
        likely.append(np.square(found.parameters.values - truth))
        inside += int(np.sum(np.abs(found.parameters.values - truth) <= found.half_width))
        total += len(truth)
    assert np.sqrt(np.mean(likely)) < 0.8 * np.sqrt(np.mean(plain))
    assert 0.88 < inside / total < 0.99


def test_columns_of_noise_do_not_draw_it_towards_zero() -> None:
    """One joint, accelerations half noise: least squares halves the inertia."""
    truth = truth_of(SINGLE)
    place = [k for k, name in enumerate(SINGLE.layout.columns) if name.startswith(("I", "rotor"))]
    plain, likely = [], []
    for seed in range(8):
        motion, rng = motion_of(1, 3000, seed), np.random.default_rng([seed, 1])
        tau = SINGLE.dense(*motion) @ truth
        tau = tau + 0.01 * np.abs(tau).mean() * rng.normal(size=tau.shape)
        measured = motion + 0.4 * rng.normal(size=motion.shape) * np.array([0, 0, 1])[:, None, None]
        samples = samples_of(SINGLE, measured, tau, position=0.4)
        (source,) = samples.sources
        assert source.error is not None
        of_position = np.diag([0.0, 0.0, 1.0])[None]
        error = replace(source.error, of_position=of_position)
        samples = replace(samples, sources=(replace(source, error=error),))
        for found, kept in (
            (WeightedLeastSquares()(samples.information()), plain),
            (MotionNoise(SINGLE)(samples), likely),
        ):
            kept.append(found.parameters.values[place] / truth[place])
    assert np.mean(plain) < 0.9
    assert np.mean(likely) == pytest.approx(1.0, abs=0.03)


def test_the_share_of_the_motion_is_noted() -> None:
    notes = MotionNoise(SMOOTH)(noisy(0, 0.05)).notes
    assert any("share of the variance" in note for note in notes)


def test_what_did_not_converge_says_so() -> None:
    assert "not converged after 1 steps" in MotionNoise(SMOOTH, rounds=1)(noisy(0, 0.1)).notes


def test_parameters_of_runs_stay_as_least_squares_has_them() -> None:
    name = SMOOTH.layout.columns[-1]
    first, second = noisy(0, 0.02), noisy(1, 0.02)
    second = replace(second, sources=(replace(second.sources[0], run="other"),))
    found = MotionNoise(SMOOTH, per_run=(name,))(first + second)
    wanted = WeightedLeastSquares(per_run=(name,))((first + second).information())
    assert [one.parameters[name] for one in found.per_run] == [
        one.parameters[name] for one in wanted.per_run
    ]
    assert found.parameters[name] == wanted.parameters[name]
    assert not np.allclose(found.parameters.values[:-1], wanted.parameters.values[:-1], rtol=1e-6)
