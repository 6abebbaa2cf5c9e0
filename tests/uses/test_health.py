"""Health: what drifted is named with its time, what did not is not."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.uses.health.drift_detection import (
    ENOUGH_LOGS,
    LEAST_CHANGE,
    HealthChange,
    HealthQuantity,
    Series,
    changes_of,
    minutes,
)

NAMES = ("mon", "tue", "wed", "thu", "fri")


def series(
    values: list[np.ndarray],
    noise: float = 0.03,
    seed: int = 0,
    joint: str = "elbow",
    quantity: HealthQuantity = "dry friction",
    stated: float = 1.0,
) -> Series:
    """Windows of 20 s with a value and noise, its deviation stated `stated` times too small."""
    rng = np.random.default_rng(seed)
    log = np.concatenate([np.full(len(v), k) for k, v in enumerate(values)])
    t = np.concatenate([20.0 * np.arange(len(v)) + 10.0 for v in values])
    value = np.concatenate(values) + noise * rng.standard_normal(len(log))
    std = np.full(len(log), noise / stated)
    return Series(joint, quantity, "", log, t, value, std, 10.0 * std, 1.0, 0.01)


def named(found: tuple[HealthChange, ...]) -> list[HealthChange]:
    return [change for change in found if change.matters]


@pytest.mark.slow
@pytest.mark.parametrize("stated", [1.0, 3.0])
def test_constant_quantities_are_not_named(stated: float) -> None:
    for seed in range(8):
        steady = [np.zeros(24)] * 5
        many = [series(steady, seed=20 * seed + k, joint=f"j{k}", stated=stated) for k in range(6)]
        assert not named(changes_of(many, NAMES))


def test_levels_that_are_equal_have_no_change() -> None:
    rng = np.random.default_rng(6)
    for windows in range(1, 13):
        values = rng.standard_normal(windows)
        same = replace(series([values, values], noise=0.0), std=np.full(2 * windows, 0.7))
        steps = [change for change in changes_of([same], NAMES) if change.shape == "steps"]
        assert all(change.p == 1.0 for change in steps)
        assert all(change.p >= 0.0 for change in changes_of([same], NAMES))


def test_settling_within_a_log_has_its_time_constant() -> None:
    t = 20.0 * np.arange(32)
    one = series([-0.3 * (1.0 - np.exp(-t / 150.0)), np.full(32, -0.3)], seed=1)
    found = [change for change in named(changes_of([one], NAMES)) if change.shape == "settles"]
    assert len(found) == 1 and found[0].logs == ("mon", "mon")
    assert found[0].size == pytest.approx(-0.3, abs=0.05)
    assert found[0].time == pytest.approx(150.0, rel=0.4)
    assert "settles within mon, time constant" in found[0].when


def test_a_step_within_a_log_has_its_time() -> None:
    one = series([np.where(np.arange(30) < 18, 0.0, 0.4)], seed=2)
    (step,) = [c for c in named(changes_of([one], NAMES)) if c.shape == "steps within"]
    assert step.time == pytest.approx(360.0, abs=40.0)
    assert step.size == pytest.approx(0.4, abs=0.05)
    assert step.when == "in mon at 6 min"


def test_a_step_between_logs_is_named_with_both() -> None:
    one = series([np.full(20, 0.0 if k < 3 else 0.5) for k in range(5)], seed=3)
    (step,) = [c for c in named(changes_of([one], NAMES)) if c.shape == "steps"]
    assert step.logs == ("wed", "thu") and step.when == "between wed and thu"
    assert step.size == pytest.approx(0.5, abs=0.05)


def test_a_trend_over_logs_is_named_from_first_to_last() -> None:
    one = series([np.full(20, 0.25 * k) for k in range(5)], seed=4)
    (trend,) = [c for c in named(changes_of([one], NAMES)) if c.shape == "drifts"]
    assert trend.logs == ("mon", "fri") and trend.size == pytest.approx(1.0, abs=0.05)
    assert trend.text.startswith("+") and trend.text.endswith("%")


def test_small_changes_are_no_drift_however_certain() -> None:
    small = 0.5 * LEAST_CHANGE["dry friction"]
    one = series([np.zeros(30), np.full(30, small)], noise=0.001, seed=5)
    found = changes_of([one], NAMES)
    assert not named(found) and min(change.p for change in found) < 1e-3


@pytest.mark.slow
def test_levels_that_differ_from_motion_to_motion_are_no_drift() -> None:
    false = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        levels = 0.2 * rng.standard_normal(5)
        one = series([np.full(20, x) for x in levels], noise=0.02, seed=seed)
        false += bool([c for c in named(changes_of([one], NAMES)) if c.shape != "differs"])
    assert false <= 1
    assert len(levels) >= ENOUGH_LOGS


def test_two_logs_with_different_motions_need_a_change_beyond_the_residual() -> None:
    small = [np.zeros(20), np.full(20, 0.2)]
    large = [np.zeros(20), np.full(20, 2.0)]
    assert not named(changes_of([series(small, seed=6)], NAMES))
    found = named(changes_of([series(large, seed=6)], NAMES))
    assert {change.shape for change in found} == {"steps", "differs"}


def test_more_tests_ask_for_more_certainty() -> None:
    one = series([np.full(20, x) for x in (0.0, 0.0, 0.0, 0.15, 0.15)], noise=0.05, seed=7)
    alone = {(c.shape, c.logs): c.p for c in changes_of([one], NAMES)}
    beside = [series([np.zeros(20)] * 5, seed=50 + k, joint=f"j{k}") for k in range(9)]
    among = {
        (c.shape, c.logs): c.p for c in changes_of([one, *beside], NAMES) if c.joint == "elbow"
    }
    kept = [key for key in alone if alone[key] < 0.05]
    assert kept and all(among[key] == pytest.approx(10.0 * alone[key]) for key in kept)


def test_a_large_difference_of_a_single_window_is_unproven_not_absent() -> None:
    (differs,) = changes_of([series([np.full(1, 2.0)], quantity="effort scale")], NAMES)
    assert differs.unproven and not differs.matters
    (within,) = changes_of([series([np.full(1, 0.2)], quantity="effort scale")], NAMES)
    assert not within.unproven and not within.matters
    one = series([np.full(1, 0.9 * LEAST_CHANGE["dry friction"])], noise=1e-4)
    (certain,) = changes_of([one], NAMES)
    assert abs(certain.size) > 3.0 * certain.half_width and not certain.unproven


def test_what_is_a_drift_is_not_unproven() -> None:
    found = changes_of([series([np.zeros(20), np.full(20, 2.0)], seed=6)], NAMES)
    assert named(found) and not [change for change in found if change.unproven]


def test_sizes_have_the_digits_of_their_intervals() -> None:
    change = changes_of([series([np.full(20, 0.3)], seed=2)], NAMES)[0]
    moved = replace(change, unit="Nm", size=-0.0689, half_width=0.97)
    assert moved.text == "-0.07 ± 0.97 Nm"
    assert replace(moved, size=26.21, half_width=7.5).text == "+26.2 ± 7.5 Nm"
    assert replace(moved, unit="", size=-1.934, half_width=0.29).text == "-193 ± 29 %"


def test_times_are_readable() -> None:
    assert (minutes(90.0), minutes(900.0), minutes(None)) == ("90 s", "15 min", "")
