import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from steelyard.runs.rows.resampling import sample_count, uniform


def uneven(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).choice([0.010, 0.012, 0.008], n).cumsum()


def test_parabolas_are_exact_and_rows_are_met() -> None:
    t = uneven(100, 3)
    x = np.stack([1.0 + t, t**2 - t], axis=1)
    (at,) = [t[0] + np.arange(sample_count(t[0], t[-1], 250.0)) / 250.0]
    even = uniform(t, x.T, 250.0)
    np.testing.assert_allclose(even, [1.0 + at, at**2 - at], atol=1e-12)
    regular = np.arange(50) / 50.0
    noise = np.random.default_rng(0).standard_normal((50, 1))
    same = uniform(regular, noise.T, 50.0)
    np.testing.assert_allclose(same[0], noise[:, 0], atol=1e-12)


@pytest.mark.parametrize("frequency", [1.0, 4.0, 8.0])
def test_error_is_below_that_of_linear_and_pchip(frequency: float) -> None:
    t = uneven(2000, 1)
    x = np.sin(2.0 * np.pi * frequency * t)
    even = uniform(t, x[None], 100.0)[0]
    at = t[0] + np.arange(len(even)) / 100.0
    truth = np.sin(2.0 * np.pi * frequency * at)

    def rms(y: np.ndarray) -> float:
        return float(np.sqrt(np.mean((y - truth) ** 2)))

    assert rms(even) < 0.5 * rms(np.interp(at, t, x))
    assert rms(even) < 0.5 * rms(PchipInterpolator(t, x)(np.minimum(at, t[-1])))
    assert rms(even) < 3e-3 * frequency**3 / 100.0
