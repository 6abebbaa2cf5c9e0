"""Runs put together as one problem, against stacked regressors."""

from dataclasses import replace

import numpy as np
import pytest

from loaded import run
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.information.information import Information, Signature
from steelyard.estimate.payload.runs_with_payload import covariance_of, inverse, joined, marginal

RUNS = run(1, noise=0.1), run(2, noise=0.1)
SIZE = len(RUNS[0].layout.columns)


def parts() -> tuple[list[tuple[Information, Array]], int]:
    """Two runs that share all parameters but the first three, which are each run's own."""
    transforms = [np.zeros((SIZE, SIZE + 3)) for _ in RUNS]
    for k, transform in enumerate(transforms):
        transform[:, :SIZE] = np.eye(SIZE)
        if k:
            transform[:3] = 0.0
            transform[[0, 1, 2], [SIZE, SIZE + 1, SIZE + 2]] = 2.0
    return [(r, t) for r, t in zip(RUNS, transforms, strict=True)], SIZE + 3


def test_joined_runs_have_the_sums_of_mapped_columns() -> None:
    both, size = parts()
    names = [f"p{k}" for k in range(size)]
    found = joined(both, names, ["1"] * size)
    matrix, vector, square = found.normal(np.arange(1.0, 5.0))
    want = [part[0].normal(np.arange(1.0, 5.0)) for part in both]
    want_matrix = sum(t.T @ w[0] @ t for (_, t), w in zip(both, want, strict=True))
    want_vector = sum(t.T @ w[1] for (_, t), w in zip(both, want, strict=True))
    assert np.abs(matrix - want_matrix).max() < 1e-9 * np.abs(want_matrix).max()
    assert np.abs(vector - want_vector).max() < 1e-9 * np.abs(want_vector).max()
    assert np.isclose(square, sum(w[2] for w in want), rtol=1e-12)
    assert np.array_equal(found.n_samples, sum(r.n_samples for r in RUNS))
    assert found.layout.columns == tuple(names)
    assert [w.run for w in found.windows] == ["run1", "run2"]


def test_unequal_runs_are_refused() -> None:
    signature = Signature(**{**vars(RUNS[0].signature), "effort": ("Nm",) * 4})
    other = replace(RUNS[0], signature=signature)
    with pytest.raises(DataError, match="unequal effort"):
        joined(
            [(RUNS[0], np.eye(SIZE)), (other, np.eye(SIZE))],
            ["x"] * SIZE,
            ["1"] * SIZE,
        )


def spread() -> np.ndarray:
    """Information about nine badly scaled parameters."""
    rows = np.random.default_rng(0).normal(size=(30, 9)) * 10.0 ** np.linspace(-3.0, 3.0, 9)
    return np.asarray(rows.T @ rows)


def test_inverse_and_marginal_are_those_of_numpy() -> None:
    matrix = spread()
    want = np.linalg.inv(matrix)
    assert np.abs(inverse(matrix) * matrix - want * matrix).max() < 1e-8
    chosen = [1, 4, 7]
    part = want[np.ix_(chosen, chosen)]
    assert np.abs(np.linalg.inv(marginal(matrix, chosen)) / part - 1.0).max() < 1e-7
    assert np.abs(covariance_of(matrix, chosen) / part - 1.0).max() < 1e-7


def test_unseen_parameters_have_no_covariance() -> None:
    """Columns 0 and 1 are one; 2 is zero; 3 stands alone."""
    columns = np.random.default_rng(1).normal(size=(50, 4))
    columns[:, 1], columns[:, 2] = -2.0 * columns[:, 0], 0.0
    found = covariance_of(columns.T @ columns, range(4))
    assert np.array_equal(np.isnan(np.diag(found)), [True, True, True, False])
    alone = columns[:, [0, 3]]
    want = np.linalg.inv(alone.T @ alone)[1, 1]
    assert np.isclose(found[3, 3], want, rtol=1e-9)
    values = inverse(columns.T @ columns) @ (columns.T @ columns @ [1.0, 0.0, 5.0, 3.0])
    assert np.isclose(values[0] - 2.0 * values[1], 1.0) and values[2] == 0.0
