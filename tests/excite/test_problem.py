"""A problem's samples, its criterion and the figure that people read."""

from dataclasses import replace
from math import ceil

import numpy as np
import pytest

from designing import ARM, FAMILIES, MIDDLE, MODEL, box, problem, random_starts
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.progress import Stopped
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.excite.design_problem_and_information import (
    KEPT_PER_WAVE,
    SHOWN_PER_WAVE,
    Case,
    InformationEvaluator,
    Problem,
    jumping,
)
from steelyard.excite.optimality_criteria import CRITERIA, measure
from steelyard.excite.search.search_methods import METHODS, method_of, search_by_gradient, seeded
from steelyard.model.laws.friction_over_speed import Coulomb

ALL = pytest.mark.parametrize("name", FAMILIES)


def regressor_along(design: Problem, x: Array) -> Array:
    """At 1000 samples, `(n, N, c)`; a joint at rest is not moved by rounding."""
    motion = design.basis.motion(x)
    t = np.arange(1000) * motion.duration / 1000
    q, dq, ddq = (np.ascontiguousarray(motion.derivative(t, order).T) for order in range(3))
    return base_regressor(MODEL).dense(q, np.where(np.abs(dq) < 1e-12, 0.0, dq), ddq)


@ALL
def test_figure_is_the_condition_number_of_the_regressor(name: str) -> None:
    design = problem(FAMILIES[name])
    x = random_starts(design.inequalities, np.random.default_rng(0), 1)[0]
    y = regressor_along(design, x)
    assert design.criterion_value(x) == pytest.approx(np.linalg.cond(np.vstack(list(y))), rel=1e-6)


@pytest.mark.parametrize("kind", CRITERIA)
def test_weights_count_samples_of_a_second(kind: str) -> None:
    """The information is that of the whole motion, however it is sampled."""
    plain = problem(FAMILIES["rest"], kind=kind)
    x = random_starts(plain.inequalities, np.random.default_rng(0), 1)[0]
    weights = np.array([2.0, 0.5, 3.0])
    case = plain.cases[0]
    weighed = replace(plain, cases=[replace(case, shows=replace(case.shows, weights=weights))])
    y = regressor_along(plain, x) * np.sqrt(weights * plain.basis.duration / 1000)[:, None, None]
    rows = np.vstack(list(y))
    assert weighed.criterion_value(x) == pytest.approx(
        CRITERIA[kind].value(rows.T @ rows), rel=1e-9
    )
    finer = replace(weighed, samples=4000)
    assert finer.criterion_value(x) == pytest.approx(weighed.criterion_value(x), rel=2e-3)


@ALL
def test_samples_are_dense_enough(name: str) -> None:
    design = problem(FAMILIES[name])
    basis = design.basis
    for t, per_wave in (
        (design.objective.t, SHOWN_PER_WAVE),
        (design.inequalities.t, KEPT_PER_WAVE),
    ):
        assert t[0] == 0.0 and t[-1] < basis.duration
        assert len(t) >= max(20, 2 * basis.count, ceil(per_wave * basis.highest * basis.duration))
        np.testing.assert_allclose(np.diff(t), basis.duration / len(t), rtol=1e-9)


@ALL
def test_between_the_samples_of_the_walls_little_is_missed(name: str) -> None:
    """As stated: an extreme between two samples is at most 0.3 % of the peak beyond them."""
    design = problem(FAMILIES[name])
    for seed in range(5):
        x = random_starts(design.inequalities, np.random.default_rng(seed), 1)[0]
        motion = design.basis.motion(x)
        least, most = motion.extremes(0)
        values = motion.derivative(design.inequalities.t, 0)
        missed = np.maximum(most - values.max(axis=0), values.min(axis=0) - least)
        assert np.all(missed <= 0.004 * np.maximum(np.abs(most), np.abs(least)))


def test_jumps_are_softened_while_searching_and_not_in_the_criterion_value() -> None:
    design = problem(FAMILIES["rest"])
    (sharp,) = jumping(design.cases)
    assert np.all(sharp.shows.widths == 1e-9) and np.all(design.cases[0].shows.widths > 1e-3)
    assert sharp.criterion is design.cases[0].criterion
    x = random_starts(design.inequalities, np.random.default_rng(0), 1)[0]
    wide = design.cases[0].shows
    soft = replace(
        design, cases=[Case(replace(wide, widths=3.0 * np.ones(3)), CRITERIA["condition"])]
    )
    assert soft.criterion_value(x) == design.criterion_value(x)
    assert soft.objective(x, 16.0)[0] != pytest.approx(design.objective(x, 16.0)[0], rel=1e-3)


def test_the_smooth_criterion_is_near_the_exact_one() -> None:
    design = problem(FAMILIES["rest"])
    count = len(design.cases[0].shows.base)
    for seed in range(5):
        x = random_starts(design.inequalities, np.random.default_rng(seed), 1)[0]
        smooth = design.objective(x, 64.0)[0]
        assert abs(smooth - np.log(design.criterion_value(x))) < 0.1 + np.log(count) / 64.0


def test_the_worst_of_several_cases_is_the_criterion_value() -> None:
    design = problem(FAMILIES["rest"])
    shows, count = design.cases[0].shows, len(design.cases[0].shows.base)
    sizes = [np.geomspace(0.1, 10.0, count), np.geomspace(10.0, 0.1, count)]
    cases = [Case(shows, measure(CRITERIA["a_optimal"], None, None, s)) for s in sizes]
    x = random_starts(design.inequalities, np.random.default_rng(0), 1)[0]
    figures = [replace(design, cases=[case]).criterion_value(x) for case in cases]
    assert figures[0] != pytest.approx(figures[1], rel=1e-2)
    assert replace(design, cases=cases).criterion_value(x) == max(figures)


def test_a_robot_that_stands_shows_nothing() -> None:
    design = problem(FAMILIES["rest"])
    assert design.criterion_value(design.basis.still(MIDDLE)) == np.inf


@pytest.mark.slow
def test_searches_are_repeatable_and_end_inside() -> None:
    design = problem(FAMILIES["rest"], [box(0.7)])
    margins: list[float] = []

    def watch(x: Array) -> None:
        margins.append(design.inequalities.smallest_margin(x))

    runs = [
        {number: search_by_gradient(design, seeded(3, number), watch, 5) for number in numbers}
        for numbers in ([0, 1], [1])
    ]
    np.testing.assert_array_equal(runs[0][1], runs[1][1])
    assert not np.array_equal(runs[0][0], runs[0][1])
    assert min(margins) > 0.0
    for number, x in runs[0].items():
        assert design.inequalities.smallest_margin(x) > 0.0
        first = random_starts(design.inequalities, seeded(3, number), 5)
        assert design.criterion_value(x) < min(design.criterion_value(y) for y in first)


def test_a_search_can_be_stopped() -> None:
    def stop(x: np.ndarray) -> None:
        raise Stopped("enough")

    design = problem(FAMILIES["rest"])
    for method in METHODS.values():
        with pytest.raises(Stopped, match="enough"):
            method(design, seeded(0, 0), stop)


def test_methods_by_name() -> None:
    assert method_of("gradient") is search_by_gradient
    with pytest.raises(DataError) as caught:
        method_of("gradint")
    assert caught.value.wrong == "there is no search method 'gradint'"
    assert "gradient" in caught.value.fix


def test_a_model_of_other_laws_has_a_problem_too() -> None:
    shows = InformationEvaluator(
        replace(MODEL, terms=(*MODEL.terms[:1], Coulomb(smoothing=0.1))),
        np.ones(3),
        np.full(3, 0.01),
    )
    design = replace(problem(FAMILIES["rest"]), cases=[Case(shows, CRITERIA["d_optimal"])])
    assert design.robot is ARM
    x = random_starts(design.inequalities, np.random.default_rng(0), 1)[0]
    assert np.isfinite(design.criterion_value(x))
