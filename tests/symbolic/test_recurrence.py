"""The bounded recurrence against a loop over samples."""

import numpy as np
import pytest

from steelyard.symbolic.native.compiled_programs import recurrence


def drawn(rows: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Decay, drive, bound and start; the bound often holds."""
    rng = np.random.default_rng(rows + count)
    shape = (rows, count)
    decay, drive = rng.uniform(-1.0, 1.0, shape), rng.normal(size=shape)
    return decay, drive, rng.uniform(0.2, 2.0, shape), rng.normal(size=rows)


def by_hand(decay: np.ndarray, drive: np.ndarray, bound: np.ndarray, start: np.ndarray):
    y = np.empty_like(decay)
    for row in range(len(y)):
        last = start[row]
        for k in range(y.shape[1]):
            last = min(max(decay[row, k] * last + drive[row, k], -bound[row, k]), bound[row, k])
            y[row, k] = last
    return y


@pytest.mark.parametrize(("rows", "count"), [(1, 1), (1, 500), (3, 77), (16, 301)])
def test_it_is_the_loop(rows: int, count: int) -> None:
    given = drawn(rows, count)
    found, last = recurrence(*given)
    wanted = by_hand(*given)
    np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(last, found[:, -1])
    if count > 100:
        assert 0.1 < np.mean(np.abs(wanted) == given[2]) < 0.9


@pytest.mark.parametrize("cuts", [(1,), (100, 101, 240), tuple(range(1, 300))])
def test_any_split_gives_the_same(cuts: tuple[int, ...]) -> None:
    *given, start = drawn(4, 300)
    whole, end = recurrence(*given, start)
    parts, last = [], start
    for part in zip(*(np.split(x, cuts, axis=1) for x in given), strict=True):
        found, last = recurrence(*part, last)
        parts.append(found)
    np.testing.assert_array_equal(np.concatenate(parts, axis=1), whole)
    np.testing.assert_array_equal(last, end)


def test_arrays_of_any_layout_and_no_samples() -> None:
    *given, start = drawn(5, 60)
    strided = [np.asfortranarray(x)[::2, ::3] for x in given]
    found, _ = recurrence(*strided, start[::2])
    np.testing.assert_allclose(found, by_hand(*strided, start[::2]), rtol=1e-13, atol=1e-14)
    kept = start.copy()
    empty, last = recurrence(*(x[:, :0] for x in given), start)
    assert empty.shape == (5, 0)
    np.testing.assert_array_equal(last, start)
    np.testing.assert_array_equal(start, kept)


def test_the_start_is_left_as_it_is() -> None:
    *given, start = drawn(2, 10)
    kept = start.copy()
    recurrence(*given, start)
    np.testing.assert_array_equal(start, kept)


def test_unequal_shapes_are_refused() -> None:
    decay, drive, bound, start = drawn(2, 10)
    with pytest.raises(ValueError, match="differ in shape"):
        recurrence(decay, drive[:, :9], bound, start)
    with pytest.raises(ValueError, match="differ in shape"):
        recurrence(decay, drive, bound, start[:1])
