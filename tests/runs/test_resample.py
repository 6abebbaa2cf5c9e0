import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from steelyard.runs.rows.resampling import sample_count, uniform


def uneven(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).choice([0.010, 0.012, 0.008], n).cumsum()


@settings(deadline=None, max_examples=80)
@given(
    n=st.integers(1, 200),
    cuts=st.lists(st.integers(0, 200), max_size=10),
    seed=st.integers(0, 9),
    rate=st.sampled_from([20.0, 100.0, 333.0]),
)
def test_parts_of_any_size_give_the_whole(n: int, cuts: list[int], seed: int, rate: float) -> None:
    t = uneven(n, seed)
    x = np.random.default_rng(seed).standard_normal((n, 3))
    (whole,) = [np.concatenate(list(uniform([(t, x)], rate)), axis=1)]
    at = sorted(c % (n + 1) for c in cuts)
    rows = zip(np.split(t, at), np.split(x, at), strict=True)
    parts = np.concatenate(list(uniform(rows, rate)), axis=1)
    assert whole.shape == (3, sample_count(t[0], t[-1], rate))
    np.testing.assert_allclose(parts, whole, atol=1e-11)


def test_parabolas_are_exact_and_rows_are_met() -> None:
    t = uneven(100, 3)
    x = np.stack([1.0 + t, t**2 - t], axis=1)
    (at,) = [t[0] + np.arange(sample_count(t[0], t[-1], 250.0)) / 250.0]
    even = np.concatenate(list(uniform([(t, x)], 250.0)), axis=1)
    np.testing.assert_allclose(even, [1.0 + at, at**2 - at], atol=1e-12)
    regular = np.arange(50) / 50.0
    noise = np.random.default_rng(0).standard_normal((50, 1))
    (same,) = [np.concatenate(list(uniform([(regular, noise)], 50.0)), axis=1)]
    np.testing.assert_allclose(same[0], noise[:, 0], atol=1e-12)


@pytest.mark.parametrize("frequency", [1.0, 4.0, 8.0])
def test_error_is_below_that_of_linear_and_pchip(frequency: float) -> None:
    t = uneven(2000, 1)
    x = np.sin(2.0 * np.pi * frequency * t)
    even = np.concatenate(list(uniform([(t, x[:, None])], 100.0)), axis=1)[0]
    at = t[0] + np.arange(len(even)) / 100.0
    truth = np.sin(2.0 * np.pi * frequency * at)

    def rms(y: np.ndarray) -> float:
        return float(np.sqrt(np.mean((y - truth) ** 2)))

    assert rms(even) < 0.5 * rms(np.interp(at, t, x))
    assert rms(even) < 0.5 * rms(PchipInterpolator(t, x)(np.minimum(at, t[-1])))
    assert rms(even) < 3e-3 * frequency**3 / 100.0
