import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.report.page_figures import drawn, gaps, thin


@given(st.integers(0, 5000), st.integers(4, 2000), st.integers(0, 2**32 - 1))
def test_extrema_and_ends_stay_in_order(size, most, seed):
    signal = np.random.default_rng(seed).standard_normal(size)
    chosen = thin(signal, most)
    assert len(chosen) <= most
    assert np.all(np.diff(chosen) > 0)
    if size:
        assert {0, size - 1, int(signal.argmin()), int(signal.argmax())} <= set(chosen.tolist())


def test_every_stretch_keeps_its_spike():
    signal = np.zeros(100_000)
    signal[777::1000] = 5.0
    signal[333::1000] = -5.0
    chosen = thin(signal, 2000)
    assert np.sum(signal[chosen] == 5.0) == 100
    assert np.sum(signal[chosen] == -5.0) == 100


def test_values_that_are_no_numbers_hide_no_extremum():
    signal = np.sin(np.arange(10_000) * 0.01)
    signal[::3] = np.nan
    signal[1::500] = np.inf
    finite = np.where(np.isfinite(signal), signal, np.nan)
    chosen = thin(signal, 200)
    assert np.nanmax(finite) in signal[chosen] and np.nanmin(finite) in signal[chosen]


def test_a_line_breaks_where_time_jumps():
    t = np.concatenate([np.arange(5000), 9000 + np.arange(5000)]) * 0.01
    assert gaps(t).tolist() == [4999]
    x, y = drawn(t, np.cos(t), 100)
    assert len(x) == len(y) <= 100
    (broken,) = np.flatnonzero(np.isnan(y))
    assert x[broken - 1] < 50.0 and x[broken + 1] >= 90.0
    assert np.all(np.diff(x) >= 0.0)


@pytest.mark.parametrize("size", [0, 1, 2])
def test_few_samples_are_all_drawn(size):
    x, y = drawn(np.arange(size) * 0.1, np.ones(size), 100)
    assert len(x) == len(y) == size
