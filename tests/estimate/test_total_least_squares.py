"""Total least squares against NumPy's singular value decomposition."""

from dataclasses import replace

import numpy as np
import pytest

from drawn import motion_of, samples_of
from invented import single, tree
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.errors_in_variables import TotalLeastSquares
from steelyard.model.model import Model

SINGLE, TREE = base_regressor(Model(single())), base_regressor(Model(tree()))


def of_columns(columns: np.ndarray, effort: np.ndarray) -> Information:
    """Information of one row with any columns."""
    samples = samples_of(SINGLE, motion_of(1, len(columns), 0), effort[None])
    return replace(samples, rows=(np.column_stack([columns, effort]),)).information()


def test_it_is_the_smallest_singular_vector() -> None:
    rng = np.random.default_rng(0)
    p = len(SINGLE.layout.columns)
    columns = rng.normal(size=(300, p)) * np.logspace(0, 3, p)
    effort = columns @ rng.normal(size=p) + 30.0 * rng.normal(size=300)
    found = TotalLeastSquares()(of_columns(columns, effort))
    scale = np.linalg.norm(columns, axis=0), np.linalg.norm(effort)
    *_, vectors = np.linalg.svd(np.column_stack([columns / scale[0], effort / scale[1]]))
    wanted = -vectors[-1, :-1] / vectors[-1, -1] * scale[1] / scale[0]
    assert np.allclose(found.parameters.values, wanted, rtol=1e-8)


def test_noise_in_all_columns_alike_draws_it_nowhere() -> None:
    """Least squares is drawn towards zero; the intervals know how far off both may be."""
    p = len(SINGLE.layout.columns)
    inside, means = 0, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        exact = rng.normal(size=(2000, p))
        effort = exact @ np.ones(p)
        noisy = exact + 0.3 * rng.normal(size=exact.shape)
        share = 0.3 / np.sqrt(1.09)
        measured = effort + share / np.sqrt(1.0 - share**2) * np.sqrt(p) * rng.normal(size=2000)
        found = TotalLeastSquares()(of_columns(noisy, measured))
        inside += int(np.sum(np.abs(found.parameters.values - 1.0) < found.half_width))
        means.append(found.parameters.values.mean())
    assert np.mean(means) == pytest.approx(1.0, abs=0.02)
    assert 0.9 < inside / (40 * p) <= 0.99


def test_rows_are_weighted_by_their_noise() -> None:
    noise = np.array([0.01, 0.1, 1.0, 0.3])
    motion, rng = motion_of(4, 2000, 3), np.random.default_rng(1)
    truth = np.random.default_rng(7).normal(size=len(TREE.layout.columns))
    effort = TREE.dense(*motion) @ truth + noise[:, None] * rng.normal(size=(4, 2000))
    found = TotalLeastSquares()(samples_of(TREE, motion, effort).information())
    assert np.allclose(found.sigma, noise, rtol=0.1)
    assert np.all(np.abs(found.parameters.values - truth) < 5.0 * found.std)


def test_effort_that_columns_do_not_explain_has_no_solution() -> None:
    """Two columns nearly alike are made one by less change than the effort needs to vanish."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(500, len(SINGLE.layout.columns)))
    columns[:, 1] = columns[:, 0] + 1e-2 * columns[:, 1]
    effort = rng.normal(size=500)
    effort -= columns @ np.linalg.lstsq(columns, effort, rcond=None)[0]
    with pytest.raises(DataError, match="total least squares has no solution") as caught:
        TotalLeastSquares()(of_columns(columns, effort))
    assert "weighted least squares" in caught.value.fix
