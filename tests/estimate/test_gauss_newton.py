"""Bounded Gauss–Newton on problems whose optimum is known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from steelyard.estimate.consistent.log_cholesky_estimator import (
    GaussNewtonResult,
    bounded_gauss_newton,
    bounded_step,
)

Pair = tuple[np.ndarray, np.ndarray]
FREE = np.full(2, np.inf)


@dataclass(frozen=True, eq=False)
class Squares:
    """Half a sum of squares; steps are straight."""

    function: Callable[[np.ndarray], Pair]

    def cost(self, x: np.ndarray) -> float:
        with np.errstate(over="ignore"):
            return 0.5 * float(np.square(self.function(x)[0]).sum())

    def near(self, x: np.ndarray) -> Pair:
        return self.function(x)

    def moved(self, x: np.ndarray, step: np.ndarray, part: float) -> np.ndarray:
        return x + part * step


def least(
    function: Callable[[np.ndarray], Pair],
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    steps: int,
) -> GaussNewtonResult:
    return bounded_gauss_newton(Squares(function), start, lower, upper, steps, 1e-10)


def valley(x: np.ndarray) -> Pair:
    """Rosenbrock's, a narrow curved one, with its optimum at (1, 1)."""
    values = np.array([1.0 - x[0], 10.0 * (x[1] - x[0] ** 2)])
    return values, np.array([[-1.0, 0.0], [-20.0 * x[0], 10.0]])


def test_a_curved_valley() -> None:
    found = least(valley, np.array([-1.2, 1.0]), -FREE, FREE, 100)
    assert found.converged
    assert np.allclose(found.x, 1.0, atol=1e-4)
    assert found.promise < 1e-9


def test_bounds_that_hold() -> None:
    lower, upper = np.array([-2.0, -2.0]), np.array([0.5, 2.0])
    found = least(valley, np.array([-1.2, 1.0]), lower, upper, 200)
    wanted = least_squares(
        lambda x: valley(x)[0], [0.4, 0.1], bounds=(lower, upper), xtol=1e-15, ftol=1e-15
    )
    assert found.converged
    assert found.x[0] == pytest.approx(0.5, abs=1e-9)
    assert found.x[1] == pytest.approx(0.25, abs=1e-5)
    assert found.cost <= wanted.cost * (1.0 + 1e-8)


def test_a_linear_problem_is_bounded_least_squares() -> None:
    rng = np.random.default_rng(0)
    matrix, right = rng.normal(size=(30, 8)), rng.normal(size=30)
    lower, upper = np.full(8, -0.05), np.full(8, 0.05)
    found = least(lambda x: (matrix @ x - right, matrix), np.zeros(8), lower, upper, 50)
    wanted = lsq_linear(matrix, right, (lower, upper), method="bvls", tol=1e-14)
    assert found.converged
    assert 0 < np.sum(np.abs(wanted.x) == 0.05) < 8
    assert np.allclose(found.x, wanted.x, atol=1e-6)


def test_steps_that_overflow_are_shortened() -> None:
    def grown(x: np.ndarray) -> Pair:
        return np.exp(x) - 5.0, np.diag(np.exp(x))

    found = least(grown, np.array([-10.0]), -FREE[:1], FREE[:1], 200)
    assert found.converged
    assert found.x[0] == pytest.approx(np.log(5.0), abs=1e-4)


def test_too_few_steps_are_not_an_optimum() -> None:
    found = least(valley, np.array([-1.2, 1.0]), -FREE, FREE, 3)
    assert not found.converged
    assert found.promise > 1e-6
    assert found.steps == 3


def test_a_step_within_bounds_is_the_best_one() -> None:
    rng = np.random.default_rng(3)
    slopes, residuals = (
        rng.normal(size=(20, 6)) * 10.0 ** rng.uniform(-3, 3, 6),
        rng.normal(size=20),
    )
    low, high = np.full(6, -np.inf), np.full(6, np.inf)
    low[[0, 3]], high[[1, 3]] = 0.0, [0.0, 1e-6]
    step = bounded_step(residuals, slopes, low, high)
    wanted = lsq_linear(slopes, -residuals, (low - 1e-300, high + 1e-300), method="bvls", tol=1e-15)
    assert np.any((step == low) | (step == high))
    assert np.all((step >= low) & (step <= high))
    assert np.linalg.norm(slopes @ step + residuals) <= np.sqrt(2.0 * wanted.cost) * (1.0 + 1e-12)


@pytest.mark.parametrize(("digits", "converged"), [(9, True), (2, False)])
def test_where_rounding_hides_all_gain_it_has_converged_and_elsewhere_not(
    digits: int, converged: bool
) -> None:
    class Rough(Squares):
        """Coarse digits: near its optimum no step gains anything."""

        def cost(self, x: np.ndarray) -> float:
            return float(np.round(super().cost(x), digits))

    def bent(x: np.ndarray) -> Pair:
        return np.array([1.0 - x[0], x[0] ** 2]), np.array([[-1.0], [2.0 * x[0]]])

    found = bounded_gauss_newton(Rough(bent), np.array([2.0]), -FREE[:1], FREE[:1], 100, 0.0)
    assert found.converged == converged
    assert found.steps < 100
