"""Searches by populations stay in the feasible set and get better."""

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest

from designing import FAMILIES, box, problem, random_starts, torques
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, PackageError
from steelyard.base.progress import Stopped
from steelyard.excite.constraints.constraint_and_limits import Constraint
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.search.search_methods import (
    NOTHING_SHOWN_COST,
    Method,
    _Genes,
    search_by_cma_es,
    search_by_genes,
    seeded,
)

METHODS: dict[str, Method] = {
    "genetic": partial(search_by_genes, population=20, generations=15),
    "cma_es": partial(search_by_cma_es, evaluations=600),
}
SHORT: dict[str, Method] = {
    "genetic": partial(search_by_genes, population=20, generations=3),
    "cma_es": partial(search_by_cma_es, evaluations=120),
}
BOTH = pytest.mark.parametrize("method", METHODS)
CONSTRAINED: Sequence[Constraint] = (box(0.8), torques())


def silently(x: Array) -> None:
    pass


def of_starts(design: Problem, count: int) -> Array:
    starts = random_starts(design.inequalities, np.random.default_rng(0), count)
    return np.sort([design.objective(x, 64.0)[0] for x in starts])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method", "constrained"),
    [
        ("rest", "genetic", True),
        ("rest", "cma_es", False),
        ("rest, from to", "cma_es", True),
        ("quintic, from", "genetic", False),
        ("reaching", "cma_es", True),
    ],
)
def test_a_search_improves_and_stays_inside(name: str, method: str, constrained: bool) -> None:
    design = problem(FAMILIES[name], CONSTRAINED if constrained else ())
    reported: list[Array] = []
    x = METHODS[method](design, seeded(0, 0), reported.append)
    assert x.shape == (3, design.basis.count)
    assert design.inequalities.smallest_margin(x) > 0.0
    assert reported and all(design.inequalities.smallest_margin(y) > 0.0 for y in reported)
    (start,) = random_starts(design.inequalities, seeded(0, 0), 1)
    values = [design.objective(y, 64.0)[0] for y in [start, *reported]]
    assert all(b <= a for a, b in zip(values, values[1:], strict=False))
    assert values[-1] < values[0] - 0.1
    assert values[-1] < of_starts(design, 20)[4 if constrained else 0]
    np.testing.assert_array_equal(reported[-1], x)


@pytest.mark.slow
@BOTH
def test_the_same_seed_gives_the_same_motion(method: str) -> None:
    design = problem(FAMILIES["rest"])
    before = np.random.get_state()[1].copy()  # type: ignore[union-attr]
    one, two, other = (SHORT[method](design, seeded(s, 0), silently) for s in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, other)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # type: ignore[index]


@pytest.mark.slow
@BOTH
def test_more_work_is_not_worse(method: str) -> None:
    design = problem(FAMILIES["rest"])
    short, long = (
        design.objective(which[method](design, seeded(0, 0), silently), 64.0)[0]
        for which in (SHORT, METHODS)
    )
    assert long < short


@BOTH
def test_the_watcher_is_called_at_every_generation_and_can_stop(method: str) -> None:
    design = problem(FAMILIES["rest"])
    reported: list[Array] = []

    def fifth(x: Array) -> None:
        reported.append(x)
        if len(reported) == 5:
            raise Stopped("enough")

    with pytest.raises(Stopped, match="enough"):
        METHODS[method](design, seeded(0, 0), fifth)
    assert len(reported) == 5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "constrained"),
    [("rest", True), *((name, bool(k % 2)) for k, name in enumerate(FAMILIES))],
)
def test_any_genes_are_a_motion_inside_or_none(name: str, constrained: bool) -> None:
    design = problem(FAMILIES[name], CONSTRAINED if constrained else ())
    genes = _Genes(design)
    assert genes.count == 3 + 3 * design.basis.count and np.all(genes.units > 0.0)
    random = np.random.default_rng(0)
    corners = np.sign(random.standard_normal((10, genes.count)))
    drawn = [*random.uniform(-1.0, 1.0, (30, genes.count)), *corners]
    motions = [genes.motion(one) for one in drawn]
    kept = [x for x in motions if x is not None]
    assert len(kept) >= (3 if constrained else 40)
    assert all(design.inequalities.smallest_margin(x) > 0.0 for x in kept)
    costs = genes.costs(silently, kept[0])(np.array(drawn))
    nowhere = np.array([x is None for x in motions])
    assert costs.shape == (40,)
    assert np.all(costs[~nowhere] <= NOTHING_SHOWN_COST) and np.all(
        costs[nowhere] >= NOTHING_SHOWN_COST
    )
    shown = [design.objective(x, 64.0)[0] for x in kept]
    np.testing.assert_array_equal(costs[~nowhere], np.minimum(shown, NOTHING_SHOWN_COST))


def test_postures_that_are_not_free_are_worse_the_more_they_lack() -> None:
    """A plateau would end a search before it finds a way in."""
    design = problem(FAMILIES["rest"], [box(0.3)])
    genes = _Genes(design)
    start = random_starts(design.inequalities, np.random.default_rng(0), 1)[0]
    away = np.zeros((6, genes.count))
    away[:, 0] = np.linspace(0.5, 1.0, 6)
    costs = genes.costs(silently, start)(away)
    lacks = [-design.inequalities.smallest_margin(genes.still(one)) for one in away]
    assert lacks == sorted(lacks) and 0.0 < lacks[0] < lacks[-1] < NOTHING_SHOWN_COST
    np.testing.assert_allclose(costs, NOTHING_SHOWN_COST + np.array(lacks))


@BOTH
def test_where_no_posture_is_free_it_is_reported(method: str) -> None:
    with pytest.raises(DataError, match="no motion about any of 31 random postures"):
        METHODS[method](problem(FAMILIES["rest"], [box(0.0)]), seeded(0, 0), silently)


@pytest.mark.parametrize(("method", "package"), [("genetic", "pymoo"), ("cma_es", "cma")])
def test_a_missing_package_comes_with_the_line_that_installs_it(
    method: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(PackageError) as caught:
        METHODS[method](problem(FAMILIES["rest"]), seeded(0, 0), silently)
    assert 'pip install ".[population]"' in caught.value.fix


def test_settings_are_passed_on() -> None:
    given: list[dict[str, Any]] = []

    def spy(*_: Any, **settings: Any) -> Any:
        given.append(settings)
        raise Stopped("seen")

    sizes = [{"population": 7, "generations": 11}, {"evaluations": 123}]
    for method, own in zip((search_by_genes, search_by_cma_es), sizes, strict=True):
        with pytest.raises(Stopped):
            method(problem(FAMILIES["rest"]), seeded(0, 0), silently, minimise=spy, **own)
    assert (given[0]["population"], given[0]["generations"]) == (7, 11)
    assert given[1]["evaluations"] == 123
