import re
from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from steelyard.base.errors import LogError
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.runs.prepare import (
    SpeedHistogram,
    default_rest_speed,
    given_rest_speed,
)
from steelyard.runs.processing_choices import MATCHED_FACTOR, Processing, cutoffs
from steelyard.runs.smoothing.kalman_smoother import CausalKalman, KalmanSmoother
from steelyard.runs.smoothing.likeliest_cutoffs_and_fourier import Auto
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Butterworth
from steelyard.runs.smoothing.spline_and_finite_windows import FIR
from steelyard.runs.spectrum_and_period import motion_band, welch


def test_welch_is_scipys() -> None:
    x = np.random.default_rng(0).standard_normal((2, 5000)).cumsum(axis=1)
    frequency, density = welch(x, 100.0, 10.0)
    expected_f, expected = signal.welch(x, 100.0, "hann", 1000, 500, detrend="linear")
    np.testing.assert_allclose(frequency, expected_f)
    np.testing.assert_allclose(density[:, 1:-1], expected[:, 1:-1], rtol=1e-3)


def test_welch_with_the_mean_is_scipys() -> None:
    x = 3.0 + np.random.default_rng(0).standard_normal((2, 5000)).cumsum(axis=1)
    density = welch(x, 100.0, 10.0, detrend=False)[1]
    expected = signal.welch(x, 100.0, "hann", 1000, 500, detrend=False)[1]
    np.testing.assert_allclose(density[:, 1:-1], expected[:, 1:-1], rtol=1e-3)


def test_welch_holds_one_window_at_a_time(peak: Callable[[], float]) -> None:
    x = np.ones((2, 2_000_000))
    welch(x, 1000.0)
    assert peak() < x.nbytes / 2**20 + 10.0


@pytest.mark.parametrize("resting", [0, 3])
@pytest.mark.parametrize("shake", [0.0, 1e-5])
def test_a_slow_move_rules_the_band_not_what_shakes_or_rests(resting: int, shake: float) -> None:
    rng = np.random.default_rng(2)
    t = np.arange(6000) / 1000.0
    move = np.clip((t - 0.5) * 0.5, 0.0, 2.5) + shake * np.sin(2.0 * np.pi * 70.0 * t)
    noise = 1e-7 * rng.standard_normal((1 + resting, len(t)))
    humming = 1e-6 * np.sin(2.0 * np.pi * 190.0 * t)
    q = noise + np.concatenate((move[None], np.tile(humming, (resting, 1))))
    assert motion_band(q, 1000.0).frequency < 1.0


def test_logged_velocities_tell_the_band_where_positions_do_not() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(5000) / 100.0
    q = np.stack([np.sin(2.0 * np.pi * f * t) for f in (0.3, 0.4)])
    dq = np.stack([2.0 * np.pi * f * np.cos(2.0 * np.pi * f * t) for f in (0.3, 0.4)])
    shaken = q + 0.01 * np.sin(2.0 * np.pi * 8.0 * t)
    noisy = dq + 1e-3 * rng.standard_normal(dq.shape)
    assert motion_band(shaken, 100.0).frequency > 7.0
    assert motion_band(shaken, 100.0, noisy).frequency < 0.6


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_the_band_is_the_motions_whatever_the_noise(noise: float) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(60_000) / 1000.0
    q = np.stack([np.sin(2 * np.pi * f * t) for f in (0.3, 0.5, 0.5)])
    still = np.zeros((1, len(t)))
    noisy = np.concatenate((q, still)) + noise * rng.standard_normal((4, len(t)))
    band = motion_band(noisy, 1000.0)
    assert band.frequency == pytest.approx(0.5, abs=0.11)
    np.testing.assert_allclose(band.noise, noise**2 / 500.0, rtol=0.4, atol=1e-16)


def test_cutoffs_follow_the_band_within_the_rate() -> None:
    slow = cutoffs(Processing(), 0.05, 100.0, "log")
    usual = cutoffs(Processing(), 0.5, 1000.0, "log")
    fast = cutoffs(Processing(), 10.0, 100.0, "log")
    assert (slow.matched, slow.motion) == (2.0, 6.0)
    assert (usual.matched, usual.motion) == (0.5 * MATCHED_FACTOR, 1.5 * MATCHED_FACTOR)
    assert (fast.matched, fast.motion) == (20.0, 25.0)


@pytest.mark.parametrize("rate", [33.333, 104.17, 249.6])
def test_cutoffs_of_uneven_rates_are_not_rounded_beyond_what_they_hold(rate: float) -> None:
    assert cutoffs(Processing(), 10.0, rate, "log").matched <= 0.2 * rate


def test_requested_cutoffs_are_taken() -> None:
    both = cutoffs(Processing(motion_cutoff=9.0, matched_cutoff=5.0), 0.5, 100.0, "log")
    assert (both.motion, both.matched) == (9.0, 5.0)
    one = cutoffs(Processing(motion_cutoff=4.0), 0.5, 100.0, "log")
    assert (one.motion, one.matched) == (4.0, 4.0)
    other = cutoffs(Processing(matched_cutoff=4.0), 0.5, 100.0, "log")
    assert (other.motion, other.matched) == (12.0, 4.0)


def test_without_parallel_filter_nothing_is_cut_off() -> None:
    usual = cutoffs(Processing(), 0.5, 100.0, "log")
    for matched in (None, 50.0, 125.0):  # such as were found of another log
        none = cutoffs(Processing(parallel_filter=False, matched_cutoff=matched), 0.5, 100.0, "log")
        assert (none.motion, none.matched) == (usual.motion, 50.0)
    assert ParallelFilter.design(50.0, 100.0).taps.tolist() == [1.0]
    assert ParallelFilter.design(125.0, 100.0).inflation == 1.0


@pytest.mark.parametrize(
    ("processing", "words"),
    [
        (Processing(motion_cutoff=60.0), "motion cut-off of 60 Hz does not fit a log of 100 Hz"),
        (Processing(matched_cutoff=30.0), "regression cut-off of 30 Hz"),
        (Processing(matched_cutoff=-1.0), "regression cut-off of -1 Hz"),
        (Processing(effort=Butterworth(), effort_cutoff=50.0), "effort cut-off of 50 Hz"),
        (Processing(effort=KalmanSmoother(), effort_cutoff=500.0), "effort cut-off of 500 Hz"),
        (Processing(effort=FIR(), effort_cutoff=60.0), "effort cut-off of 60 Hz"),
        (Processing(motion=CausalKalman(cutoffs=(9.0, 0.0))), "position cut-off of 0 Hz"),
        (Processing(motion=Auto(cutoffs=(9.0, -1.0))), "position cut-off of -1 Hz"),
        (Processing(motion=Auto(cutoffs=(500.0, 9.0))), "position cut-off of 500 Hz"),
        (Processing(motion=Auto(velocity_cutoffs=(np.nan, 9.0))), "velocity cut-off of nan Hz"),
        (Processing(motion=CausalKalman(velocity_cutoffs=(46.0, 9.0))), "velocity cut-off of 46"),
    ],
)
def test_cutoffs_beyond_the_rate_are_refused(processing: Processing, words: str) -> None:
    with pytest.raises(LogError, match=words) as caught:
        cutoffs(processing, 0.5, 100.0, "run.csv")
    assert caught.value.where.startswith("run.csv, ") and "log faster" in caught.value.fix
    assert re.search(r"cutoffs? (in (motion|effort) )?of \[processing\]", caught.value.where)


def test_rest_speeds_are_one_or_one_per_joint() -> None:
    np.testing.assert_array_equal(given_rest_speed(Processing(rest_speed=0.1), 3), [0.1] * 3)
    np.testing.assert_array_equal(given_rest_speed(Processing(rest_speed=(1.0, 2.0)), 2), [1, 2])
    assert given_rest_speed(Processing(), 3) is None
    with pytest.raises(LogError, match="does not fit 3 joints"):
        given_rest_speed(Processing(rest_speed=(1.0, 2.0)), 3)
    assert given_rest_speed(Processing(rest_speed=0.0), 3).tolist() == [0.0] * 3  # none rests
    with pytest.raises(LogError, match="does not fit"):
        given_rest_speed(Processing(rest_speed=(0.0, 1.0, 1.0)), 3)


def test_rest_speed_is_the_largest_of_its_reasons() -> None:
    fast, zero = np.array([1.0, 0.001, 0.0]), np.zeros(3)
    np.testing.assert_allclose(default_rest_speed(fast, zero, zero), [0.005, 0.001, 0.001])
    np.testing.assert_allclose(default_rest_speed(zero, zero, zero), 1e-4)
    np.testing.assert_allclose(default_rest_speed(fast, zero + 0.1, zero), 0.4)
    np.testing.assert_allclose(default_rest_speed(fast, zero, zero + 0.1), 0.2)


def test_histogram_knows_quantiles_and_times() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(20_000) / 100.0
    dq = rng.standard_normal((3, 20_000)) * np.array([[1.0], [0.1], [0.0]])
    dq[:, :500] = dq[:, -700:] = 0.0
    speeds = SpeedHistogram(np.array([0.05, 0.05, 1.0]))
    for part in range(0, 20_000, 777):
        speeds.add(t[part : part + 777], dq[:, part : part + 777])
    found = speeds.quantile(0.99)
    np.testing.assert_allclose(found[:2], np.quantile(np.abs(dq[:2]), 0.99, axis=1), rtol=0.08)
    assert found[2] < 1e-7
    np.testing.assert_array_equal(speeds.highest, np.abs(dq).max(axis=1))
    faster = np.flatnonzero((np.abs(dq) > [[0.05], [0.05], [1.0]]).any(axis=0))
    assert speeds.moving(np.array([0.05, 0.05, 1.0])) == (t[faster[0]], t[faster[-1]])
    assert speeds.moving(np.array([80.0, 80.0, 80.0])) is None
    edges = speeds.edge_above(np.array([0.05, 0.051, 0.3]))
    np.testing.assert_allclose(edges[0], 0.05)
    assert (edges >= [0.05, 0.051, 0.3]).all() and (edges < [0.0501, 0.0551, 0.33]).all()
