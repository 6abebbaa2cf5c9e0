"""Projection on harmonics against least squares and known motions."""

import numpy as np
import pytest

from steelyard.base.errors import LogError, ModelError
from steelyard.runs.smoothing.likeliest_cutoffs_and_fourier import (
    Fourier,
    fourier_series,
    refined_frequency,
)
from steelyard.runs.spectrum_and_period import moving_span

RATE = 100.0


def motion(t: np.ndarray, period: float, harmonics: int = 5, seed: int = 0) -> np.ndarray:
    """Three joints and two derivatives of each, `(3, 3, N)`."""
    rng = np.random.default_rng(seed)
    w = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    a, b = rng.normal(size=(2, 3, harmonics)) / np.arange(1, harmonics + 1)
    angle = t[:, None] * w
    cos, sin = np.cos(angle), np.sin(angle)
    q = cos @ a.T + sin @ b.T
    dq = (cos * w) @ b.T - (sin * w) @ a.T
    ddq = -(cos * w**2) @ a.T - (sin * w**2) @ b.T
    return np.array([q.T, dq.T, ddq.T])


@pytest.mark.parametrize("periods", [1.0, 2.4, 7.0])
def test_derivatives_are_exact(periods: float) -> None:
    rng = np.random.default_rng(3)
    t = 5.0 + np.sort(rng.uniform(0.0, 4.0 * periods, 900))
    t[[0, -1]] = 5.0, 5.0 + 4.0 * periods
    true = motion(t, 4.0)
    found = fourier_series(t, true[0].T, 0.25, 7).at(t).transpose(0, 2, 1)
    np.testing.assert_allclose(found, true, rtol=0, atol=1e-9)


def test_it_is_least_squares_and_says_its_noise() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 13.0, 0.01)
    y = motion(t, 4.0)[0].T + 0.3 * t[:, None] + 0.02 * rng.standard_normal((len(t), 3))
    angle = 2.0 * np.pi * 0.25 * t[:, None] * np.arange(1, 6)
    basis = np.hstack([np.ones((len(t), 1)), t[:, None], np.cos(angle), np.sin(angle)])
    fitted = basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
    found = fourier_series(t, y, 0.25, 5, drift=True)
    np.testing.assert_allclose(found.at(t)[0], fitted, atol=1e-10)
    np.testing.assert_allclose(found.drift, 0.3, atol=2e-3)
    np.testing.assert_allclose(found.noise, 0.02, rtol=0.1)
    spread = np.std(found.at(t)[0] - (motion(t, 4.0)[0].T + 0.3 * t[:, None]), axis=0)
    assert (spread < 2.0 * 0.02 * np.sqrt(12.0 / len(t))).all()


def test_frequency_and_harmonics_are_found() -> None:
    rng, rate = np.random.default_rng(2), RATE
    t = np.arange(0.0, 40.0, 1.0 / rate)
    true = motion(t, 13.3331)
    q = true[0] + 1e-4 * rng.standard_normal(true[0].shape)
    assert 1.0 / refined_frequency(t, q.T, 1.0 / 13.4) == pytest.approx(13.3331, abs=2e-4)
    designed = Fourier().designed(8.0, rate)
    series = Fourier().series(q, 8.0, rate)
    assert series.harmonics == 5
    found = designed(q, None)
    inner = slice(200, -200)
    for order, bound in enumerate((1e-5, 3e-5, 1e-4)):
        assert np.abs(found[order] - true[order])[:, inner].max() < 3.0 * bound


def test_given_frequency_period_and_harmonics() -> None:
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    q = motion(t, 4.0)[0]
    by_period = Fourier(period=4.0, harmonics=5).series(q, 8.0, RATE)
    by_frequency = Fourier(frequency=0.25, harmonics=5).series(q, 8.0, RATE)
    assert by_period.frequency == by_frequency.frequency == 0.25
    assert by_period.harmonics == 5
    np.testing.assert_allclose(by_period.noise, 0.0, atol=1e-9)


def test_rests_at_the_ends_are_no_part_of_it() -> None:
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    q = motion(t, 4.0)[0]
    smooth = np.clip((t - 0.0) / 0.01, 0.0, 1.0)
    rested = np.concatenate((np.repeat(q[:, :1], 300, 1), q * smooth + q[:, :1] * (1 - smooth)), 1)
    rested = np.concatenate((rested, np.repeat(rested[:, -1:], 300, 1)), axis=1)
    found = Fourier(period=4.0).designed(20.0, RATE)(rested, None)
    true = motion(t, 4.0)
    np.testing.assert_allclose(found[1][:, 400:2200], true[1][:, 100:1900], atol=2e-3)
    np.testing.assert_allclose(found[:, :, :200][1:], 0.0, atol=1e-2)
    np.testing.assert_allclose(found[0][:, :200], rested[:, :200], atol=1e-4)


def test_what_is_not_periodic_is_refused() -> None:
    rng = np.random.default_rng(0)
    wandering = np.cumsum(rng.normal(size=(3, 3000)), axis=1)
    with pytest.raises(LogError, match="the motion is not periodic: it returns to its start"):
        Fourier().designed(8.0, RATE)(wandering, None)
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    with pytest.raises(LogError, match=r"not periodic with 3\.1 s: \d+ harmonics leave") as caught:
        Fourier(period=3.1).designed(8.0, RATE)(motion(t, 4.0)[0], None)
    assert "correct the period" in caught.value.fix
    with pytest.raises(LogError, match="samples over 0.49 periods"):
        fourier_series(np.arange(0.0, 5.0, 0.01), np.zeros((500, 1)), 0.0982, 3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"frequency": 0.1, "period": 10.0}, "given twice"),
        ({"period": -1.0}, "not positive"),
        ({"harmonics": 0}, "not a valid motion"),
    ],
)
def test_settings_that_cannot_be(settings: dict[str, float], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Fourier(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize("rest", [0, 50])
def test_a_period_that_begins_slowly_is_taken_whole(rest: int) -> None:
    w = 2.0 * np.pi * 0.25
    t = np.arange(0.0, 4.0, 1.0 / RATE)
    cos, sin = np.cos(w * t), np.sin(w * t)
    size = np.array([[1.0], [-0.4]])
    q = size * (1.0 - cos) ** 2
    dq = size * 2.0 * w * (1.0 - cos) * sin
    start, stop = moving_span(q)
    assert stop - start < 0.95 * len(t)
    rested = np.pad(q, ((0, 0), (rest, rest)))
    found = Fourier(period=4.0, harmonics=5).designed(8.0, RATE)(rested, None)
    kept = slice(rest, rest + len(t))
    np.testing.assert_allclose(found[0, :, kept], q, atol=1e-9)
    np.testing.assert_allclose(found[1, :, kept], dq, atol=1e-8)
