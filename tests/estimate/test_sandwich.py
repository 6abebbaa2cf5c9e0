"""Scores of windows: against dense matrices, and against noise of known colour."""

from dataclasses import replace

import numpy as np
import pytest

from invented import tree
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.covariance_from_residuals import (
    honest_covariance,
    inflations,
    note_of,
    scatter,
    scores_of_windows,
)
from steelyard.estimate.least_squares.normal_equations import Fit, shared_map
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.model.model import Model

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
SIZES = np.array([0.01, 0.1, 1.0, 0.3])


def slow(rng: np.random.Generator, count: int, lag: float) -> np.ndarray:
    """First-order noise of unit size, shape `(4, count)`; white for a lag of zero samples."""
    keep = np.exp(-1.0 / lag) if lag else 0.0
    noise = rng.normal(size=(4, count))
    for k in range(1, count):
        noise[:, k] = keep * noise[:, k - 1] + np.sqrt(1.0 - keep**2) * noise[:, k]
    return noise


def data(
    seed: int, lag: float, windows: int = 8, count: int = 1600, fast: float = 0.0
) -> tuple[Information, np.ndarray, np.ndarray, np.ndarray]:
    """Information in windows, truth, regressor and effort of a slow motion."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / 40.0
    phases, rates = rng.uniform(0, 6, (2, 4, 3, 1)), rng.uniform(0.2, 1.5, (4, 3, 1))
    wave = rates * t + phases[0]
    q = np.sin(wave).sum(axis=1)
    dq, ddq = (rates * np.cos(wave)).sum(axis=1), -(rates**2 * np.sin(wave)).sum(axis=1)
    truth = rng.normal(size=len(REGRESSOR.layout.columns))
    dense = REGRESSOR.dense(q, dq, ddq)
    drawn = slow(rng, count, lag)
    drawn[:, 1:] -= fast * drawn[:, :-1]
    effort = dense @ truth + SIZES[:, None] * drawn
    edges = np.linspace(0, count, windows + 1).astype(int)
    sums = [
        Accumulator(REGRESSOR)(Stretch(*(x[:, a:b] for x in (q, dq, ddq, effort))))
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    information = Information(
        REGRESSOR.layout,
        Signature(MODEL.fingerprint, REGRESSOR.layout.columns, ("Nm",) * 4, "none"),
        tuple(Window("run", float(k), k + 1.0) for k in range(windows)),
        *(np.array([getattr(s, f) for s in sums]) for f in ("grams", "absolute", "counts")),
    )
    return information, truth, dense, effort


def scores_by_window(fit: Fit) -> np.ndarray:
    """Scores of the shared columns in every window, shape `(windows, k)`."""
    kept, found = fit.kept, dict[str, np.ndarray]()
    for own, _, columns, _, scores in scores_of_windows(fit, len(fit.data.whole.windows)):
        found.setdefault(own.run, np.zeros((len(scores), len(kept))))
        found[own.run] += scores @ shared_map(own, kept)[columns]
    return np.concatenate(list(found.values()))


def test_scores_of_windows_are_those_of_dense_matrices() -> None:
    information, _, dense, effort = data(0, 5.0)
    fit = WeightedLeastSquares(tolerance=1e-12).fit(information)
    scale = 1.0 / np.sqrt(fit.variances)
    rows = (dense * scale[:, None, None]).transpose(1, 0, 2)
    residuals = ((effort - dense @ fit.values) * scale[:, None]).T
    scores = np.array(
        [
            np.einsum("njp,nj->p", rows[a : a + 200], residuals[a : a + 200])
            for a in range(0, 1600, 200)
        ]
    )
    found = scores_by_window(fit)
    np.testing.assert_allclose(found, scores, atol=1e-6 * np.abs(scores).max())
    assert np.abs(found.sum(axis=0)).max() < 1e-6 * np.abs(scores).max()


def test_factors_are_those_of_dense_matrices() -> None:
    information, _, dense, effort = data(1, 5.0)
    fit = WeightedLeastSquares(tolerance=1e-12).fit(information)
    inverse, found = fit.inverse, inflations(fit)
    for row in range(4):
        squares = expected = 0.0
        for a in range(0, 1600, 200):
            part = dense[row, a : a + 200] / np.sqrt(fit.variances[row])
            left = effort[row, a : a + 200] / np.sqrt(fit.variances[row])
            left = left - part @ fit.values
            hat = part @ inverse @ part.T
            squares += left @ hat @ left
            expected += np.trace(hat) - np.sum(hat * hat)
        assert found[row] == pytest.approx(max(squares / expected, 1.0), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [WeightedLeastSquares(), OrdinaryLeastSquares()])
@pytest.mark.parametrize("lag", [0.0, 8.0])
def test_intervals_hold_whatever_the_noise(
    lag: float, estimator: WeightedLeastSquares | OrdinaryLeastSquares
) -> None:
    inside: list[bool] = []
    naive: list[bool] = []
    for seed in range(15):
        information, truth, _, _ = data(seed, lag)
        estimate = estimator(information)
        error = np.abs(estimate.parameters.values - truth)
        inside += (error <= estimate.half_width).tolist()
        # one window tells nothing, so that residuals are taken as white
        alone = estimator(information.merged(1))
        naive += (error <= alone.half_width).tolist()
    assert 0.90 <= np.mean(inside) <= 0.99
    assert np.mean(naive) < 0.55 if lag else np.mean(naive) > 0.9


def test_one_window_tells_nothing() -> None:
    information, *_ = data(0, 8.0, windows=1)
    fit = WeightedLeastSquares().fit(information)
    assert np.array_equal(inflations(fit), np.ones(4))


def test_chance_never_narrows_an_interval() -> None:
    for seed in range(10):
        fit = WeightedLeastSquares().fit(data(seed, 0.0)[0])
        assert inflations(fit).min() >= 1.0
        assert scatter(fit).min() > 0.6


@pytest.mark.slow
def test_noise_above_the_motion_narrows_intervals_that_still_hold() -> None:
    inside, ratios = [], []
    for seed in range(15):
        information, truth, _, _ = data(seed, 0.0, fast=0.9)
        fit, estimate = (
            WeightedLeastSquares().fit(information),
            WeightedLeastSquares()(information),
        )
        assert np.array_equal(inflations(fit), np.ones(4)) and scatter(fit).max() < 0.5
        inside += (np.abs(estimate.parameters.values - truth) <= estimate.half_width).tolist()
        alone = WeightedLeastSquares()(information.merged(1))
        ratios += (estimate.std / alone.std).tolist()
    assert 0.93 <= np.mean(inside) <= 0.99
    assert np.median(ratios) < 0.6


def test_many_runs_are_merged_so_that_the_cost_stays() -> None:
    information, *_ = data(2, 8.0, windows=100)
    few = information.merged(20)
    found, wanted = (inflations(WeightedLeastSquares().fit(i)) for i in (information, few))
    assert np.allclose(found, wanted, rtol=1e-4)


def test_a_prior_counts_as_much_as_it_says() -> None:
    information, *_ = data(3, 8.0)
    fit = WeightedLeastSquares().fit(information)
    precision = np.linalg.inv(fit.inverse)
    prior = 3.0 * precision
    inverse = np.linalg.inv(precision + prior)
    factors = inflations(fit)
    assert factors.max() > 2.0
    wider = np.diag(honest_covariance(fit, inverse, prior))
    assert np.all(wider >= np.diag(inverse))
    assert np.all(wider <= factors.max() * np.diag(inverse) * (1.0 + 1e-9))


def test_without_a_prior_it_is_the_estimate_s_own_covariance() -> None:
    information, *_ = data(4, 8.0)
    fit = WeightedLeastSquares().fit(information)
    estimate = WeightedLeastSquares()(information)
    found = honest_covariance(fit, fit.inverse)
    size = np.sqrt(np.diag(found))
    assert np.abs((found - estimate.covariance) / size[:, None] / size).max() < 1e-9


def test_wide_intervals_are_reported() -> None:
    estimate = WeightedLeastSquares()(data(5, 30.0)[0])
    assert len(estimate.notes) == 1
    assert "correlated for longer than the filter" in estimate.notes[0]
    assert note_of(("a", "b"), np.array([1.0, 16.0]))[0].endswith("wider: b x 4.0")
    assert WeightedLeastSquares()(data(5, 0.0)[0]).notes == ()


def test_runs_of_their_own_keep_their_windows() -> None:
    information, *_ = data(6, 8.0)
    names = [replace(w, run=f"run{k // 4}") for k, w in enumerate(information.windows)]
    split = replace(information, windows=tuple(names))
    own = tuple(n for n in REGRESSOR.layout.columns if n.startswith("coulomb"))
    assert own
    fit = WeightedLeastSquares(per_run=own).fit(split)
    assert inflations(fit).max() > 2.0
    assert scores_by_window(fit).shape == (8, len(fit.kept))


def runs_apart(seed: int, apart: float, count: int = 4) -> tuple[Information, np.ndarray]:
    """Runs of motions of their own whose parameters scatter around a common truth."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(size=len(REGRESSOR.layout.columns))
    parts = []
    for number in range(count):
        t = np.arange(800) / 40.0
        rates, phases = rng.uniform(0.2, 1.5, (4, 3, 1)), rng.uniform(0, 6, (4, 3, 1))
        wave = rates * t + phases
        q = np.sin(wave).sum(axis=1)
        dq, ddq = (rates * np.cos(wave)).sum(axis=1), -(rates**2 * np.sin(wave)).sum(axis=1)
        own = truth + apart * rng.normal(size=len(truth))
        effort = REGRESSOR.dense(q, dq, ddq) @ own + SIZES[:, None] * rng.normal(size=q.shape)
        cuts = [slice(a, a + 100) for a in range(0, 800, 100)]
        sums = [
            Accumulator(REGRESSOR)(Stretch(*(x[:, cut].copy() for x in (q, dq, ddq, effort))))
            for cut in cuts
        ]
        windows = tuple(Window(f"run{number}", float(k), k + 1.0) for k in range(len(cuts)))
        signature = Signature(MODEL.fingerprint, REGRESSOR.layout.columns, ("Nm",) * 4, "none")
        arrays = (np.array([getattr(s, f) for s in sums]) for f in ("grams", "absolute", "counts"))
        parts.append(Information(REGRESSOR.layout, signature, windows, *arrays))
    return sum(parts[1:], parts[0]), truth


@pytest.mark.slow
@pytest.mark.parametrize("apart", [0.0, 0.3])
def test_intervals_hold_where_runs_disagree(apart: float) -> None:
    inside: list[bool] = []
    of_windows: list[bool] = []
    for seed in range(12):
        information, truth = runs_apart(seed, apart)
        estimate = WeightedLeastSquares()(information)
        error = np.abs(estimate.parameters.values - truth)
        inside += (error <= estimate.half_width).tolist()
        one = [replace(w, run="one") for w in information.windows]
        joined = WeightedLeastSquares()(replace(information, windows=tuple(one)))
        of_windows += (error <= joined.half_width).tolist()
    assert 0.92 <= np.mean(inside) <= 0.99
    assert np.mean(of_windows) < 0.89 if apart else np.mean(of_windows) > 0.92
