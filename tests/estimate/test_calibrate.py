"""Bands calibrated on left-out motion: what is left out, the quantiles, and the coverage."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from in_amperes import GAINS, ROBOT, run_of
from steelyard.base.errors import DataError, LogError, ModelError, SteelyardError
from steelyard.estimate.covariance_and_band_widths import Calibration, bins
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.scores.cross_validation import runs_left_out, stretches_left_out
from steelyard.estimate.scores.parts_and_bands_along_run import Bands
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    calibrate,
    correlation_of,
    quantile,
    residual_trace,
)
from steelyard.estimate.scores.score import score
from steelyard.model.laws.friction_over_speed import Stribeck
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.model import Model
from steelyard.runs.processing_choices import Processing
from steelyard.runs.run import Run
from steelyard.simulate.ground_truth import random_truth

MODEL = Model(ROBOT)
CUTOFFS = Processing(motion_cutoff=17.0, matched_cutoff=5.5)


@cache
def runs_of(*seeds: int, terms: tuple = DEFAULT_TERMS) -> tuple[Run, ...]:
    """Runs of one truth, in amperes; the name says the seed and the place."""
    truth = random_truth(ROBOT, 7, terms=terms)
    return tuple(
        replace(run_of(truth, seed, wanted=CUTOFFS), name=f"{place}: {seed}")
        for place, seed in enumerate(seeds)
    )


def information_of(runs: tuple[Run, ...], longest: float = np.inf) -> Information:
    regressor, units = base_regressor(MODEL), ROBOT.effort_units
    parts = [gather(regressor, run, longest=longest).scaled(GAINS, units) for run in runs]
    return sum(parts[1:], parts[0])


def identified(runs: tuple[Run, ...]) -> IdentifiedModel:
    regressor = base_regressor(MODEL)
    return IdentifiedModel(
        MODEL,
        regressor.base,
        WeightedLeastSquares()(information_of(runs)),
        (),
        runs[0].recording.signals,
        Cutoffs(runs[0].motion_cutoff, runs[0].matched_cutoff, runs[0].matched_cutoff),
        Provenance("0", {}, (), ()),
    )


def calibrated(runs: tuple[Run, ...]) -> IdentifiedModel:
    model = identified(runs)
    found = calibrate(model, runs, information_of(runs), WeightedLeastSquares())
    return replace(model, calibration=found)


def coverage(model: IdentifiedModel, run: Run, slower: np.ndarray | None = None) -> float:
    """Share of the samples in their bands, of all or of slow ones [%]."""
    found = score(model.valued, run, GAINS, model.cutoffs.score, bands=Bands.of(model))
    traces = found.traces
    assert traces.speed is not None and found.coverage_percent is not None
    if slower is None:
        return found.coverage_percent
    inside = np.abs(traces.measured - traces.predicted) <= traces.band
    return 100.0 * float(inside[(traces.speed < slower) & traces.moving].mean())


@pytest.mark.slow
def test_friction_outside_the_model_widens_the_bands():
    terms = (*DEFAULT_TERMS, Stribeck(0.2))
    *fitted, unseen = runs_of(11, 12, 13, 14, terms=terms)
    model = calibrated(tuple(fitted))
    assert model.calibration is not None
    assert model.calibration.text == "calibrated on 3 left-out runs"
    edges = model.calibration.edges
    bare = replace(model, calibration=None)
    assert coverage(bare, unseen, slower=edges[:, 0]) < 85.0
    assert 92.5 <= coverage(model, unseen, slower=edges[:, 0]) <= 98.5
    assert 92.5 <= coverage(model, unseen) <= 98.5


@pytest.mark.slow
def test_where_the_model_is_right_the_bands_stay_as_wide_as_noise():
    *fitted, unseen = runs_of(21, 22, 23)
    model = calibrated(tuple(fitted))
    assert 93.0 <= coverage(model, unseen) <= 98.0
    assert model.calibration is not None
    # 1.96 for ever more samples; the quantile of few independent ones is higher
    assert 1.96 * 0.8 <= np.median(model.calibration.factors) <= 1.96 * 1.35


@pytest.mark.slow
def test_the_same_motion_again_is_left_out_with_it():
    runs = runs_of(31, 31, 32)
    information = information_of(runs)
    names = [
        {information.windows[k].run for k in one.fitted} for one in runs_left_out(runs, information)
    ]
    assert names == [{"2: 32"}, {"2: 32"}, {"0: 31", "1: 31"}]


@pytest.mark.slow
def test_runs_of_one_motion_alone_are_calibrated_on_stretches_of_it():
    runs = runs_of(41, 41)
    assert runs_left_out(runs, information_of(runs)) == ()
    information = information_of(runs, longest=0.5)
    for one in stretches_left_out(runs, information):
        length = one.span[1] - one.span[0]
        phases = [
            (0.5 * (w.start + w.stop) - one.span[0]) % 10.0
            for w in (information.windows[k] for k in one.fitted)
        ]
        assert phases and min(phases) > length - 0.5 and max(phases) < 10.0 + 0.5
    found = calibrated(runs).calibration
    assert found is not None and found.kind == "stretches" and found.count == 5


def test_speeds_fall_into_ranges():
    speed = np.array([[0.0, 0.1, -0.6, 3.0]])
    moving = np.array([[False, True, True, True]])
    assert bins(speed, moving, np.array([[0.5, 1.0]])).tolist() == [[0, 1, 2, 3]]
    some = Calibration("runs", 2, np.array([[0.5, 1.0]]), np.array([[4.0, 3.0, 2.0, 1.0]]))
    assert some.factor(speed, moving).tolist() == [[4.0, 3.0, 2.0, 1.0]]


def test_few_independent_samples_take_a_higher_quantile():
    sizes = np.linspace(0.0, 1.0, 1001)
    assert quantile(sizes, 1e9) == pytest.approx(0.95)
    assert quantile(sizes, 95.0) == pytest.approx(0.96)
    assert quantile(sizes, 3.0) == 1.0


def test_the_calibration_is_kept_with_the_model(tmp_path):
    model = calibrated(runs_of(21, 22))
    (tmp_path / "model.json").write_text(model.text(), encoding="utf-8")
    again = load_model(tmp_path).calibration
    assert again is not None and model.calibration is not None
    assert np.array_equal(again.factors, model.calibration.factors)
    assert np.array_equal(again.edges, model.calibration.edges)
    damaged = model.text().replace('"left_out": "runs"', '"left_out": "days"')
    (tmp_path / "model.json").write_text(damaged, encoding="utf-8")
    with pytest.raises(ModelError, match="days"):
        load_model(tmp_path)


def test_the_correlation_of_errors_between_joints_is_found() -> None:
    true = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 1.0]])
    errors = np.linalg.cholesky(true) @ np.random.default_rng(0).standard_normal((3, 20_000))
    worth = np.ones(20_000)
    errors[0, ::3] = np.nan
    assert np.allclose(correlation_of(errors, worth), true, atol=0.03)
    few = correlation_of(errors[:, 1:3], worth[1:3])
    assert np.all(np.linalg.eigvalsh(few) > 0.0) and np.allclose(np.diag(few), 1.0)
    assert np.array_equal(correlation_of(np.nan * errors, worth), np.eye(3))


def test_of_long_runs_the_first_samples_are_predicted(monkeypatch: pytest.MonkeyPatch) -> None:
    *fitted, unseen = runs_of(21, 22, 23)
    durations = []

    def watched(identified, run, cutoff, *, at_rest):
        durations.append(residual_trace(identified, run, cutoff, at_rest=at_rest).duration)
        return residual_trace(identified, run, cutoff, at_rest=at_rest)

    monkeypatch.setattr("steelyard.estimate.scores.cross_validation.LONGEST", 4.0 * unseen.rate)
    monkeypatch.setattr(
        "steelyard.estimate.scores.residual_traces_and_band_calibration.residual_trace", watched
    )
    assert 90.0 <= coverage(calibrated(tuple(fitted)), unseen) <= 99.0
    assert durations and max(durations) <= 4.0


@pytest.mark.parametrize("kind", [DataError, LogError])
def test_motion_whose_residual_cannot_be_had_still_makes_bands(
    kind: type[SteelyardError], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise kind("a loop cannot close at rest", where="run", fix="correct it")

    monkeypatch.setattr(
        "steelyard.estimate.scores.residual_traces_and_band_calibration.residual_trace", refuse
    )
    known = calibrated(runs_of(1, 2)).calibration
    assert known is not None and known.peaks is None
    assert np.isfinite(known.factors).all()
