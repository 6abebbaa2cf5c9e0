"""Reweighted least squares against SciPy's, outliers, and intervals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from drawn import motion_of, samples_of
from invented import single, tree
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    Huber,
    OrdinaryLeastSquares,
    Reweighted,
    Tukey,
    WeightedLeastSquares,
    residuals_of,
)
from steelyard.model.model import Model

TREE, SINGLE = base_regressor(Model(tree())), base_regressor(Model(single()))
NOISE = {TREE: np.array([0.01, 0.1, 1.0, 0.3]), SINGLE: np.array([0.1])}
LOSSES = [Huber(), Tukey()]

ids = pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: type(loss).__name__)


def drawn(
    regressor: Regressor, seed: int = 0, count: int = 600, outliers: float = 0.05, **more: object
) -> tuple[FilteredSamples, np.ndarray]:
    """Samples, some of them with twenty times the noise, and the truth."""
    n, p = len(regressor.layout.rows), len(regressor.layout.columns)
    rng = np.random.default_rng([seed, 1])
    motion, truth = motion_of(n, count, seed), np.random.default_rng(7).normal(size=p)
    size = np.where(rng.uniform(size=(n, count)) < outliers, 20.0, 1.0)
    noise = NOISE[regressor][:, None] * size * rng.normal(size=(n, count))
    effort = regressor.dense(*motion) @ truth + noise
    return samples_of(regressor, motion, effort, **more), truth  # type: ignore[arg-type]


@ids
def test_one_row_equals_scipy_s_with_the_same_scale(loss: Huber | Tukey) -> None:
    samples, _ = drawn(SINGLE)
    found = Reweighted(loss, OrdinaryLeastSquares(), tolerance=1e-9, rounds=500)(samples)
    (matrix,), scale = samples.rows, found.sigma[0]

    def tukey(z: np.ndarray) -> np.ndarray:
        v = np.minimum(z, 1.0)
        inside = z < 1.0
        value = (1.0 - (1.0 - v) ** 3) / 3.0
        return np.array([value, inside * (1.0 - v) ** 2, inside * -2.0 * (1.0 - v)])

    robust = "huber" if isinstance(loss, Huber) else tukey
    limit = loss.k if isinstance(loss, Huber) else loss.c
    wanted = least_squares(
        lambda x: matrix[:, -1] - matrix[:, :-1] @ x,
        found.parameters.values + 1e-3,
        jac=lambda x: -matrix[:, :-1],
        loss=robust,
        f_scale=limit * scale,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-13,
        max_nfev=500,
    )
    assert np.abs(found.parameters.values - wanted.x).max() < 1e-4 * found.std.min()
    residuals = np.abs(matrix[:, -1] - matrix[:, :-1] @ found.parameters.values)
    assert scale == pytest.approx(np.median(residuals) / 0.6744897501960817)


@pytest.mark.slow
@ids
def test_scores_of_all_rows_add_up_to_nothing(loss: Huber | Tukey) -> None:
    samples, _ = drawn(TREE)
    found = Reweighted(loss, OrdinaryLeastSquares(), tolerance=1e-10, rounds=500)(samples)
    p = len(TREE.layout.columns)
    total, size = np.zeros(p), np.zeros(p)
    for row, seen, r, s in zip(
        samples.rows, TREE.layout.sees, residuals_of(samples, found), found.sigma, strict=True
    ):
        score = row[:, :-1] * (loss.weight(r / s) * r)[:, None]
        total[list(seen)] += score.sum(axis=0)
        size[list(seen)] += np.abs(score).sum(axis=0)
    assert np.abs(total / size).max() < 1e-6


@ids
@pytest.mark.parametrize("u", [0.0, 0.5, 1.3, 2.0, 4.0, 6.0])
def test_curvature_is_the_slope_of_the_score(loss: Huber | Tukey, u: float) -> None:
    score = [loss.weight(np.array([x])) * x for x in (u - 1e-6, u + 1e-6)]
    assert (score[1] - score[0]) / 2e-6 == pytest.approx(loss.curvature(np.array([u])), abs=1e-5)


@pytest.mark.slow
@ids
def test_outliers_hardly_matter(loss: Huber | Tukey) -> None:
    errors = []
    for seed in range(3):
        samples, truth = drawn(TREE, seed)
        for fit in (WeightedLeastSquares()(samples.information()), Reweighted(loss)(samples)):
            errors.append(np.sqrt(np.mean(np.square(fit.parameters.values - truth))))
    plain, robust = np.mean(errors[::2]), np.mean(errors[1::2])
    assert robust < 0.4 * plain


@pytest.mark.slow
@ids
@pytest.mark.parametrize("outliers", [0.0, 0.05])
def test_intervals_hold_the_truth(loss: Huber | Tukey, outliers: float) -> None:
    inside = total = 0
    for seed in range(10):
        samples, truth = drawn(SINGLE, seed, 300, outliers)
        found = Reweighted(loss)(samples)
        inside += int(np.sum(np.abs(found.parameters.values - truth) <= found.half_width))
        total += len(truth)
    assert 0.90 < inside / total < 0.99


@pytest.mark.slow
def test_samples_alike_count_for_what_they_are_worth() -> None:
    whole, half = (Reweighted()(drawn(TREE, share=share)[0]) for share in (1.0, 0.5))
    assert np.allclose(half.std / whole.std, np.sqrt(2.0), rtol=0.1)
    assert np.allclose(half.n_samples, 0.5 * whole.n_samples)


def test_what_did_not_converge_says_so() -> None:
    samples, _ = drawn(TREE)
    assert any("not converged after 2 rounds" in n for n in Reweighted(rounds=2)(samples).notes)
    assert any(n.startswith("converged after") for n in Reweighted()(samples).notes)


@pytest.mark.slow
def test_each_run_keeps_its_own_parameters() -> None:
    name = TREE.layout.columns[-1]
    inner = WeightedLeastSquares(per_run=(name,))
    first, truth = drawn(TREE, 0, run="a")
    second, _ = drawn(TREE, 1, run="b")
    row = next(r for r, seen in enumerate(TREE.layout.sees) if len(truth) - 1 in seen)
    column = TREE.layout.sees[row].index(len(truth) - 1)
    rows = list(second.rows)
    rows[row] = rows[row].copy()
    rows[row][:, -1] += 0.7 * rows[row][:, column]
    both = first + replace(second, rows=tuple(rows))
    found = Reweighted(Huber(), inner)(both)
    own = {one.run: one.parameters[name] for one in found.per_run}
    assert own["b"] - own["a"] == pytest.approx(0.7, abs=0.2)
    assert np.sqrt(np.mean(np.square(found.parameters.values[:-1] - truth[:-1]))) < 0.05
