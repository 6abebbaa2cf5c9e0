"""Measurement noise of efforts, from the spectrum above the motion's band."""

import numpy as np
import pytest

from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    ResidualNoise,
    noise_floor,
)

RATE, CUTOFF = 200.0, 5.0
T = np.arange(6000) / RATE


def white(size: float) -> np.ndarray:
    return size * np.random.default_rng(1).normal(size=(1, len(T)))


def test_white_noise_is_found_beside_a_motion_below_the_band() -> None:
    motion = 40.0 * np.sin(2 * np.pi * 0.7 * T) + 20.0 * np.sin(2 * np.pi * 3.1 * T)
    found = noise_floor(motion + white(0.3), RATE, CUTOFF)
    assert found[0] * 0.5 * RATE == pytest.approx(0.3**2, rel=0.25)


def test_noise_that_a_sensor_filters_counts_where_it_is_loudest() -> None:
    from scipy.signal import lfilter

    slow = lfilter([0.2], [1.0, -0.8], white(0.3), axis=1)
    found = noise_floor(slow, RATE, CUTOFF)
    at_ten_hertz = (
        2.0 * 0.3**2 / RATE * 0.2**2 / abs(1 - 0.8 * np.exp(-2j * np.pi * 15 / RATE)) ** 2
    )
    assert found[0] == pytest.approx(at_ten_hertz, rel=0.3)


def test_without_a_band_above_the_motion_nothing_is_reported() -> None:
    assert np.isnan(noise_floor(white(0.3), RATE, 60.0)).all()
    unknown = ResidualNoise(("a", "b"), np.array([2.0, 3.0]), np.array([np.nan, 1.5]))
    assert np.isnan(unknown.ratios[0]) and unknown.ratios[1] == 2.0
