"""Searches and bounds against least squares on problems whose optimum is known."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from invented import single
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.bounded import BoundedLeastSquares
from steelyard.estimation.least_squares.box import Box, base_bounds
from steelyard.estimation.least_squares.cma_es import CmaEs
from steelyard.estimation.least_squares.genetic import Genetic
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.least_squares.whitened import whitened
from steelyard.estimation.prior.prior import default_knowledge
from steelyard.estimation.register import ESTIMATORS, Context
from steelyard.model import Model
from steelyard.progress import Event, Stopped
from steelyard.regression.accumulate import Accumulator, Stretch
from steelyard.regression.information import Information, Stamp, Window
from steelyard.regression.regressor import base_regressor
from steelyard.search.genetic import evolved
from steelyard.terms.laws.coulomb import Coulomb
from steelyard.terms.laws.offset import Offset
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.terms.laws.viscous import Viscous

MODEL = Model(single(), (RigidBody(), Coulomb(), Viscous(), Offset()))
REGRESSOR = base_regressor(MODEL)
NAMES = REGRESSOR.layout.columns
COULOMB, OFFSET = "coulomb.hinge", "offset.hinge"
TRUTH = np.array([0.3 * k + 0.5 for k in range(len(NAMES))])
NOISE = 0.05


def information(
    truth: np.ndarray = TRUTH, run: str = "run", seed: int = 0, speed: Callable[..., Any] = np.array
) -> tuple[Information, np.ndarray, np.ndarray]:
    """Information, dense regressor `(N, p)` and effort `(N,)` of a drawn motion."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 1, 300))
    dq = speed(dq)
    dense = REGRESSOR.dense(q, dq, ddq)
    effort = dense @ truth + NOISE * rng.normal(size=(1, 300))
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
    stamp = Stamp(MODEL.fingerprint, NAMES, ("Nm",), "none")
    made = Information(
        REGRESSOR.layout,
        stamp,
        (Window(run, 0.0, 1.0),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )
    return made, dense[0], effort[0]


def distance(estimate: Estimate, wanted: Estimate) -> float:
    """Largest difference in standard deviations."""
    change = estimate.parameters.values - wanted.parameters.values
    return float(np.abs(change / wanted.std).max())


def negative_coulomb() -> np.ndarray:
    truth = TRUTH.copy()
    truth[NAMES.index(COULOMB)] = -0.4
    return truth


def test_without_bounds_it_is_weighted_least_squares() -> None:
    data, _, _ = information()
    found, wanted = BoundedLeastSquares()(data), WeightedLeastSquares()(data)
    assert distance(found, wanted) < 1e-8
    assert np.allclose(found.covariance, wanted.covariance, rtol=1e-5)
    assert np.allclose(found.sigma, wanted.sigma, rtol=1e-9)
    assert found.notes == ()


def test_a_bound_that_holds_takes_its_column_out() -> None:
    data, dense, effort = information(negative_coulomb())
    found = BoundedLeastSquares({COULOMB: (0.0, np.inf)})(data)
    others = [k for k, name in enumerate(NAMES) if name != COULOMB]
    wanted = np.linalg.lstsq(dense[:, others], effort)[0]
    assert found.parameters[COULOMB] == 0.0
    assert np.allclose(found.parameters.values[others], wanted, rtol=1e-8)
    assert found.notes == (f"at a bound: {COULOMB}",)
    left = effort - dense[:, others] @ wanted
    assert found.sigma[0] == pytest.approx(np.sqrt(left @ left / len(left)), rel=0.02)


def test_parameters_of_single_runs_stay_theirs() -> None:
    shifted = TRUTH.copy()
    shifted[NAMES.index(OFFSET)] += 3.0
    data = information()[0] + information(shifted, "other", 1)[0]
    found = BoundedLeastSquares(per_run=(OFFSET,))(data)
    wanted = WeightedLeastSquares(per_run=(OFFSET,))(data)
    assert found.parameters.names == wanted.parameters.names
    assert distance(found, wanted) < 1e-7
    for mine, theirs in zip(found.per_run, wanted.per_run, strict=True):
        assert mine.run == theirs.run
        assert np.allclose(mine.parameters.values, theirs.parameters.values, rtol=1e-8)
        assert np.allclose(mine.std, theirs.std, rtol=1e-5)


def test_the_genetic_algorithm_comes_near_and_says_how_near() -> None:
    data, _, _ = information()
    wanted = WeightedLeastSquares()(data)
    short, long = Genetic()(data), Genetic(generations=800)(data)
    assert distance(long, wanted) < distance(short, wanted)
    assert distance(long, wanted) < 1.5
    assert short.notes[0] == (
        "ended after 100 generations of 30, after 3000 evaluations of the criterion"
    )
    squares = data.residual_squares(short.parameters.values) / wanted.sigma**2
    ratio = squares.sum() / (data.residual_squares(wanted.parameters.values) / wanted.sigma**2)
    assert f"did not reach the optimum: weighted squares {ratio[0]:.6g} times" in short.notes[1]
    assert "gives no intervals" in short.notes[2]
    assert short.sigma[0] > wanted.sigma[0]


def test_cma_es_reaches_the_optimum() -> None:
    data, _, _ = information()
    found = CmaEs()(data)
    assert distance(found, WeightedLeastSquares()(data)) < 1e-2
    assert found.notes[0].startswith("stood still")
    assert found.notes[1].startswith("reached the optimum")


def test_a_spent_budget_is_said() -> None:
    found = CmaEs(evaluations=60)(information()[0])
    assert found.notes[0].startswith("the budget of 60 was spent, after 6")
    assert found.notes[1].startswith("did not reach the optimum")


@pytest.mark.parametrize("make", [Genetic, CmaEs])
def test_bounds_are_kept_and_seeds_repeat(make: Callable[..., Any]) -> None:
    data, _, _ = information(negative_coulomb())
    bounds = {COULOMB: (0.0, 2.0), "viscous.hinge": (5.0, 6.0)}
    before = np.random.get_state()[1].copy()  # type: ignore[union-attr]
    one, two, other = (make(bounds, seed=seed)(data) for seed in (1, 1, 2))
    assert np.array_equal(np.random.get_state()[1], before)  # type: ignore[index]
    assert np.array_equal(one.parameters.values, two.parameters.values)
    assert not np.array_equal(one.parameters.values, other.parameters.values)
    assert 0.0 <= one.parameters[COULOMB] <= 2.0
    assert 5.0 <= one.parameters["viscous.hinge"] <= 6.0
    wanted = BoundedLeastSquares(bounds)(data)
    if make is CmaEs:
        assert distance(one, wanted) < 0.02
        assert one.notes[-1] == "at a bound: coulomb.hinge, viscous.hinge"


@pytest.mark.parametrize("make", [Genetic, CmaEs])
def test_it_stops_when_asked(make: Callable[..., Any]) -> None:
    events: list[Event] = []

    def twice(event: Event) -> bool:
        events.append(event)
        return len(events) < 2

    with pytest.raises(Stopped):
        make(progress=twice)(information()[0])
    assert len(events) == 2
    assert 0.0 < events[0].done < events[1].done <= events[1].total


@pytest.mark.parametrize(
    ("make", "module"), [(Genetic, "pymoo.algorithms.soo.nonconvex.ga"), (CmaEs, "cma")]
)
def test_a_missing_package_comes_with_the_line_that_installs_it(
    make: Callable[..., Any], module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DataError) as caught:
        make()(information()[0])
    assert caught.value.mend == 'pip install "steelyard[population]"'
    assert module.split(".")[0] in caught.value.wrong


@pytest.mark.parametrize("make", [BoundedLeastSquares, Genetic, CmaEs])
def test_bad_bounds_are_named(make: Callable[..., Any]) -> None:
    data, _, _ = information()
    with pytest.raises(DataError, match="no column 'colomb'"):
        make({"colomb": (0.0, 1.0)})(data)
    with pytest.raises(DataError, match=f"bounds of '{COULOMB}' are empty: 1 to 0"):
        make({COULOMB: (1.0, 0.0)})(data)


def test_a_population_of_one_is_refused() -> None:
    with pytest.raises(DataError, match="population of 1 over 100 generations"):
        Genetic(population=1)(information()[0])


def test_a_search_without_evaluations_is_refused() -> None:
    with pytest.raises(DataError, match="a budget of 0 evaluations"):
        CmaEs(evaluations=0)(information()[0])


def test_bounds_of_base_parameters_follow_from_those_in_them() -> None:
    known = default_knowledge(MODEL)
    lower, upper = known.lower.copy(), known.upper.copy()
    base = REGRESSOR.base
    for k, name in enumerate(base.names):
        lower[k], upper[k] = -1.0 - k, 2.0 + k
        assert name == known.names[k]
    bounds = base_bounds(base, type(known)(known.names, known.bodies, known.priors, lower, upper))
    rng = np.random.default_rng(0)
    inside = base.lift @ rng.uniform(lower[:, None], upper[:, None], (len(lower), 2000))
    for (low, high), values, row in zip(bounds.values(), inside, base.lift, strict=True):
        assert low <= values.min()
        assert values.max() <= high
        corner = np.where(row > 0.0, upper, lower)
        assert high == pytest.approx(row @ corner)
    assert base_bounds(base, known)[COULOMB] == (0.0, np.inf)


def test_what_stands_for_others_is_not_bounded() -> None:
    data, _, _ = information(negative_coulomb(), speed=np.abs)
    found = BoundedLeastSquares({COULOMB: (0.0, np.inf)})(data)
    assert [(b.name, b.tied_to) for b in found.blind] == [(OFFSET, (COULOMB,))]
    assert found.parameters[COULOMB] == pytest.approx(
        WeightedLeastSquares()(data).parameters[COULOMB], rel=1e-8
    )


def test_ranges_without_bounds_are_around_zero_and_else_begin_at_the_bound() -> None:
    data = whitened(information()[0])
    value = WeightedLeastSquares()(information()[0]).parameters[COULOMB]
    for given, wanted in (
        ((-np.inf, np.inf), (-3.0 * value, 3.0 * value)),
        ((0.0, np.inf), (0.0, 3.0 * value)),
        ((20.0 * value, np.inf), (20.0 * value, 26.0 * value)),
        ((-np.inf, -20.0 * value), (-26.0 * value, -20.0 * value)),
        ((20.0 * value, 21.0 * value), (20.0 * value, 21.0 * value)),
    ):
        box = Box.of(data, {COULOMB: given}).closed(3.0)
        place = box.names.index(COULOMB)
        assert (box.lower[place], box.upper[place]) == pytest.approx(wanted, rel=1e-9)


def test_any_criterion_can_evolve() -> None:
    def valley(x: np.ndarray) -> np.ndarray:
        return np.asarray((1.0 - x[:, 0]) ** 2 + 100.0 * (x[:, 1] - x[:, 0] ** 2) ** 2)

    found = evolved(valley, np.full(2, -2.0), np.full(2, 2.0), generations=400, seed=3)
    assert found.cost == valley(found.values[None])[0] < 1e-3
    assert found.evaluations == 30 * 400


@pytest.mark.parametrize("name", ["bounded LS", "GA", "CMA-ES", "log-Cholesky"])
def test_they_are_offered(name: str) -> None:
    data = information()[0] + information(run="other", seed=1)[0]
    offer = {offer.name: offer for offer in ESTIMATORS}[name]
    events: list[Event] = []
    context = Context(
        REGRESSOR, default_knowledge(MODEL), (OFFSET,), lambda e: events.append(e) or True
    )
    assert offer.needs == "information"
    estimate = offer.make(context)(data)
    assert np.isfinite(estimate.values.values).all()
    assert estimate.parameters[COULOMB] >= 0.0
    assert [own.run for own in estimate.per_run] == ["run", "other"]
    assert bool(events) == (name in ("GA", "CMA-ES"))
