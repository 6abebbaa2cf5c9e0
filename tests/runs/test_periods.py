"""Periods found, and means over them."""

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.runs.spectrum_and_period import (
    Repetitions,
    distance,
    find_period,
    folded,
    mean_period,
    moving_span,
)

RATE = 100.0


def periodic(t: np.ndarray, period: float) -> np.ndarray:
    w = 2.0 * np.pi / period
    return np.array([np.sin(w * t) + 0.4 * np.cos(3 * w * t), np.cos(2 * w * t + 0.3)])


def test_the_distance_is_its_definition() -> None:
    q = np.random.default_rng(0).normal(size=(2, 50))
    q -= q.mean(axis=1, keepdims=True)
    size = 2.0 * np.square(q).sum() / 50
    for lag, found in enumerate(distance(q)[:49]):
        apart = np.square(q[:, lag:] - q[:, : 50 - lag]).sum() / (50 - lag) / size
        assert found == pytest.approx(apart, abs=1e-12)


@pytest.mark.parametrize("periods", [1.5, 2.0, 6.3, 40.0])
def test_a_period_is_found_between_samples(periods: float) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 3.3337 * periods, 1.0 / RATE)
    q = periodic(t, 3.3337) + 1e-3 * rng.standard_normal((2, len(t)))
    assert find_period(q, RATE) == pytest.approx(3.3337, abs=2e-3 / periods)


def test_rests_at_the_ends_do_not_matter() -> None:
    t = np.arange(0.0, 12.0, 1.0 / RATE)
    q = periodic(t, 4.0)
    rested = np.concatenate((np.repeat(q[:, :1], 500, 1), q, np.repeat(q[:, -1:], 700, 1)), axis=1)
    start, stop = moving_span(rested)
    assert 495 <= start <= 510 and 1690 <= stop <= 1705
    assert find_period(rested, RATE) == pytest.approx(4.0, abs=0.01)


def test_no_period() -> None:
    rng = np.random.default_rng(0)
    assert find_period(np.cumsum(rng.normal(size=(3, 3000)), axis=1), RATE) is None
    once = np.arange(0.0, 4.5, 1.0 / RATE)
    assert find_period(periodic(once, 4.0), RATE) is None
    assert find_period(np.ones((2, 500)), RATE) is None
    assert find_period(np.ones((2, 5)), RATE) is None
    dwelling = np.repeat(rng.normal(size=(2, 12)), 300, axis=1)
    assert find_period(dwelling, RATE) is None


def test_the_mean_period_averages_noise_away() -> None:
    rng, length = np.random.default_rng(2), 333.37
    count = int(length * 8.5)
    clean = periodic(np.arange(count) / RATE, length / RATE)
    np.testing.assert_allclose(folded(clean, length), clean, atol=1e-9)
    noise = 0.01 * rng.standard_normal(clean.shape)
    left = folded(clean + noise, length) - clean
    assert np.std(left) == pytest.approx(0.01 / np.sqrt(8.5), rel=0.15)
    ends = clean.copy()
    ends[:, :30] += 1.0
    ends[:, -30:] += 1.0
    np.testing.assert_allclose(folded(ends, length, 40), clean, atol=2e-6)
    at = np.arange(333) * (length / 333) / RATE
    np.testing.assert_allclose(mean_period(clean, length), periodic(at, length / RATE), atol=1e-9)


@pytest.mark.parametrize("settings", [{"period": 0.0}, {"drop_first": -1}, {"drop_last": -2}])
def test_settings_that_cannot_be(settings: dict[str, float]) -> None:
    with pytest.raises(ModelError, match="not valid|cannot be"):
        Repetitions(**settings)  # type: ignore[arg-type]
