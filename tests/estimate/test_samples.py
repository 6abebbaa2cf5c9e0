"""Samples of a run: the same sums as the pass that keeps none, thinned where they get many."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from invented import single
from steelyard.base.errors import DataError, LogError
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.information.kept_filtered_samples import gather_samples
from steelyard.estimate.scores.cross_validation import behind
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.runs.motion_error_from_noise import motion_error
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run

REGRESSOR = base_regressor(Model(single()))
RATE, ENCODER = 100.0, 2e-4


def recorded(name: str = "swing", duration: float = 60.0, seed: int = 0) -> Run:
    """One joint with noise on both sides; it rests for ten seconds from the twentieth on."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / RATE)
    speed = np.clip(np.minimum(np.abs(t - 25.0) - 5.0, 1.0), 0.0, 1.0)
    phase = np.cumsum(speed) / RATE
    q = 0.8 * np.sin(1.7 * phase) + 0.2 * np.sin(4.1 * phase)
    effort = np.cos(1.7 * phase) + 0.1 * rng.normal(size=len(t))
    q = q + ENCODER * rng.normal(size=len(t))
    one = np.ones(1)
    signals = Signals("t", 1.0, ("q",), one, None, None, ("e",), one, "joint_torque", ("Nm",), one)
    log = LogInMemory(Path(name), ("t", "q", "e"), np.column_stack([t, q, effort]))
    return prepare(Recording(log, signals), Processing(motion_cutoff=20.0, matched_cutoff=8.0))


@pytest.fixture(scope="module")
def run() -> Run:
    return recorded()


def alike(samples: Information, passed: Information) -> None:
    """Both say the same, whatever their windows."""
    for name in ("grams", "absolute", "counts"):
        mine, wanted = getattr(samples, name).sum(axis=0), getattr(passed, name).sum(axis=0)
        np.testing.assert_allclose(mine, wanted, rtol=1e-10, atol=1e-10 * np.abs(wanted).max())
    assert (samples.layout, samples.signature) == (passed.layout, passed.signature)


@pytest.mark.parametrize("rests", [False, True])
@pytest.mark.parametrize("cutoff", [RATE, 8.0])
def test_samples_say_what_the_pass_says(run: Run, rests: bool, cutoff: float) -> None:
    other = behind(run, cutoff)
    samples = gather_samples(REGRESSOR, other, rests=rests, threads=2)
    alike(samples.information(), gather(REGRESSOR, other, rests=rests))
    assert len(samples) == len(samples.rows[0]) == len(samples.q)


def test_columns_are_those_of_the_motion_beside_them(run: Run) -> None:
    """Without a filter a row is what the regressor says of the instant's motion."""
    samples = gather_samples(REGRESSOR, behind(run, RATE))
    dense = REGRESSOR.dense(samples.q.T, samples.dq.T, samples.ddq.T)[0]
    seen = list(REGRESSOR.layout.sees[0])
    assert np.allclose(samples.rows[0][:, :-1], dense[samples.at[0]][:, seen], atol=1e-12)
    filtered = gather_samples(REGRESSOR, run)
    dense = REGRESSOR.dense(filtered.q.T, filtered.dq.T, filtered.ddq.T)[0]
    gravity = [k for k, c in enumerate(seen) if REGRESSOR.layout.columns[c].startswith("mx")]
    assert np.allclose(filtered.rows[0][:, gravity], dense[:, gravity], atol=0.05)


@pytest.mark.parametrize("most", [100, 3000])
def test_long_runs_are_thinned_evenly(run: Run, most: int) -> None:
    whole = gather_samples(REGRESSOR, behind(run, RATE), rests=True)
    some = gather_samples(REGRESSOR, behind(run, RATE), rests=True, most=most)
    assert most // 2 <= len(some) <= most < len(whole)
    assert np.ptp(np.diff(some.t)) < 1e-9
    assert np.isin(np.round(some.t, 6), np.round(whole.t, 6)).all()


def test_thinned_samples_are_worth_more_each_but_never_more_than_one(run: Run) -> None:
    whole = gather_samples(REGRESSOR, run)
    shares = [gather_samples(REGRESSOR, run, most=len(whole) // n).sources[0].share for n in (2, 9)]
    assert whole.sources[0].share < shares[0] < 1.0 + 1e-9
    assert shares[1] == pytest.approx(1.0, abs=0.02)
    worth = [gather(REGRESSOR, run).n_samples[0], len(whole) // 2 * shares[0]]
    assert 0.5 * worth[0] < worth[1] < 1.1 * worth[0]


def test_samples_of_runs_add_in_any_order(run: Run) -> None:
    other = recorded("second", 40.0, 1)
    first, second = gather_samples(REGRESSOR, run), gather_samples(REGRESSOR, other)
    for both in (first + second, second + first):
        alike(both.information(), gather(REGRESSOR, run) + gather(REGRESSOR, other))
        assert set(both.runs) == {"swing", "second"}
        alike(both.of(both.source == both.runs.index("swing")).information(), first.information())


def test_windows_choose_samples(run: Run) -> None:
    samples = gather_samples(REGRESSOR, run, rests=True)
    windows = [Window("swing", 5.0, 9.0), Window("swing", 30.0, 31.0), Window("other", 0.0, 99.0)]
    chosen = samples.during(windows)
    assert set(chosen.t) == {t for t in samples.t if 5.0 <= t <= 9.0 or 30.0 <= t <= 31.0}
    assert np.array_equal(chosen.rows[0], samples.rows[0][np.isin(samples.t, chosen.t)])
    assert samples.during([]).information().windows == ()


def test_weights_and_gains_reach_the_sums(run: Run) -> None:
    samples = gather_samples(REGRESSOR, run)
    weights = np.random.default_rng(0).uniform(size=len(samples)) * (samples.t > 12.0)
    found = samples.scaled(np.array([-2.0]), ("A",)).information([weights])
    part = samples.rows[0] * [*np.ones(samples.rows[0].shape[1] - 1), -2.0]
    wanted = (part.T * weights) @ part * samples.sources[0].share
    np.testing.assert_allclose(found.row_gram(0), wanted, rtol=1e-10)
    assert found.n_samples[0] == pytest.approx(np.sum(samples.t > 12.0) * samples.sources[0].share)
    assert found.signature.effort == ("A",)
    with pytest.raises(DataError, match="unequal effort"):
        samples + samples.scaled(np.array([-2.0]), ("A",))


def test_residuals_are_those_of_the_rows(run: Run) -> None:
    samples = gather_samples(REGRESSOR, run)
    values = np.arange(1.0, len(REGRESSOR.layout.columns) + 1.0)
    (found,) = samples.residuals(values)
    assert samples.information().residual_squares(values)[0] == pytest.approx(
        samples.sources[0].share * float(found @ found)
    )


def test_too_short_a_run_says_so(run: Run) -> None:
    short = replace(run, span=(1.0, 1.05))
    with pytest.raises(LogError, match=r"as long as its filter .*: the longest has 0\.0\d+ s"):
        gather_samples(REGRESSOR, short)
    resting = replace(run, rest_speed=np.full_like(run.rest_speed, np.inf))
    with pytest.raises(LogError, match=r"of \d+ samples a joint moves in 0") as caught:
        gather_samples(REGRESSOR, resting, rests=False)
    assert "matched_cutoff" not in caught.value.fix


def same_shares(found: np.ndarray, wanted: np.ndarray) -> None:
    """Two covariances, in units of the second's standard deviations."""
    scale = np.sqrt(np.diag(wanted))
    assert np.abs((found - wanted) / scale[:, None] / scale).max() < 0.02


def test_noise_of_positions_is_found_and_followed_to_accelerations(run: Run) -> None:
    """Against the motion that noise alone becomes in the chain."""
    error = motion_error(run)
    assert error.position[0] == pytest.approx(ENCODER, rel=0.1)
    noise = np.random.default_rng(1).normal(size=(1, 400_000))
    designed = run.chain.processing.motion.designed(run.motion_cutoff, run.rate)
    motion = designed(noise, None)[:, 0]
    same_shares(np.cov(motion), error.of_position[0])
    taps = ParallelFilter.design(8.0, RATE).taps
    filtered = np.array([np.convolve(x, taps, mode="valid") for x in motion])
    wanted = motion_error(run, taps).covariance(1.0)[0]
    same_shares(np.cov(filtered), wanted)
    assert np.allclose(error.covariance(), error.position[0] ** 2 * error.of_position)


def test_samples_of_a_log_with_velocities() -> None:
    t = np.arange(0.0, 120.0, 1.0 / RATE)
    rng = np.random.default_rng(0)
    q, dq = 0.8 * np.sin(1.7 * t), 1.36 * np.cos(1.7 * t) + 3e-3 * rng.normal(size=len(t))
    one = np.ones(1)
    signals = Signals("t", 1.0, ("q",), one, ("v",), one, ("e",), one, "joint_torque", ("Nm",), one)
    table = np.column_stack([t, q, dq, rng.normal(size=len(t))])
    log = LogInMemory(Path("v"), ("t", "q", "v", "e"), table)
    run = prepare(Recording(log, signals), Processing(motion_cutoff=20.0, matched_cutoff=8.0))
    error = gather_samples(REGRESSOR, run).sources[0].error
    assert error is not None
    assert error.velocity[0] == pytest.approx(3e-3, rel=0.1)
    assert not error.of_position[0, 1:].any() and not error.of_velocity[0, 0].any()
