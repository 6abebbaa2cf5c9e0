"""Low-pass and derivatives against SciPy's filters and exact motions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from steelyard.base.errors import LogError
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Bank,
    apply,
    butterworth,
    fast_length,
    kaiser_lowpass,
    low_pass,
    settling,
    zero_phase,
)


def smooth_derivatives(cutoff: float, rate: float, highest: int) -> Bank:
    return Bank.derivatives(butterworth(cutoff, rate), settling(cutoff, rate), rate, highest)


def split(x: np.ndarray, cuts: list[int]) -> list[np.ndarray]:
    return np.split(x, sorted(c % (x.shape[-1] + 1) for c in cuts), axis=-1)


@pytest.mark.parametrize("suppression", [20.0, 35.0, 50.0, 80.0, 120.0])
@pytest.mark.parametrize(("width", "cutoff"), [(0.05, 0.1), (0.4, 0.5), (0.013, 0.9)])
def test_the_kaiser_window_is_scipys(suppression: float, width: float, cutoff: float) -> None:
    length, beta = signal.kaiserord(suppression, width)
    expected = signal.firwin(length + 1 - length % 2, cutoff, window=("kaiser", beta))
    np.testing.assert_allclose(kaiser_lowpass(suppression, width, cutoff), expected, atol=1e-15)


@pytest.mark.parametrize("cutoff", [-0.1, 0.0, 1.0, 1.2, np.nan])
def test_a_cutoff_outside_the_band_is_refused(cutoff: float) -> None:
    with pytest.raises(ValueError, match="is not between 0 and 1"):
        kaiser_lowpass(60.0, 0.5, cutoff)


@pytest.mark.parametrize("order", [2, 4, 5])
@pytest.mark.parametrize(("cutoff", "rate"), [(8.0, 100.0), (2.0, 1000.0), (24.9, 100.0), (20, 50)])
def test_inside_it_is_scipys_filter(order: int, cutoff: float, rate: float) -> None:
    halo = settling(cutoff, rate, order)
    x = np.random.default_rng(1).standard_normal((4 * halo + 3000, 2)).cumsum(axis=0)
    sections = signal.butter(order, cutoff, fs=rate, output="sos")
    expected = signal.sosfiltfilt(sections, x, axis=0)
    inside = slice(halo, len(x) - halo)
    np.testing.assert_allclose(
        zero_phase(x, cutoff, rate, order)[inside], expected[inside], rtol=0, atol=1e-9
    )


def derived(values: np.ndarray, cutoff: float, rate: float) -> np.ndarray:
    """Low-passed signal and two derivatives of a whole segment, shape `(3, N, C)`."""
    parts = list(apply(smooth_derivatives(cutoff, rate, 2), [values.T]))
    return np.concatenate(parts, axis=-1).transpose(0, 2, 1)


def test_at_the_ends_value_and_slope_are_kept() -> None:
    line = np.linspace(1.0, 4.0, 500)
    np.testing.assert_allclose(zero_phase(line, 5.0, 100.0), line, atol=1e-10)
    ramp = np.stack([line, -line], axis=1)
    _, dq, ddq = derived(ramp, 5.0, 100.0)
    slope = 3.0 / 499 * 100.0
    np.testing.assert_allclose(dq, np.full((500, 2), slope) * [1, -1], atol=1e-9)
    np.testing.assert_allclose(ddq, 0.0, atol=1e-7)


@settings(deadline=None, max_examples=60)
@given(
    length=st.integers(1, 1500),
    cuts=st.lists(st.integers(0, 2000), max_size=12),
    chunk=st.integers(1, 700),
    cutoff=st.floats(3.0, 25.0),
)
def test_parts_of_any_size_give_the_whole(
    length: int, cuts: list[int], chunk: int, cutoff: float
) -> None:
    x = np.random.default_rng(length).standard_normal((2, length)).cumsum(axis=1)
    bank = smooth_derivatives(cutoff, 100.0, 2)
    whole = np.concatenate(list(apply(bank, [x])), axis=-1)
    parts = np.concatenate(list(apply(bank, split(x, cuts), chunk)), axis=-1)
    assert whole.shape == (3, 2, length)
    scale = np.array([1.0, 1e2, 1e4])[:, None, None] * max(1.0, np.abs(x).max())
    np.testing.assert_allclose(parts / scale, whole / scale, rtol=0, atol=1e-12)


def test_no_parts_give_nothing() -> None:
    bank = low_pass(5.0, 100.0)
    assert list(apply(bank, [])) == []
    assert list(apply(bank, [np.zeros((2, 0))])) == []
    assert zero_phase(np.zeros((0, 3)), 5.0, 100.0).shape == (0, 3)


def test_a_bank_without_halo_scales() -> None:
    bank = Bank.derivatives(lambda omega: np.full(len(omega), 2.0), 0, 1.0, 0)
    x = np.arange(12.0).reshape(2, 6)
    (part,) = apply(bank, [x])
    np.testing.assert_allclose(part[0], 2.0 * x, atol=1e-12)


@pytest.mark.parametrize("frequency", [0.3, 2.0, 6.0])
def test_derivatives_of_a_sine_are_exact_up_to_the_filters_gain(frequency: float) -> None:
    rate, cutoff = 100.0, 12.0
    t = np.arange(2000) / rate
    w = 2.0 * np.pi * frequency
    q, dq, ddq = derived(np.sin(w * t)[:, None], cutoff, rate)
    (gain,) = butterworth(cutoff, rate)(np.array([w / rate]))
    inside = slice(400, -400)
    np.testing.assert_allclose(q[inside, 0], gain * np.sin(w * t)[inside], atol=1e-10)
    np.testing.assert_allclose(dq[inside, 0], gain * w * np.cos(w * t)[inside], atol=1e-9 * w)
    np.testing.assert_allclose(ddq[inside, 0], -gain * w * w * np.sin(w * t)[inside], atol=1e-8 * w)
    assert gain > 0.99


def test_a_cutoff_beyond_the_rate_is_refused() -> None:
    with pytest.raises(LogError, match="60 Hz does not fit samples at 100 Hz"):
        zero_phase(np.zeros(10), 60.0, 100.0)


@pytest.mark.parametrize("least", [1, 2, 3, 7, 17, 97, 1009, 4097, 12001])
def test_fast_lengths_have_small_factors(least: int) -> None:
    def smooth(n: int) -> bool:
        for p in (2, 3, 5):
            while n % p == 0:
                n //= p
        return n == 1

    expected = next(n for n in range(max(least, 2), 4 * least + 4) if n % 2 == 0 and smooth(n))
    assert fast_length(least) == expected
