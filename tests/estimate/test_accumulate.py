"""The pass against plain NumPy: sums, filters, weights, parts and threads."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from invented import ROBOTS, single
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.filter_and_gram import (
    MOVING,
    RESTING,
    Accumulator,
    ParallelFilter,
    Stretch,
    Sums,
)
from steelyard.estimate.information.gather import MOST_WINDOWS, accumulate, cut_pieces
from steelyard.estimate.information.information import Information, Signature
from steelyard.model.model import Model
from steelyard.runs.run import Block

FILTERS = {"none": (100.0, 100.0), "8 of 100 Hz": (8.0, 100.0), "5 of 1000 Hz": (5.0, 1000.0)}


def regressor(name: str) -> Regressor:
    return base_regressor(Model(ROBOTS[name](Path())))


def stretch(n: int, count: int, weighted: bool, seed: int = 0) -> Stretch:
    rng = np.random.default_rng(seed)
    q, dq, ddq, effort = rng.normal(size=(4, n, count))
    weights = (rng.random((n, count)) > 0.3).astype(float) if weighted else None
    return Stretch(q, dq, ddq, effort, weights)


def oracle(found: Regressor, matched: ParallelFilter, data: Stretch) -> Sums:
    """The same with a stored regressor."""
    dense = found.dense(data.q, data.dq, data.ddq)
    count = data.q.shape[1]
    grams, absolute, counts, beside = [], [], [], []
    for row, seen in enumerate(found.layout.sees):
        rows = np.column_stack([dense[row][:, list(seen)], data.effort[row]])
        weights = np.ones(count) if data.weights is None else data.weights[row]
        starts = range(0, count - len(matched.taps) + 1, matched.decimation)
        inside = [slice(k, k + len(matched.taps)) for k in starts]
        rows = np.array([matched.taps @ rows[s] for s in inside]).reshape(-1, rows.shape[1])
        mean = np.array([matched.taps @ weights[s] for s in inside])
        sizes = np.abs(matched.taps) / np.abs(matched.taps).sum()
        resting = np.array([sizes @ (weights[s] == 0.0) for s in inside])
        shares = (resting > RESTING).astype(float)
        weights = (mean > MOVING).astype(float)
        rows = rows * np.sqrt(weights)[:, None]
        gram = rows.T @ rows
        grams.append(gram[np.tril_indices(len(gram))])
        absolute.append(np.abs(rows).sum(axis=0))
        counts.append(weights.sum())
        near = (rows.T * shares) @ rows
        beside.append(near[np.tril_indices(len(near))])
    return Sums(
        np.concatenate(grams), np.concatenate(absolute), np.array(counts), np.concatenate(beside)
    )


@pytest.mark.parametrize("name", ["single", "tree", "panda"])
@pytest.mark.parametrize("kind", list(FILTERS))
@pytest.mark.parametrize("weighted", [False, True])
def test_sums_equal_a_stored_regressor(name: str, kind: str, weighted: bool) -> None:
    found = regressor(name)
    matched = ParallelFilter.design(*FILTERS[kind])
    accumulator = Accumulator(found, matched)
    for count in (1, 3, 4, 5, 8, 17, 300, 1500):
        data = stretch(len(found.layout.rows), count, weighted)
        got, wanted = accumulator(data), oracle(found, matched, data)
        scale = max(1.0, np.abs(wanted.grams).max(initial=0.0))
        assert np.abs(got.grams - wanted.grams).max() < 1e-12 * scale
        assert np.abs(got.absolute - wanted.absolute).max() < 1e-12 * scale
        assert np.abs(got.beside - wanted.beside).max() < 1e-12 * scale
        assert np.array_equal(got.counts, wanted.counts)


def blocks(data: Stretch, sizes: list[int]) -> list[Block]:
    result, start = [], 0
    t = np.arange(data.q.shape[1]) / 100.0
    moving = np.ones(data.q.shape, dtype=bool) if data.weights is None else data.weights > 0.5
    whole = Block(0, t, data.q, data.dq, data.ddq, data.effort, moving)
    for size in sizes:
        result.append(whole.part(start, start + size))
        start += size
    return result


def gathered(
    found: Regressor, matched: ParallelFilter, parts: list[Block], threads: int
) -> Information:
    accumulator = Accumulator(found, matched)
    signature = Signature("m", found.layout.columns, ("Nm",), "f")
    return accumulate(accumulator, cut_pieces(parts, "run", accumulator), signature, threads)


@pytest.mark.parametrize("kind", list(FILTERS))
@pytest.mark.parametrize("weighted", [False, True])
def test_any_split_and_any_number_of_threads_give_the_same(kind: str, weighted: bool) -> None:
    found = regressor("tree")
    matched = ParallelFilter.design(*FILTERS[kind])
    data = stretch(4, 9000, weighted)
    wanted = gathered(found, matched, blocks(data, [9000]), 1)
    direct = Accumulator(found, matched)(data)
    scale = np.abs(direct.grams).max()
    assert np.abs(wanted.grams.sum(axis=0) - direct.grams).max() < 1e-12 * scale
    for sizes in ([1] * 20 + [8980], [4096, 4096, 808], [333] * 27 + [9]):
        for threads in (1, 2, 3):
            got = gathered(found, matched, blocks(data, sizes), threads)
            assert np.abs(got.grams.sum(axis=0) - direct.grams).max() < 1e-12 * scale
            if got.beside is None:
                assert not direct.beside.any()
            else:
                assert np.abs(got.beside.sum(axis=0) - direct.beside).max() < 1e-12 * scale
            assert np.array_equal(got.n_samples, wanted.n_samples)
            assert got.windows == wanted.windows


def test_gaps_are_not_filtered_across() -> None:
    found = regressor("tree")
    matched = ParallelFilter.design(8.0, 100.0)
    data = stretch(4, 3000, False)
    first, second = blocks(data, [1300, 1700])
    moved = Block(1, *[getattr(second, k) for k in ("t", "q", "dq", "ddq", "effort", "moving")])
    got = gathered(found, matched, [first, moved], 1)
    accumulator = Accumulator(found, matched)
    halves = [accumulator(Stretch(b.q, b.dq, b.ddq, b.effort)).grams for b in (first, second)]
    assert np.allclose(got.grams.sum(axis=0), sum(halves), rtol=1e-12)


def test_a_long_run_keeps_a_bounded_number_of_windows() -> None:
    found = base_regressor(Model(single()))
    data = stretch(1, 600_000, False)
    got = gathered(found, ParallelFilter.design(100.0, 100.0), blocks(data, [600_000]), 2)
    assert 64 <= len(got.windows) <= MOST_WINDOWS
    assert got.windows[0].start == 0.0 and got.windows[-1].stop == 5999.99
    assert all(a.stop <= b.start for a, b in pairwise(got.windows))
    direct = Accumulator(found)(data)
    assert np.allclose(got.grams.sum(axis=0), direct.grams, rtol=1e-11)
    assert got.n_samples.tolist() == [600_000]


def test_absurd_angles_are_refused() -> None:
    with pytest.raises(Exception, match="beyond 100000 rad"):
        Stretch(*(np.full((4, 8), x) for x in (1e6, 0.0, 0.0, 0.0)))


def test_the_filter_passes_slow_and_stops_fast_signals() -> None:
    matched = ParallelFilter.design(8.0, 1000.0)
    frequencies = np.array([0.0, 1.0, 8.0, 16.5, 100.0])
    centre = (len(matched.taps) - 1) / 2
    phase = 2j * np.pi * frequencies[:, None] * (np.arange(len(matched.taps)) - centre) / 1000.0
    gain = np.abs(np.exp(phase) @ matched.taps)
    assert np.allclose(gain[:2], 1.0, atol=2e-3)
    assert abs(gain[2] - 0.5) < 0.01
    assert np.all(gain[3:] < 1e-3)


@pytest.mark.parametrize(("cutoff", "rate"), [(8.0, 100.0), (5.0, 1000.0)])
def test_inflation_is_that_of_filtered_white_noise(cutoff: float, rate: float) -> None:
    matched = ParallelFilter.design(cutoff, rate)
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2000, 8 * len(matched.taps)))
    windows = np.lib.stride_tricks.sliding_window_view(noise, len(matched.taps), axis=1)
    kept = windows[:, :: matched.decimation] @ matched.taps
    variance_of_mean = kept.mean(axis=1).var() * kept.shape[1]
    ratio = variance_of_mean / kept.var()
    assert abs(ratio / matched.inflation - 1.0) < 0.15


def test_weights_of_noise_are_filtered_as_its_variance() -> None:
    """A sample behind the filter has the mean variance of its taps; rests leave samples out."""
    found, matched = regressor("single"), ParallelFilter.design(5.0, 100.0)
    data = stretch(1, 900, weighted=False)
    rng = np.random.default_rng(5)
    variance = rng.uniform(0.2, 3.0, (1, 900))
    weights = 1.0 / variance
    weights[:, 300:420] = 0.0
    got = Accumulator(found, matched)(Stretch(data.q, data.dq, data.ddq, data.effort, weights))
    dense = found.dense(data.q, data.dq, data.ddq)[0]
    rows = np.column_stack([dense, data.effort[0]])
    gram, count = np.zeros((rows.shape[1],) * 2), 0
    for start in range(0, 900 - len(matched.taps) + 1, matched.decimation):
        inside = slice(start, start + len(matched.taps))
        counted = weights[0, inside] > 0.0
        if matched.taps @ counted <= MOVING:
            continue
        squares = matched.taps**2 * counted
        weight = squares.sum() / (squares @ variance[0, inside])
        filtered = matched.taps @ rows[inside]
        gram += weight * np.outer(filtered, filtered)
        count += 1
    np.testing.assert_allclose(got.grams, gram[np.tril_indices(len(gram))], rtol=1e-10)
    assert got.counts.tolist() == [count]


def test_weights_of_noise_set_the_spread() -> None:
    """With noise of known course the weighted sums give what weighted least squares does."""
    found = regressor("single")
    data = stretch(1, 2000, weighted=False)
    weights = np.random.default_rng(0).uniform(0.1, 3.0, (1, 2000))
    got = Accumulator(found)(Stretch(data.q, data.dq, data.ddq, data.effort, weights))
    dense = found.dense(data.q, data.dq, data.ddq)[0]
    rows = np.column_stack([dense, data.effort[0]]) * np.sqrt(weights[0])[:, None]
    gram = rows.T @ rows
    np.testing.assert_allclose(got.grams, gram[np.tril_indices(len(gram))], rtol=1e-10)
    assert got.counts.tolist() == [2000]
