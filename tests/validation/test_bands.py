"""Prediction bands: against a covariance by hand, and on motion that was not fitted."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from in_amperes import GAINS, RATE, ROBOT, run_of
from steelyard.estimation.calibration import Calibration
from steelyard.estimation.estimate import Standard
from steelyard.estimation.identified import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimation.least_squares import WeightedLeastSquares
from steelyard.measurement import Run
from steelyard.measurement.lowpass import low_pass
from steelyard.measurement.parts import apply
from steelyard.model import Model
from steelyard.parameters import Parameters
from steelyard.regression.gather import along, gather
from steelyard.regression.matched import MatchedFilter
from steelyard.regression.regressor import base_regressor
from steelyard.validation.bands import Bands
from steelyard.validation.score import RunScore, score
from steelyard.virtual.invent import random_truth
from steelyard.virtual.truth import Truth


@cache
def identified(seed: int = 0) -> tuple[IdentifiedModel, Truth]:
    """Weighted least squares of one run."""
    truth = random_truth(ROBOT, seed)
    run, regressor = run_of(truth, 100 + seed), base_regressor(Model(ROBOT))
    information = gather(regressor, run).scaled(GAINS, ["Nm"] * ROBOT.n)
    cutoffs = Cutoffs(run.motion_cutoff, run.matched_cutoff, run.matched_cutoff)
    estimate = WeightedLeastSquares()(information)
    origin = Provenance("0", {}, (), ())
    model = IdentifiedModel(
        regressor.model, regressor.base, estimate, (), run.recording.signals, cutoffs, origin
    )
    return model, truth


def scored(model: IdentifiedModel, run: Run, cutoff: float | None = None) -> RunScore:
    if cutoff is not None:
        model = replace(model, cutoffs=replace(model.cutoffs, score=cutoff))
    return score(model.valued, run, GAINS, model.cutoffs.score, bands=Bands.of(model))


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_the_band_holds_what_was_not_fitted(factor: float) -> None:
    inside = []
    for seed in range(4):
        model, truth = identified(seed)
        traces = scored(model, run_of(truth, 300 + seed), factor * model.cutoffs.matched).traces
        assert traces.band is not None
        inside.append(np.abs(traces.measured - traces.predicted) <= traces.band)
    share = np.mean(np.concatenate(inside))
    assert 0.90 <= share <= 0.99
    assert np.concatenate(inside).mean(axis=0).min() > 0.85


def test_the_model_s_own_band_holds_the_true_effort() -> None:
    inside = []
    for seed in range(4):
        model, truth = identified(seed)
        run = run_of(truth, 300 + seed)
        traces = scored(model, run).traces
        true = truth.model.at(truth.values)
        filtered = score(true, run, GAINS, model.cutoffs.score).traces
        assert traces.model_std is not None
        error = np.abs(filtered.predicted - traces.predicted)
        inside.append(error <= 1.96 * traces.model_std)
    assert 0.85 <= np.mean(np.concatenate(inside)) <= 0.99


def test_its_width_is_that_of_the_covariance() -> None:
    model, truth = identified()
    block = next(along(run_of(truth, 300).blocks(), model.model))
    dense = base_regressor(model.model).dense(block.q, block.dq, block.ddq)
    names = model.base.base_names
    seen = [names.index(name) for name in model.estimate.parameters.names]
    y = dense[:, :, seen]
    wanted = np.sqrt(np.einsum("jtp,pq,jtq->jt", y, model.estimate.covariance, y))
    bands = Bands.of(model)
    assert np.allclose(bands.model_std(block), wanted, rtol=1e-6, atol=1e-12)
    thinned = bands.model_std(block, 5)
    assert np.allclose(thinned[:, ::5], wanted[:, ::5], rtol=1e-6, atol=1e-12)
    assert np.abs(thinned - wanted).max() < 0.3 * wanted.max()


@pytest.mark.parametrize(("factor", "of_model"), [(3.0, 3.0), (0.5, 1.96)])
def test_a_calibration_does_not_make_parameters_surer(factor: float, of_model: float) -> None:
    """What left-out stretches of one motion show of noise says nothing of other motions."""
    model, truth = identified()
    block = next(along(run_of(truth, 300).blocks(), model.model))
    n = model.model.robot.n
    edges = np.tile([0.1, 0.5], (n, 1))
    calibration = Calibration("stretches", 5, edges, np.full((n, 4), factor))
    bands = Bands.of(replace(model, calibration=calibration))
    std = bands.model_std(block)
    found = bands.half_width(block, std)
    wanted = np.hypot(of_model * std, factor * bands.sigma[:, None])
    np.testing.assert_allclose(found, wanted, rtol=1e-4)


def test_standard_parameters_bring_their_prior_into_the_band() -> None:
    model, truth = identified()
    block = next(along(run_of(truth, 300).blocks(), model.model))
    values = model.model.prior.values.values if model.model.prior else np.zeros(0)
    covariance = np.diag(np.square(0.1 * np.abs(values) + 0.01))
    known = Standard(
        Parameters(model.model.names, model.model.units, values), covariance, np.zeros(len(values))
    )
    posterior = replace(model, estimate=replace(model.estimate, standard=known))
    std = Bands.of(posterior).model_std(block)
    base = model.base.lift @ covariance @ model.base.lift.T
    y = base_regressor(model.model).dense(block.q, block.dq, block.ddq)
    assert np.allclose(std, np.sqrt(np.einsum("jtp,pq,jtq->jt", y, base, y)), rtol=1e-6)


def test_the_residual_follows_the_filters_bandwidths() -> None:
    """White noise through both filters, against what the bands say of it."""
    model, _ = identified()
    noise = np.random.default_rng(0).standard_normal(400_000)
    for factor in (1.0, 3.0):
        cutoff = factor * model.cutoffs.matched
        matched = MatchedFilter.design(model.cutoffs.matched, RATE)
        before = np.convolve(noise, matched.taps, "valid").std()
        after = next(apply(low_pass(cutoff, RATE), [noise[None]], 500_000)).std()
        wider = replace(model, cutoffs=replace(model.cutoffs, score=cutoff))
        ratio = Bands.of(wider).sigma / model.estimate.sigma
        assert np.allclose(ratio, after / before, rtol=0.05)
    lower = replace(model, cutoffs=replace(model.cutoffs, score=0.2 * model.cutoffs.matched))
    assert np.array_equal(Bands.of(lower).sigma, model.estimate.sigma)


def test_bands_change_no_score_and_cost_no_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    model, truth = identified()
    run = run_of(truth, 300)
    plain = score(model.valued, run, GAINS, model.cutoffs.score)
    banded = scored(model, run)
    bare, known = plain.to_dict(), banded.to_dict()
    assert bare.pop("band_coverage_percent") is None
    assert 90.0 < known.pop("band_coverage_percent") < 99.0
    assert bare == known
    assert plain.traces.band is None
    assert np.array_equal(plain.traces.predicted, banded.traces.predicted)
    band = banded.traces.band
    assert band is not None and band.shape == banded.traces.measured.shape
    monkeypatch.setattr("steelyard.validation.traces.MOST_DRAWN", 500)
    thinned = scored(model, run).traces
    step = -(-len(band) // len(thinned.t))
    assert thinned.band is not None and len(thinned.band) == len(thinned.t) <= 500
    assert np.array_equal(thinned.band[1], band[np.flatnonzero(banded.traces.t == thinned.t[1])[0]])
    assert step > 1


def test_a_joint_without_samples_has_no_band() -> None:
    model, truth = identified()
    counts = np.where(np.arange(ROBOT.n) == 2, 0.0, model.estimate.n_samples)
    still = replace(model, estimate=replace(model.estimate, n_samples=counts))
    run = run_of(truth, 300)
    traces, known = scored(still, run).traces, scored(model, run).traces
    assert traces.band is not None and known.band is not None
    assert np.isnan(traces.band[:, 2]).all()
    others = np.arange(ROBOT.n) != 2
    assert np.array_equal(traces.band[:, others], known.band[:, others])
