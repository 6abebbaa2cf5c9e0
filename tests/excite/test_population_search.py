"""Searches by populations on criteria whose least value is known."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.base.errors import PackageError
from steelyard.base.progress import Event, Stopped
from steelyard.excite.search.search_methods import minimised_by_cma_es, minimised_by_genes

LOWER, UPPER = np.array([-2.0, -20.0, 5.0]), np.array([3.0, 40.0, 5.5])
BEST = np.array([0.5, -3.0, 5.4])


@dataclass
class Found:
    """The best point, its cost, and how many points were tried."""

    values: Array
    cost: float
    evaluations: int


def searched(
    minimise: Callable[..., tuple[Array, float]],
    criterion: Callable[[Array], Array],
    seed: int = 0,
    **settings: Any,
) -> Found:
    count = [0]

    def counted(x: Array) -> Array:
        count[0] += len(x)
        return criterion(x)

    random = np.random.default_rng(seed)
    return Found(*minimise(counted, LOWER, UPPER, random=random, **settings), count[0])


Search = Callable[..., Found]
genetic: Search = partial(searched, minimised_by_genes)
cma: Search = partial(searched, minimised_by_cma_es)
SEARCHES = pytest.mark.parametrize("search", [genetic, cma], ids=["genetic", "cma_es"])


def bowl(x: Array, best: Array = BEST) -> Array:
    return np.asarray((((x - best) / (UPPER - LOWER)) ** 2).sum(axis=1))


def waves(x: Array) -> Array:
    """Many valleys, the lowest at `BEST`."""
    away = (x - BEST) / (UPPER - LOWER)
    return np.asarray((away**2 + 0.02 * (1.0 - np.cos(25.0 * away))).sum(axis=1))


@SEARCHES
@pytest.mark.parametrize("criterion", [bowl, waves])
def test_the_least_is_found(search: Search, criterion: Callable[[Array], Array]) -> None:
    found = search(criterion, seed=1)
    np.testing.assert_allclose((found.values - BEST) / (UPPER - LOWER), 0.0, atol=0.02)
    assert found.cost == criterion(found.values[None])[0]


@SEARCHES
def test_only_points_in_the_box_are_tried_and_the_best_is_kept(search: Search) -> None:
    """The least is outside: it ends at the edges."""
    tried: list[Array] = []

    def criterion(x: Array) -> Array:
        tried.append(x)
        return bowl(x, UPPER + 0.1)

    found = search(criterion, seed=2)
    points = np.vstack(tried)
    assert np.all(points >= LOWER) and np.all(points <= UPPER)
    assert len(points) == found.evaluations
    costs = bowl(points, UPPER + 0.1)
    assert found.cost == costs.min()
    np.testing.assert_array_equal(found.values, points[costs.argmin()])
    np.testing.assert_allclose((UPPER - found.values) / (UPPER - LOWER), 0.0, atol=1e-2)


@SEARCHES
def test_seeds_repeat(search: Search) -> None:
    before = np.random.get_state()[1].copy()  # type: ignore[union-attr]
    one, two, other = (search(waves, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.values, two.values)
    assert one.evaluations == two.evaluations and one.cost == two.cost
    assert not np.array_equal(one.values, other.values)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # type: ignore[index]


@SEARCHES
def test_it_stops_when_requested(search: Search) -> None:
    events: list[Event] = []

    def third(event: Event) -> bool:
        events.append(event)
        return len(events) < 3

    with pytest.raises(Stopped):
        search(bowl, progress=third)
    assert [e.done for e in events] == sorted({e.done for e in events}) and len(events) == 3
    assert events[-1].done <= events[-1].total


@pytest.mark.parametrize(
    ("search", "package", "words"),
    [
        (genetic, "pymoo", "genetic searches need the package pymoo"),
        (cma, "cma", "searches by CMA-ES need the package cma"),
    ],
)
def test_a_missing_package_comes_with_the_line_that_installs_it(
    search: Search, package: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(PackageError) as caught:
        search(bowl)
    assert caught.value.wrong.startswith(words)
    assert 'pip install ".[population]"' in caught.value.fix


def test_generations_and_evaluations_are_as_many_as_requested() -> None:
    found = genetic(bowl, population=12, generations=7)
    assert found.evaluations == 12 * 7
    short, long = cma(waves, evaluations=50), cma(bowl)
    assert 50 <= short.evaluations < 70 and long.evaluations < 5000


def test_the_best_ever_tried_is_the_answer() -> None:
    """Not that of the last generation, which need not hold it."""
    for seed in range(10):
        best: list[float] = []

        def criterion(x: Array, best: list[float] = best) -> Array:
            costs = waves(x)
            best.append(float(costs.min()))
            return costs

        found = genetic(criterion, population=6, generations=4, seed=seed)
        assert found.cost == min(best)
        best.clear()
        assert cma(criterion, evaluations=40, seed=seed).cost == min(best)
