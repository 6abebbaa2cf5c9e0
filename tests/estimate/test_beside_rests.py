"""What samples beside rests move: found where they err, not counted where chance explains it."""

from dataclasses import replace

import numpy as np
import pytest

from invented import tree
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.covariance_from_residuals import (
    away,
    inflations,
    moved_scores,
    scatter,
)
from steelyard.estimate.least_squares.known_bounded_and_ridge import Ridge
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.model import Model

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
COLUMNS = REGRESSOR.layout.columns
FRICTION = [k for k, name in enumerate(COLUMNS) if name.startswith("coulomb")]
TRUTH = REGRESSOR.base.base_values([0.4 if p.prior is None else p.prior for p in MODEL.parameters])


def information_of(
    seed: int, error: float, noise: float = 0.05, share: float = 0.15
) -> Information:
    """A drawn motion; in a share of the samples all friction is so much larger than it is.

    Args:
        seed: Of motion and noise.
        error: Part of Coulomb friction that is added beside rests.
        noise: Relative to each joint's torque.
        share: Samples beside rests.
    """
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 4, 1600))
    dense, beside = REGRESSOR.dense(q, dq, ddq), rng.random(1600) < share
    torque = dense @ TRUTH
    more = dense[:, :, FRICTION] @ TRUTH[FRICTION]
    size = noise * np.sqrt(np.square(torque).mean(axis=1, keepdims=True))
    effort = torque + error * beside * more + size * rng.normal(size=torque.shape)
    found = []
    for first in range(0, 1600, 200):
        cut = np.arange(first, first + 200)
        whole, part = (
            Accumulator(REGRESSOR)(Stretch(*(x[:, k].copy() for x in (q, dq, ddq, effort))))
            for k in (cut, cut[beside[cut]])
        )
        found.append((whole.grams, whole.absolute, whole.counts, part.grams))
    signature = Signature(MODEL.fingerprint, COLUMNS, ("Nm",) * 4, "none")
    windows = tuple(Window("run", float(k), k + 1.0) for k in range(8))
    return Information(
        REGRESSOR.layout, signature, windows, *map(np.array, zip(*found, strict=True))
    )


ESTIMATORS = (
    OrdinaryLeastSquares(),
    WeightedLeastSquares(),
    Ridge(),
    Consistent(REGRESSOR.base, default_knowledge(MODEL)),
    Consistent(REGRESSOR.base, default_knowledge(MODEL), equal=True),
)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_intervals_hold_the_error_and_the_estimate_stays(
    estimator: Estimator[Information],
) -> None:
    inside, narrow = [], []
    for seed in range(5):
        information = information_of(seed, 0.4)
        found, unaware = estimator(information), estimator(replace(information, beside=None))
        assert np.array_equal(found.parameters.values, unaware.parameters.values)
        place = [found.parameters.names.index(COLUMNS[k]) for k in FRICTION]
        error = np.abs(found.parameters.values[place] - TRUTH[FRICTION])
        inside += (error <= found.half_width[place]).tolist()
        narrow += (error <= unaware.half_width[place]).tolist()
    assert np.mean(inside) >= 0.8
    assert np.mean(narrow) < 0.5


def test_what_chance_explains_is_not_counted() -> None:
    ratios, inside = [], []
    for seed in range(12):
        information = information_of(seed, 0.0)
        found, plain = (
            WeightedLeastSquares()(x) for x in (information, replace(information, beside=None))
        )
        ratios += (found.std / plain.std).tolist()
        inside += (np.abs(found.parameters.values - TRUTH) <= found.half_width).tolist()
    assert 0.95 < np.median(ratios) < 1.1
    assert 0.92 <= np.mean(inside) <= 0.985


def test_without_noise_it_is_the_difference_to_a_fit_away_from_rests() -> None:
    information = information_of(0, 0.4, noise=1e-6)
    fit = WeightedLeastSquares().fit(information)
    part = away(fit)
    assert part is not None
    shift = part.values - fit.values
    scores = np.linalg.inv(fit.inverse) * 1e-6
    found = fit.inverse @ moved_scores(fit, 1.0 / fit.variances, scores)
    assert np.abs(found - shift).max() < 1e-3 * np.abs(shift).max()
    assert np.allclose(part.values, TRUTH, atol=1e-4 * np.abs(TRUTH).max())


def test_rests_that_count_are_beside_rests_too() -> None:
    """A law with memory is fitted at rest as well, where it may err as much as others."""
    rng = np.random.default_rng(0)
    signals = rng.normal(size=(4, 4, 200))
    rests = rng.random(200) < 0.3
    count = Accumulator(REGRESSOR)
    marked = count(Stretch(*signals, resting=np.tile(rests, (4, 1))))
    whole, part = (
        count(Stretch(*(x[:, k].copy() for x in signals))) for k in (rests | True, rests)
    )
    np.testing.assert_allclose(marked.grams, whole.grams, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(marked.beside, part.grams, rtol=1e-9, atol=1e-9)
    assert np.array_equal(marked.counts, whole.counts)


def test_where_all_is_beside_rests_nothing_is_reported() -> None:
    information = information_of(0, 0.4, share=1.0)
    fit = WeightedLeastSquares().fit(information)
    assert away(fit) is None
    assert np.array_equal(scatter(fit), inflations(fit))
    assert not moved_scores(fit, 1.0 / fit.variances, np.linalg.inv(fit.inverse)).any()


def test_a_direction_that_rounding_hides_is_none() -> None:
    """Weights of rows that differ by many powers of ten leave matrices that are hardly definite."""
    fit = WeightedLeastSquares().fit(information_of(0, 0.4))
    twice = replace(fit, kept=[*fit.kept, fit.kept[0]])
    assert away(twice) is None
    scores = np.eye(len(twice.kept))
    assert np.isfinite(moved_scores(twice, 1.0 / fit.variances, scores)).all()


def test_runs_with_friction_of_their_own_count_it_too() -> None:
    information = information_of(1, 0.4)
    names = tuple(replace(w, run=f"run{k // 4}") for k, w in enumerate(information.windows))
    split = replace(information, windows=names)
    own = tuple(COLUMNS[k] for k in FRICTION)
    found, unaware = (
        WeightedLeastSquares(per_run=own)(x) for x in (split, replace(split, beside=None))
    )
    assert np.array_equal(found.parameters.values, unaware.parameters.values)
    shared = [k for k, name in enumerate(found.parameters.names) if name not in own]
    assert np.median(found.std[shared] / unaware.std[shared]) > 0.5
