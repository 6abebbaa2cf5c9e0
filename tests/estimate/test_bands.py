"""Prediction bands: against a covariance by hand, and on motion that was not fitted."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from in_amperes import GAINS, RATE, ROBOT, run_of
from steelyard.base.arrays import Parameters
from steelyard.estimate.covariance_and_band_widths import Calibration
from steelyard.estimate.estimate import StandardEstimate
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.gather import blocks_with_channels, gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.scores.parts_and_bands_along_run import Bands
from steelyard.estimate.scores.score import RunScore, score
from steelyard.model.model import Model
from steelyard.runs.run import Block, Run
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import apply, low_pass
from steelyard.simulate.ground_truth import Truth, random_truth


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


def whole(run: Run) -> Run:
    """With its rests: no samples around it."""
    everywhere = (-np.inf, np.inf)
    return replace(run, span=everywhere, judged=replace(run.judged, span=everywhere))


def scored(model: IdentifiedModel, run: Run, cutoff: float | None = None) -> RunScore:
    if cutoff is not None:
        model = replace(model, cutoffs=replace(model.cutoffs, score=cutoff))
    return score(model.valued, run, GAINS, model.cutoffs.score, bands=Bands.of(model))


@pytest.mark.slow
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


def filtered_columns(model: IdentifiedModel, run: Run) -> np.ndarray:
    """All base columns of a run of one segment, low-passed by SciPy, shape `(n, N, p)`."""
    blocks = list(blocks_with_channels(run.blocks(), model.model))
    assert len({block.segment for block in blocks}) == 1
    block = Block.joined(blocks)
    dense = base_regressor(model.model).dense(block.q, block.dq, block.ddq)
    sections = butter(4, model.cutoffs.score, fs=run.rate, output="sos")
    return np.asarray(sosfiltfilt(sections, dense, axis=1, padlen=dense.shape[1] - 1))


def width(y: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard deviations of rows times parameters, shape `(N, n)`."""
    return np.sqrt(np.einsum("jtp,pq,jtq->tj", y, covariance, y))


@pytest.mark.slow
def test_its_width_is_that_of_the_filtered_columns() -> None:
    model, truth = identified()
    run = whole(run_of(truth, 300))
    names = model.base.base_names
    seen = [names.index(name) for name in model.estimate.parameters.names]
    y = filtered_columns(model, run)[:, :, seen]
    wanted = width(y, model.estimate.covariance)
    found = scored(model, run).traces.model_std
    assert found is not None
    found = found * np.abs(GAINS)
    step = int(run.rate / (4.0 * model.cutoffs.score))
    assert step > 1
    # SciPy begins its passes anew at the ends, which the padding makes small
    inner = slice(20 * step, -20 * step, step)
    assert np.allclose(found[inner], wanted[inner], rtol=1e-4, atol=1e-5 * wanted.max())
    assert np.abs(found - wanted).max() < 0.2 * wanted.max()


def test_what_the_low_pass_takes_out_is_not_in_the_band() -> None:
    """Noise of accelerations above the cut-off widens nothing."""
    model, truth = identified()
    blocks = list(blocks_with_channels(run_of(truth, 300).blocks(), model.model))
    block = Block.joined(blocks)
    shaken = replace(block, ddq=block.ddq + 500.0 * np.cos(np.pi * np.arange(len(block.t))))
    bands = Bands.of(model)
    std_of = bands.std_behind(model.cutoffs.score, RATE)
    std = [np.concatenate(list(apply(std_of, [bands.columns(b)])), axis=1) for b in (block, shaken)]
    inner = slice(500, -500)
    assert np.allclose(std[1][:, inner], std[0][:, inner], rtol=1e-3)


@pytest.mark.slow
def test_parts_of_any_size_give_the_same_band() -> None:
    model, truth = identified()
    block = Block.joined(list(blocks_with_channels(run_of(truth, 300).blocks(), model.model)))
    bands, count = Bands.of(model), len(block.t)
    std_of, known = bands.std_behind(model.cutoffs.score, RATE), []
    for size in (count, 7, 301):
        parts = [block.part(k, min(k + size, count)) for k in range(0, count, size)]
        known.append(np.concatenate(list(apply(std_of, map(bands.columns, parts))), axis=1))
    assert known[0].shape == (ROBOT.n, count)
    for other in known[1:]:
        assert np.allclose(other, known[0], rtol=1e-9)


@pytest.mark.parametrize(("factor", "of_model"), [(3.0, 3.0), (0.5, 1.96)])
def test_a_calibration_does_not_make_parameters_surer(factor: float, of_model: float) -> None:
    """What left-out stretches of one motion show of noise says nothing of other motions."""
    model, truth = identified()
    block = next(blocks_with_channels(run_of(truth, 300).blocks(), model.model))
    n = model.model.robot.n
    edges = np.tile([0.1, 0.5], (n, 1))
    calibration = Calibration("stretches", 5, edges, np.full((n, 4), factor))
    bands = Bands.of(replace(model, calibration=calibration))
    std = np.linspace(0.0, 5.0, n * len(block.t)).reshape(n, -1)
    found = bands.half_width(block.dq, block.moving, std)
    wanted = np.hypot(of_model * std, factor * bands.sigma[:, None])
    np.testing.assert_allclose(found, wanted, rtol=1e-4)


def test_standard_parameters_bring_their_prior_into_the_band() -> None:
    model, truth = identified()
    run = whole(run_of(truth, 300))
    values = model.model.prior.values.values if model.model.prior else np.zeros(0)
    covariance = np.diag(np.square(0.1 * np.abs(values) + 0.01))
    known = StandardEstimate(
        Parameters(model.model.names, model.model.units, values), covariance, np.zeros(len(values))
    )
    posterior = replace(model, estimate=replace(model.estimate, standard=known))
    std = scored(posterior, run).traces.model_std
    assert std is not None
    std = std * np.abs(GAINS)
    wanted = width(filtered_columns(model, run), model.base.lift @ covariance @ model.base.lift.T)
    step = int(run.rate / (4.0 * model.cutoffs.score))
    inner = slice(20 * step, -20 * step, step)
    assert np.allclose(std[inner], wanted[inner], rtol=1e-4, atol=1e-5 * wanted.max())


def test_the_residual_follows_the_filters_bandwidths() -> None:
    """White noise through both filters, against what the bands say of it."""
    model, _ = identified()
    noise = np.random.default_rng(0).standard_normal(400_000)
    for factor in (1.0, 3.0):
        cutoff = factor * model.cutoffs.matched
        matched = ParallelFilter.design(model.cutoffs.matched, RATE)
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
    monkeypatch.setattr("steelyard.estimate.scores.score.MOST_DRAWN", 500)
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
