"""Thresholds from the maxima of residuals: the stated rate holds, sample by sample as in blocks."""

import json

import numpy as np
import pytest
from scipy.stats import poisson

from steelyard.estimate.external.contact_thresholds import (
    EXTRAPOLATION,
    RANGES,
    ContactThresholds,
    ResidualPeaks,
    peaks_of,
    ranges_of,
)

EDGES = np.array([[0.01, 0.2, 0.8], [0.01, 0.3, 1.0]])
STEP = 0.02


def drawn(seconds: float, seed: int, heavy: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, correlated residuals with heavy tails of two joints, and ranges that change."""
    rng = np.random.default_rng(seed)
    count = int(seconds / STEP)
    white = rng.standard_t(heavy, (2, count)) if heavy else rng.standard_normal((2, count))
    kernel = np.exp(-np.arange(15) / 3.0)
    residual = np.array([np.convolve(row, kernel, "same") for row in white])
    ranges = np.repeat(rng.integers(2, 5, (2, count // 25 + 1)), 25, axis=1)[:, :count]
    scale = np.array([0.0, 0.0, 2.0, 1.0, 1.5])
    return np.arange(count) * STEP, residual * scale[ranges], ranges


def events(residual: np.ndarray, limit: np.ndarray) -> int:
    """Exceedances of all joints, those within half a second counted once."""
    found = 0
    for r, x in zip(residual, limit, strict=True):
        at = np.flatnonzero(np.abs(r) > x)
        found += int(np.sum(np.diff(at, prepend=-1000) > 0.5 / STEP))
    return found


@pytest.mark.parametrize("heavy", [0.0, 4.0], ids=["normal", "student"])
def test_the_stated_rate_of_false_alarms_is_an_upper_bound(heavy: float) -> None:
    rate, hours, draws = 30.0, 0.5, 24
    found = []
    for seed in range(draws):
        thresholds = peaks_of(*_with(drawn(240.0, seed, heavy))).thresholds(rate)
        _, residual, ranges = drawn(3600.0 * hours, 1000 + seed, heavy)
        found.append(events(residual, thresholds.at(ranges)))
    kept = np.mean([count <= poisson.ppf(0.95, rate * hours) for count in found])
    assert kept >= 0.95
    assert sum(found) > 0.01 * rate * hours * draws  # a threshold is not merely out of reach


def _with(
    signals: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, np.ndarray, float]:
    return *signals, STEP, EDGES, 8.0


def test_rarer_false_alarms_need_higher_thresholds() -> None:
    peaks = peaks_of(*_with(drawn(240.0, 1, 4.0)))
    limits = [peaks.thresholds(rate).limits for rate in (100.0, 20.0, 4.0)]
    assert np.all(limits[0] < limits[1]) and np.all(limits[1] < limits[2])


def test_a_range_that_was_never_visited_takes_the_largest_threshold_and_friction() -> None:
    friction = np.array([5.0, 7.0])
    thresholds = peaks_of(*_with(drawn(240.0, 1, 0.0))).thresholds(30.0, friction)
    assert [list(row) for row in thresholds.own] == [[False, False, True, True, True]] * 2
    largest = thresholds.limits[:, 2:].max(axis=1)
    assert np.allclose(thresholds.limits[:, :2], (largest + friction)[:, None])


def test_a_joint_with_an_unknown_residual_has_no_threshold() -> None:
    t, residual, ranges = drawn(240.0, 1, 0.0)
    residual[1] = np.nan
    peaks = peaks_of(t, residual, ranges, STEP, EDGES, 8.0)
    assert np.isnan(peaks.thresholds(30.0).limits).tolist() == [[False] * 5, [True] * 5]
    assert peaks.duration == pytest.approx(240.0)


def test_peaks_add_up() -> None:
    t, residual, ranges = drawn(240.0, 3, 4.0)
    half = len(t) // 2
    parts = [
        peaks_of(t[some], residual[:, some], ranges[:, some], STEP, EDGES, 8.0)
        for some in (slice(0, half), slice(half, None))
    ]
    whole, both = peaks_of(*_with((t, residual, ranges))), parts[0] + parts[1]
    assert np.allclose(both.seconds, whole.seconds)
    assert np.abs(both.visits - whole.visits).max() <= 1
    assert np.allclose(both.thresholds(30.0).limits, whole.thresholds(30.0).limits, rtol=0.05)
    assert whole.lowest_rate == pytest.approx(3600.0 / (EXTRAPOLATION * 240.0))


def test_visits_end_at_gaps_and_changes_of_range() -> None:
    t = np.concatenate([np.arange(10), np.arange(20, 30)]) * STEP
    residual = np.array([[*range(10), *range(10, 0, -1)]], dtype=float)
    ranges = np.array([[2] * 5 + [0] * 5 + [0] * 10])
    peaks = peaks_of(t, residual, ranges, STEP, EDGES[:1], 8.0)
    assert [row.tolist() for row in peaks.maxima[0]] == [[10.0, 9.0], [], [4.0], [], [], []]
    assert peaks.seconds[0, 0] == pytest.approx(15 * STEP)


def test_samples_one_by_one_are_those_of_blocks() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(4000) * 0.01
    speed = 1.2 * np.sin(np.outer([0.5, 0.3], t)) * (np.sin(np.outer([0.2, 0.11], t)) > 0)
    limits = np.cumsum(rng.uniform(1.0, 2.0, (2, len(RANGES))), axis=1)
    own = ((True,) * len(RANGES),) * 2
    thresholds = ContactThresholds(EDGES, 8.0, 1.0, 60.0, limits, own, np.ones(2))
    size = np.abs(speed)
    slowest = np.array([size[:, max(0, k - 15) : k + 1].min(axis=1) for k in range(len(t))]).T
    fastest = np.array([size[:, max(0, k - 50) : k + 1].max(axis=1) for k in range(len(t))]).T
    whole = thresholds.at(ranges_of(slowest, fastest, EDGES))
    stepper = thresholds.start()
    steps = np.array(
        [stepper.step(float(x), v) for x, v in zip(t + 1e-9 * t, speed.T, strict=True)]
    )
    assert len(np.unique(whole)) == 2 * len(RANGES)
    assert np.mean(steps.T == whole) > 0.99


def test_both_are_written_and_read_as_json() -> None:
    peaks = peaks_of(*_with(drawn(240.0, 2, 4.0)))
    again = ResidualPeaks.from_dict(json.loads(json.dumps(peaks.to_dict())))
    first, second = peaks.thresholds(30.0), again.thresholds(30.0)
    assert np.allclose(first.limits, second.limits, rtol=1e-4)
    text = json.dumps(first.to_dict(), allow_nan=False)
    written = json.loads(text)
    assert np.array_equal(written["thresholds"], first.limits) and len(text) < 2000
    assert written["own"] == [list(row) for row in first.own]
