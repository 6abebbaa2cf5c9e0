"""Changes of residuals at rest: what a level hides in the dead zone of friction."""

import numpy as np
import pytest

from steelyard.estimate.external.contact_thresholds import (
    CREEP,
    ONSET,
    QUIET,
    ChangeStepper,
    ResidualPeaks,
    changes_at_rest,
    peaks_of,
)

EDGES = np.array([[0.01, 0.2, 0.8], [0.01, 0.3, 1.0]])
STEP = 0.02
REST = 6.0
"""Length of a rest [s]; motion lasts half of it."""


def drawn(seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, residuals and ranges: at every rest friction is somewhere else in its dead zone."""
    rng = np.random.default_rng(seed)
    count = int(seconds / STEP)
    t = np.arange(count) * STEP
    number = (t / (1.5 * REST)).astype(int)
    moving = t % (1.5 * REST) < 0.5 * REST
    level = rng.uniform(-20.0, 20.0, (2, number[-1] + 1))[:, number]
    kernel = np.exp(-np.arange(15) / 3.0)
    noise = np.array([np.convolve(row, kernel, "same") for row in rng.standard_t(6, (2, count))])
    ranges = np.tile(np.where(moving, 3, 0), (2, 1))
    return t, 0.3 * noise + np.where(moving, 0.0, level), ranges


def peaks(seconds: float, seed: int) -> ResidualPeaks:
    return peaks_of(*drawn(seconds, seed), STEP, EDGES, 8.0)


def test_a_step_shows_in_full_and_is_forgotten() -> None:
    t = np.arange(0.0, 10.0, STEP)
    residual = np.array([15.0 + 4.0 * (t >= 5.0), -7.0 * np.ones(len(t))])
    change = changes_at_rest(t, residual, np.zeros((2, len(t)), dtype=int), STEP)
    tested = (t >= QUIET - 1e-9) & (t < 10.0 - ONSET - 1e-9)
    assert np.isnan(change[:, ~tested]).all() and np.isfinite(change[:, tested]).all()
    assert change[1, tested] == pytest.approx(0.0, abs=1e-9)
    after = (t >= 5.0) & tested
    keep = np.exp(-STEP / CREEP)
    assert change[0, after] == pytest.approx(4.0 * keep ** np.arange(1, after.sum() + 1))


def test_nothing_is_compared_across_motion_or_gaps() -> None:
    t = np.arange(0.0, 12.0, STEP)
    ranges = np.zeros((2, len(t)), dtype=int)
    ranges[1, (t >= 4.0) & (t < 5.0)] = 1
    t[t >= 8.0] += 3.0
    change = changes_at_rest(t, np.tile(t > 4.5, (2, 1)) * 9.0, ranges, STEP)
    tested = np.isfinite(change[0])
    rests = [(0.0, 4.0), (5.0, 8.0), (11.0, 15.0)]
    wanted = sum(((t >= a + QUIET - 1e-9) & (t < b - ONSET - 1e-9)) for a, b in rests) > 0
    assert np.array_equal(tested, wanted)
    assert change[:, tested] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_the_threshold_is_far_below_the_dead_zone_and_keeps_its_rate() -> None:
    rate, found, hours, draws = 30.0, 0, 0.5, 16
    for seed in range(draws):
        thresholds = peaks(1200.0, seed).thresholds(rate)
        assert np.all(thresholds.changes < 6.0) and np.all(thresholds.limits[:, 0] > 20.0)
        t, residual, ranges = drawn(3600.0 * hours, 100 + seed)
        over = np.abs(changes_at_rest(t, residual, ranges, STEP)) > thresholds.changes[:, None]
        for row in over:
            found += int(np.sum(np.diff(np.flatnonzero(row), prepend=-1000) > 0.5 / STEP))
    seen = found / (draws * hours)
    share = 0.5 * (REST - QUIET - ONSET) / (1.5 * REST)  # of the rate; tested time
    assert 0.3 * rate * share < seen < rate * share  # an upper bound, not out of reach


def test_peaks_of_changes_add_up_and_are_no_time_of_their_own() -> None:
    both = peaks(90.0, 1) + peaks(90.0, 2)
    assert both.duration == pytest.approx(180.0)
    assert both.seconds[:, -1] == pytest.approx(20.0 * (REST - QUIET - ONSET))
    assert both.visits[:, -1].tolist() == [20 * 5] * 2


def test_few_rests_leave_changes_untested() -> None:
    thresholds = peaks(12.0, 3).thresholds(3000.0)
    assert np.isnan(thresholds.changes).all()


def test_samples_one_by_one_are_those_of_blocks() -> None:
    t, residual, ranges = drawn(60.0, 7)
    residual[0, (t > 24.5) & (t < 25.5)] += 9.0
    limits = np.array([4.0, np.nan])
    with np.errstate(invalid="ignore"):
        whole = np.abs(changes_at_rest(t, residual, ranges, STEP)) > limits[:, None]
    stepper = ChangeStepper(limits)
    resting = np.all(ranges == 0, axis=0)
    steps = np.array([stepper.step(*one) for one in zip(t, resting, residual.T, strict=True)]).T
    later = round(ONSET / STEP)
    assert whole[0].sum() > 40 and not whole[1].any()
    assert np.sum(steps[:, later:] != whole[:, :-later]) <= 6  # times are rounded
