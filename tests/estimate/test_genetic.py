"""The genetic algorithm against bounded least squares of the dense columns by SciPy."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from drawn import motion_of, samples_of
from invented import dh_arm
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.progress import Event, Stopped
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.genetic_algorithm import Genetic, bounded_by_priors, evolved
from steelyard.estimate.prior.body_priors import Knowledge, Row, default_knowledge
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.sections import GeneticSection

MODEL = Model(dh_arm(), (RigidBody(), Viscous(), Coulomb()))
REGRESSOR = base_regressor(MODEL)
COLUMNS = REGRESSOR.layout.columns
FRICTION = {"viscous": 2.0, "coulomb": 1.0}


def known(upper: dict[str, float] = FRICTION) -> Knowledge:
    """The priors of the model file, and an upper bound of friction."""
    rows = [
        Row(f"'{name}' is bounded", {name: 1.0}, upper=upper[name.split(".")[0]])
        for name in MODEL.names
        if name.split(".")[0] in upper
    ]
    return replace(default_knowledge(MODEL), rows=tuple(rows))


@cache
def data() -> tuple[Information, Array, Array]:
    """Noisy data of friction beyond its bounds at some joints: information, columns, efforts."""
    assert MODEL.prior is not None
    standard = MODEL.prior.values.values.copy()
    for k, name in enumerate(MODEL.names):
        if name.split(".")[0] in FRICTION:
            standard[k] = 1.3 if name.startswith("coulomb") else 0.7
    motion = motion_of(len(REGRESSOR.layout.rows), 300, 0)
    dense = REGRESSOR.dense(*motion)
    effort = dense @ REGRESSOR.base.base_values(standard)
    effort = effort + 0.3 * np.random.default_rng(1).normal(size=effort.shape)
    information = samples_of(REGRESSOR, motion, effort).information()
    return information, dense.reshape(-1, len(COLUMNS)), effort.ravel()


def error(values: Array) -> float:
    _, columns, effort = data()
    return float(np.sqrt(np.mean(np.square(columns @ values - effort))))


@cache
def found(population: int = 100, generations: int = 600, seed: int = 0) -> Estimate:
    settings = GeneticSection(population=population, generations=generations, seed=seed)
    return Genetic(REGRESSOR.base, known(), settings)(data()[0])


def test_it_reaches_least_squares_within_the_same_bounds() -> None:
    estimate = found()
    assert estimate.evolution is not None and estimate.parameters.names == COLUMNS
    ends = estimate.evolution.lower, estimate.evolution.upper
    exact = lsq_linear(data()[1], data()[2], ends, method="bvls", tol=1e-14).x
    mine = estimate.parameters.values
    assert error(exact) <= error(mine) <= 1.002 * error(exact)
    assert (ends[0] <= mine).all() and (mine <= ends[1]).all()
    held = {name for name, x in zip(COLUMNS, exact, strict=True) if x >= 1.0 - 1e-9}
    assert {name for name in estimate.at_bound if name.startswith("coulomb")} == {
        name for name in held if name.startswith("coulomb")
    }


def test_its_history_is_that_of_the_objective() -> None:
    estimate = found(20, 30)
    search = estimate.evolution
    assert search is not None and len(search.best) == len(search.mean) == 30
    assert (np.diff(search.best) <= 0.0).all() and (search.best <= search.mean).all()
    assert search.best[-1] == pytest.approx(error(estimate.parameters.values), rel=1e-6)
    free = np.linalg.lstsq(*data()[1:])[0]
    assert search.least_squares == pytest.approx(error(free), rel=1e-6)
    again = Estimate.from_dict(estimate.to_dict()).evolution
    assert again is not None and again.mean.tolist() == search.mean.tolist()


def test_it_ends_at_a_sufficient_error() -> None:
    whole = found(20, 30)
    assert whole.evolution is not None
    best = whole.evolution.best
    wanted = float(best[0] + best[-1]) / 2.0
    settings = GeneticSection(population=20, generations=30, sufficient=wanted)
    ended = Genetic(REGRESSOR.base, known(), settings)(data()[0]).evolution
    assert ended is not None and 1 <= len(ended.best) < 30
    assert ended.best[-1] <= wanted and (ended.best[:-1] > wanted).all()


def test_seeds_decide_all_random_choices() -> None:
    one, same, other = found(20, 30), found.__wrapped__(20, 30), found(20, 30, 1)
    assert one.parameters.values.tolist() == same.parameters.values.tolist()
    assert one.parameters.values.tolist() != other.parameters.values.tolist()


def test_parameters_without_bounds_are_named() -> None:
    with pytest.raises(DataError) as caught:
        Genetic(REGRESSOR.base, known({"viscous": 2.0}))(data()[0])
    names = [name for name in MODEL.names if name.startswith("coulomb")]
    assert caught.value.wrong.endswith(f"search between for {', '.join(names)}")
    assert 'parameter = "coulomb.*", lower' in caught.value.fix
    knowledge = replace(known(), priors=(None,) * len(known().priors))
    with pytest.raises(DataError, match=r"m\.|mx\.|Izz\."):
        Genetic(REGRESSOR.base, knowledge)(data()[0])


def test_bounds_of_links_hold_bodies_up_to_twice_as_large() -> None:
    knowledge = bounded_by_priors(known())
    rng = np.random.default_rng(0)
    for body, prior in enumerate(knowledge.priors):
        assert prior is not None
        tens = knowledge.tens(body)
        low, high = knowledge.lower[tens], knowledge.upper[tens]
        assert (low <= 2.0 * prior.ten).all() and (2.0 * prior.ten <= high).all()
        # any other distribution of twice the mass and the same second moments about the origin
        moment = 0.5 * prior.ten[[4, 6, 9]].sum()
        points = rng.normal(size=(50, 7, 3))
        masses = np.full(7, 2.0 * prior.mass / 7)
        scale = np.sqrt(2.0 * moment / np.einsum("p,spi,spi->s", masses, points, points))
        for x in points * scale[:, None, None]:
            second = np.einsum("p,pi,pj->ij", masses, x, x)
            inertia = np.trace(second) * np.eye(3) - second
            ten = [masses.sum(), *(masses @ x), *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
            assert (low <= np.array(ten) + 1e-12).all() and (np.array(ten) <= high + 1e-12).all()


def test_it_stops_when_told() -> None:
    events: list[Event] = []

    def third(event: Event) -> bool:
        events.append(event)
        return len(events) < 3

    with pytest.raises(Stopped):
        evolved(
            lambda x: np.square(x).sum(axis=1), -np.ones(2), np.ones(2), GeneticSection(), third
        )
    assert [event.done for event in events] == [1, 2, 3] and events[0].total == 100
