"""Parameters per run against a dense fit with one copy of their columns per run."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from invented import tree
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.normal_equations import Runs
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.model.model import Model

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
COLUMNS = REGRESSOR.layout.columns
LOCAL = tuple(n for n in COLUMNS if n.split(".")[0] in ("coulomb", "offset"))
PLACES = [COLUMNS.index(name) for name in LOCAL]
SHARED = [k for k in range(len(COLUMNS)) if k not in PLACES]
NOISE = np.array([0.01, 0.1, 1.0, 0.3])


@dataclass(frozen=True)
class OneRun:
    information: Information
    dense: np.ndarray
    effort: np.ndarray
    truth: np.ndarray


def one_run(
    seed: int,
    noise: np.ndarray = NOISE,
    *,
    still: dict[int, float] | None = None,
    drift: float = 1.0,
    count: int = 300,
) -> OneRun:
    """A run over random states; its own parameters differ from those of all other runs."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 4, count))
    for joint, position in (still or {}).items():
        q[joint], dq[joint], ddq[joint] = position, 0.0, 0.0
    truth = np.random.default_rng(99).normal(size=len(COLUMNS))
    truth[PLACES] += drift * rng.normal(size=len(PLACES))
    dense = REGRESSOR.dense(q, dq, ddq)
    effort = dense @ truth + noise[:, None] * rng.normal(size=(4, count))
    half = count // 2
    parts = [
        Accumulator(REGRESSOR)(Stretch(*(x[:, part] for x in (q, dq, ddq, effort))))
        for part in (slice(0, half), slice(half, None))
    ]
    information = Information(
        REGRESSOR.layout,
        Signature(MODEL.fingerprint, COLUMNS, ("Nm",) * 4, "none"),
        (Window(f"run{seed}", 0.0, 1.0), Window(f"run{seed}", 1.0, 2.0)),
        *(np.array([getattr(p, f) for p in parts]) for f in ("grams", "absolute", "counts")),
    )
    return OneRun(information, dense, effort, truth)


def together(runs: list[OneRun]) -> Information:
    """All runs, their windows interleaved."""
    whole = sum((r.information for r in runs[1:]), runs[0].information)
    count = len(whole.windows)
    return whole.of([*range(0, count, 2), *range(1, count, 2)])


@dataclass(frozen=True)
class Dense:
    """A fit of stacked rows, columns of single runs copied: shared ones first, then run by run."""

    values: np.ndarray
    covariance: np.ndarray
    sigma: np.ndarray
    factors: np.ndarray | None


def expanded(runs: list[OneRun]) -> tuple[np.ndarray, np.ndarray]:
    """Regressor `(4, N, p)` and effort `(4, N)` of all runs."""
    width = len(SHARED) + len(PLACES) * len(runs)
    blocks = []
    for k, run in enumerate(runs):
        block = np.zeros((*run.dense.shape[:2], width))
        block[:, :, : len(SHARED)] = run.dense[:, :, SHARED]
        start = len(SHARED) + k * len(PLACES)
        block[:, :, start : start + len(PLACES)] = run.dense[:, :, PLACES]
        blocks.append(block)
    return np.concatenate(blocks, axis=1), np.concatenate([r.effort for r in runs], axis=1)


def dense_fit(runs: list[OneRun], weighted: bool) -> Dense:
    matrix, effort = expanded(runs)
    variances = (effort**2).mean(axis=1) if weighted else np.ones(4)
    for _ in range(50 if weighted else 1):
        root = 1.0 / np.sqrt(variances)
        stacked = (matrix * root[:, None, None]).reshape(-1, matrix.shape[2])
        values = np.linalg.lstsq(stacked, (effort * root[:, None]).ravel(), rcond=None)[0]
        inverse = np.linalg.inv(stacked.T @ stacked)
        used = np.sum((matrix @ inverse) * matrix, axis=(1, 2)) / variances
        squares = ((effort - matrix @ values) ** 2).sum(axis=1)
        variances = squares / (effort.shape[1] - used)
    sigma = np.sqrt(variances)
    factors = dense_factors(matrix, effort, values, inverse, sigma) if weighted else None
    noise = factors if weighted else variances * dense_fit(runs, True).factors
    meat = (stacked.T * np.repeat(noise, effort.shape[1])) @ stacked
    return Dense(values, inverse @ meat @ inverse, sigma, factors)


def dense_factors(
    matrix: np.ndarray,
    effort: np.ndarray,
    values: np.ndarray,
    inverse: np.ndarray,
    sigma: np.ndarray,
    window: int = 150,
) -> np.ndarray:
    """How much more the scores of windows scatter than white noise would have them, per row."""
    factors = []
    for row in range(4):
        found = expected = 0.0
        for start in range(0, effort.shape[1], window):
            part = matrix[row, start : start + window] / sigma[row]
            residual = effort[row, start : start + window] / sigma[row] - part @ values
            hat = part @ inverse @ part.T
            found += residual @ hat @ residual
            expected += np.trace(hat @ (np.eye(len(hat)) - hat))
        factors.append(max(found / expected, 1.0))
    return np.array(factors)


def shared_of(estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
    place = [estimate.parameters.names.index(COLUMNS[k]) for k in SHARED]
    return estimate.parameters.values[place], estimate.covariance[np.ix_(place, place)]


ESTIMATORS = {
    "ordinary": OrdinaryLeastSquares(per_run=LOCAL),
    "weighted": WeightedLeastSquares(rounds=200, tolerance=1e-14, per_run=LOCAL),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(ESTIMATORS))
def test_it_is_the_dense_fit_with_a_copy_per_run(kind: str) -> None:
    runs = [one_run(k) for k in range(3)]
    estimate = ESTIMATORS[kind](together(runs))
    wanted = dense_fit(runs, kind == "weighted")
    values, covariance = shared_of(estimate)
    size = len(SHARED)
    np.testing.assert_allclose(values, wanted.values[:size], rtol=1e-8, atol=1e-9)
    scale = np.sqrt(np.diag(wanted.covariance))[:size]
    difference = (covariance - wanted.covariance[:size, :size]) / scale[:, None] / scale
    assert np.abs(difference).max() < 1e-8
    np.testing.assert_allclose(estimate.sigma, wanted.sigma, rtol=1e-9)
    assert [own.run for own in estimate.per_run] == ["run0", "run1", "run2"]
    for k, own in enumerate(estimate.per_run):
        mine = slice(size + k * len(LOCAL), size + (k + 1) * len(LOCAL))
        assert own.parameters.names == LOCAL
        np.testing.assert_allclose(own.parameters.values, wanted.values[mine], rtol=1e-8, atol=1e-9)
        deviation = np.sqrt(np.diag(wanted.covariance))[mine]
        np.testing.assert_allclose(own.std, deviation, rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(ESTIMATORS))
def test_a_new_run_is_expected_to_have_their_mean(kind: str) -> None:
    estimate = ESTIMATORS[kind](together([one_run(k) for k in range(4)]))
    assert estimate.parameters.names == COLUMNS
    found = np.array([own.parameters.values for own in estimate.per_run])
    place = [estimate.parameters.names.index(name) for name in LOCAL]
    np.testing.assert_allclose(estimate.parameters.values[place], found.mean(axis=0))
    np.testing.assert_allclose(np.diag(estimate.covariance)[place], found.var(axis=0, ddof=1))
    np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)


@pytest.mark.parametrize("kind", list(ESTIMATORS))
def test_one_run_alone_is_the_plain_fit(kind: str) -> None:
    run = one_run(0).information
    plain, own = replace(ESTIMATORS[kind], per_run=())(run), ESTIMATORS[kind](run)
    np.testing.assert_allclose(own.parameters.values, plain.parameters.values, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(own.std, plain.std, rtol=1e-8)
    np.testing.assert_allclose(own.sigma, plain.sigma, rtol=1e-9)
    assert len(own.per_run) == 1 and plain.per_run == ()


@pytest.mark.parametrize("kind", list(ESTIMATORS))
def test_intervals_of_single_runs_hold_their_truth(kind: str) -> None:
    inside, total = 0, 0
    estimator = type(ESTIMATORS[kind])(per_run=LOCAL)
    for draw in range(20):
        runs = [one_run(2 * draw + k, count=120) for k in range(2)]
        for run, own in zip(runs, estimator(together(runs)).per_run, strict=True):
            error = np.abs(own.parameters.values - run.truth[PLACES])
            inside += int(np.sum(error <= 1.959964 * own.std))
            total += len(error)
    assert 0.91 < inside / total < 0.98


@pytest.mark.slow
def test_exact_data_give_every_run_its_own() -> None:
    runs = [one_run(k, np.zeros(4)) for k in range(3)]
    estimate = ESTIMATORS["weighted"](together(runs))
    values, _ = shared_of(estimate)
    assert np.abs(values - runs[0].truth[SHARED]).max() < 1e-7
    for run, own in zip(runs, estimate.per_run, strict=True):
        assert np.abs(own.parameters.values - run.truth[PLACES]).max() < 1e-7
    shared = replace(ESTIMATORS["weighted"], per_run=())(together(runs))
    assert shared.sigma.max() > 0.1 > 1e-5 > estimate.sigma.max()


def test_a_run_that_does_not_see_a_column_has_none() -> None:
    runs = [one_run(0), one_run(1, still={3: 0.4}), one_run(2)]
    estimate = ESTIMATORS["weighted"](together(runs))
    unseen = "coulomb.tip_joint"
    has = [unseen in own.parameters.names for own in estimate.per_run]
    assert has == [True, False, True]
    found = [own.parameters[unseen] for own in (estimate.per_run[0], estimate.per_run[2])]
    assert estimate.parameters[unseen] == pytest.approx(np.mean(found))
    assert unseen not in [b.name for b in estimate.blind]


def test_a_column_that_no_run_sees_is_blind() -> None:
    runs = [one_run(k, still={3: 0.4 + 0.3 * k}) for k in range(2)]
    estimate = ESTIMATORS["weighted"](together(runs))
    blind = [b.name for b in estimate.blind]
    assert "coulomb.tip_joint" in blind
    assert sorted([*blind, *estimate.parameters.names]) == sorted(COLUMNS)


def test_what_own_parameters_take_away_is_not_seen() -> None:
    """At rest in another posture each, a run's own offset hides what gravity would show."""
    runs = [one_run(k, still={0: 0.3 - k, 1: 0.1 * k, 2: 0.2 + 0.5 * k}) for k in range(2)]
    estimate = OrdinaryLeastSquares(per_run=LOCAL)(together(runs))
    matrix, _ = expanded(runs)
    stacked = matrix.reshape(-1, matrix.shape[2])
    unit = stacked / np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    rank = np.linalg.matrix_rank(unit, tol=1e-6 * np.sqrt(len(unit)))
    own = sum(len(part.parameters) for part in estimate.per_run)
    shared = [n for n in estimate.parameters.names if n not in LOCAL]
    assert len(shared) + own == rank
    assert np.all(np.abs(estimate.parameters.values) < 100.0)
    hidden = {b.name: b.tied_to for b in estimate.blind}
    assert any(set(tied) & set(LOCAL) for tied in hidden.values())


def test_without_any_nothing_changes() -> None:
    information = together([one_run(k, drift=0.0) for k in range(2)])
    for kind in (OrdinaryLeastSquares, WeightedLeastSquares):
        estimate = kind()(information)
        assert estimate.per_run == () and estimate.parameters.names == COLUMNS
    runs = Runs.of(information, ())
    assert runs.runs == (information,) and runs.local == ()
    matrix, vector, _, squares = runs.normal(np.ones(4))
    np.testing.assert_allclose(matrix, information.normal()[0], rtol=1e-14, atol=1e-12)
    np.testing.assert_array_equal(vector, information.normal()[1])
    np.testing.assert_array_equal(squares, np.diag(information.normal()[0]))


def test_round_trip_is_exact() -> None:
    estimate = ESTIMATORS["weighted"](together([one_run(k) for k in range(2)]))
    text = json.dumps(estimate.to_dict())
    again = Estimate.from_dict(json.loads(text))
    assert json.dumps(again.to_dict()) == text
    for mine, theirs in zip(estimate.per_run, again.per_run, strict=True):
        assert (mine.run, mine.parameters.names) == (theirs.run, theirs.parameters.names)
        np.testing.assert_array_equal(mine.parameters.values, theirs.parameters.values)
        np.testing.assert_array_equal(mine.std, theirs.std)
