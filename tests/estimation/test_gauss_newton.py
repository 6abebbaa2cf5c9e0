"""Bounded Gauss–Newton on problems whose optimum is known."""

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from steelyard.estimation.gauss_newton import bounded_gauss_newton

Pair = tuple[np.ndarray, np.ndarray]
FREE = np.full(2, np.inf)


def valley(x: np.ndarray) -> Pair:
    """Rosenbrock's, a narrow curved one, with its optimum at (1, 1)."""
    values = np.array([1.0 - x[0], 10.0 * (x[1] - x[0] ** 2)])
    return values, np.array([[-1.0, 0.0], [-20.0 * x[0], 10.0]])


def test_a_curved_valley() -> None:
    found = bounded_gauss_newton(valley, np.array([-1.2, 1.0]), -FREE, FREE, 100)
    assert found.settled
    assert np.allclose(found.x, 1.0, atol=1e-4)
    assert found.promise < 1e-9


def test_bounds_that_hold() -> None:
    lower, upper = np.array([-2.0, -2.0]), np.array([0.5, 2.0])
    found = bounded_gauss_newton(valley, np.array([-1.2, 1.0]), lower, upper, 200)
    wanted = least_squares(
        lambda x: valley(x)[0], [0.4, 0.1], bounds=(lower, upper), xtol=1e-15, ftol=1e-15
    )
    assert found.settled
    assert found.x[0] == pytest.approx(0.5, abs=1e-9)
    assert found.x[1] == pytest.approx(0.25, abs=1e-5)
    assert found.cost <= wanted.cost * (1.0 + 1e-8)


def test_a_linear_problem_is_bounded_least_squares() -> None:
    rng = np.random.default_rng(0)
    matrix, right = rng.normal(size=(30, 8)), rng.normal(size=30)
    lower, upper = np.full(8, -0.05), np.full(8, 0.05)
    found = bounded_gauss_newton(
        lambda x: (matrix @ x - right, matrix), np.zeros(8), lower, upper, 50
    )
    wanted = lsq_linear(matrix, right, (lower, upper), method="bvls", tol=1e-14)
    assert found.settled
    assert 0 < np.sum(np.abs(wanted.x) == 0.05) < 8
    assert np.allclose(found.x, wanted.x, atol=1e-6)


def test_steps_that_overflow_are_shortened() -> None:
    def grown(x: np.ndarray) -> Pair:
        return np.exp(x) - 5.0, np.diag(np.exp(x))

    found = bounded_gauss_newton(grown, np.array([-10.0]), -FREE[:1], FREE[:1], 200)
    assert found.settled
    assert found.x[0] == pytest.approx(np.log(5.0), abs=1e-4)


def test_too_few_steps_are_not_an_optimum() -> None:
    found = bounded_gauss_newton(valley, np.array([-1.2, 1.0]), -FREE, FREE, 3)
    assert not found.settled
    assert found.promise > 1e-6
