"""Smoothing splines against scipy's."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from steelyard.base.errors import LogError
from steelyard.runs.smoothing.spline_and_finite_windows import (
    SmoothingSpline,
    cross_validated,
    smoothing_spline,
)


@pytest.mark.parametrize("weight", [1e-8, 1e-4, 1.0])
def test_it_is_scipys(weight: float) -> None:
    rng = np.random.default_rng(0)
    t = 3.0 + 0.01 * np.arange(700)
    y = 5.0 + np.sin(3.0 * t) + 0.01 * rng.standard_normal(700)
    found, wanted = smoothing_spline(y, 100.0, weight), make_smoothing_spline(t, y, lam=weight)
    for order, values in enumerate(found):
        expected = wanted.derivative(order)(t) if order else wanted(t)
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_cross_validation_chooses_as_scipys_does() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(600.0)
    for noise in (0.05, 0.3):
        y = np.sin(t / 12.0) + noise * rng.standard_normal(600)
        ours = smoothing_spline(y, 1.0)[0]
        theirs = make_smoothing_spline(t, y)(t)
        assert np.abs(ours - theirs).max() < 0.1 * noise


def test_cross_validation_looks_for_every_smoothness() -> None:
    rng = np.random.default_rng(2)
    slow = np.sin(np.arange(20_000) / 4000.0) + 0.1 * rng.standard_normal(20_000)
    weight = cross_validated(slow)
    assert weight > 1e6
    error = smoothing_spline(slow, 1.0)[0] - np.sin(np.arange(20_000) / 4000.0)
    assert np.std(error) < 0.01


def test_the_cutoff_can_choose() -> None:
    rate, cutoff = 200.0, 8.0
    t = np.arange(4000) / rate
    for frequency in (2.0, 8.0, 15.0):
        wave = np.sin(2.0 * np.pi * frequency * t)
        found = SmoothingSpline(choose="cutoff").designed(cutoff, rate)(wave[None], None)
        gain = 1.0 / (1.0 + (frequency / cutoff) ** 4)
        np.testing.assert_allclose(found[0, 0, 500:-500], gain * wave[500:-500], atol=0.02)


def test_too_little_is_reported() -> None:
    with pytest.raises(LogError, match="5 samples cannot be fitted by a spline"):
        smoothing_spline(np.zeros(5), 1.0)
