"""Newton's method from a point nearby: the optimum where it can be confirmed, else nothing."""

from dataclasses import replace

import numpy as np
import pytest

from at_prior import at_prior
from estimate.test_consistent import REGRESSOR, TRUTH, heavier, information_of, known
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    Entropic,
    Form,
    Free,
    Pullback,
    solved,
)
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.consistent.convex_program_and_newton_refinement import Program, polished
from steelyard.estimate.least_squares.weighted_robust_and_whitened import whitened
from steelyard.estimate.prior.body_priors import Row

CONSTRAINTS = (
    Row("mass of tip", {"m.tip": 1.0}, lower=1.05 * TRUTH["m.tip"], upper=1.05 * TRUTH["m.tip"]),
    Row("light left", {"m.left": 1.0}, upper=1.1 * TRUTH["m.left"]),
    Row("smooth", {"viscous.trunk_joint": 1.0}, upper=0.35),
)


def program(form: Form, rows: tuple[Row, ...] = ()) -> Program:
    knowledge = replace(heavier(1.3), rows=rows)
    return Consistent(REGRESSOR.base, knowledge, form).program(whitened(information_of(0.05)))


def at(program: Program, gamma: float, aim: float) -> np.ndarray:
    return solved(program.conic(gamma), "here", aim=aim)[: len(program.unknowns.weak)]


@pytest.mark.parametrize("rows", [(), CONSTRAINTS], ids=["plain", "constraints"])
@pytest.mark.parametrize(
    ("form", "gamma"),
    [(Entropic(), 0.1), (Entropic(), 5.0), (Entropic(), 1e3), (Pullback(), 5.0), (Pullback(), 1e3)],
)
def test_it_ends_where_the_solver_ends(form: Form, gamma: float, rows: tuple[Row, ...]) -> None:
    here = program(form, rows)
    rough, fine = at(here, gamma, 1e-6), at(here, gamma, 1e-12)
    end = polished(here, rough, gamma)
    assert end is not None
    squares = here.unknowns.chi_squared
    assert squares(end) == pytest.approx(squares(fine), rel=1e-9, abs=2e-6)
    assert here.cost(end, gamma) <= here.cost(fine, gamma) + 1e-10 * here.cost(fine, gamma)
    inside = here.constraints.matrix @ end
    assert np.all(
        (inside >= here.constraints.lower - 1e-9) & (inside <= here.constraints.upper + 1e-9)
    )


def test_a_body_at_the_margin_is_left_to_the_solver() -> None:
    here = program(Free())
    assert polished(here, at(here, 0.0, 1e-8), 1.0) is None


def test_a_point_outside_is_left_to_the_solver() -> None:
    here = program(Entropic())
    assert polished(here, -at_prior(here.unknowns), 5.0) is None


def test_a_point_far_away_is_not_called_the_optimum() -> None:
    here = program(Entropic())
    far = at_prior(here.unknowns).copy()
    far[0] = 1e4
    end, fine = polished(here, far, 5.0), at(here, 5.0, 1e-12)
    assert end is None or np.allclose(end, fine, atol=1e-6)


@pytest.mark.parametrize("rows", [(), CONSTRAINTS], ids=["plain", "constraints"])
@pytest.mark.parametrize("form", [Entropic(), Pullback()], ids=lambda form: form.name)
def test_the_solution_with_another_weight_is_near_enough(form: Form, rows: tuple[Row, ...]) -> None:
    here = program(form, rows)
    for before, gamma in ((5.0, 30.0), (30.0, 5.0), (5.0, 0.8)):
        end, fine = polished(here, at(here, before, 1e-12), gamma), at(here, gamma, 1e-12)
        assert end is not None
        assert here.cost(end, gamma) <= here.cost(fine, gamma) * (1.0 + 1e-10)


def test_a_point_beyond_a_constraint_is_left_to_the_solver() -> None:
    here, bound = program(Entropic()), program(Entropic(), CONSTRAINTS)
    assert polished(bound, at(here, 5.0, 1e-12), 5.0) is None


def test_values_of_a_similar_problem_spare_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    consistent = Consistent(REGRESSOR.base, known(rows=CONSTRAINTS))
    _, gamma, near = consistent.values(information_of(0.05))
    alone, _, _ = consistent.values(information_of(0.06), gamma)
    monkeypatch.delattr("steelyard.estimate.consistent.convex_estimator.solved")
    again, same, _ = consistent.values(information_of(0.06), gamma, near)
    assert same == gamma
    np.testing.assert_allclose(again, alone, rtol=1e-7, atol=1e-9)


def test_slopes_are_those_of_the_objective() -> None:
    for form in (Entropic(), Pullback(), Free()):
        here, rng = program(form), np.random.default_rng(0)
        u = at_prior(here.unknowns)
        u[:10] += 0.05 * rng.normal(size=10)
        step = rng.normal(size=len(u))
        numeric = (here.cost(u + 1e-5 * step, 3.0) - here.cost(u - 1e-5 * step, 3.0)) / 2e-5
        assert here.slope(u, 3.0) @ step == pytest.approx(numeric, rel=1e-6)


def test_prior_constraints_hold_to_rounding() -> None:
    estimate = Consistent(REGRESSOR.base, known(rows=CONSTRAINTS))(information_of(0.05))
    assert estimate.standard is not None
    assert estimate.standard.parameters["m.tip"] == pytest.approx(1.05 * TRUTH["m.tip"], abs=1e-12)
