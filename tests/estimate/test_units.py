"""Data that consistent bodies contradict by far are solved in other units of the squares."""

from dataclasses import replace

import numpy as np
import pytest

from at_prior import at_prior
from estimate.test_consistent import REGRESSOR, heavier, information_of
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import solved
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.consistent.convex_program_and_newton_refinement import Program
from steelyard.estimate.least_squares.weighted_robust_and_whitened import whitened


def reversed_efforts(noise: float) -> tuple[Consistent, Program]:
    """The program of data whose efforts have the other sign."""
    estimator = Consistent(REGRESSOR.base, heavier(1.3))
    program = estimator.program(whitened(information_of(noise)))
    unknowns = replace(program.unknowns, vector=-program.unknowns.vector)
    return estimator, replace(program, unknowns=unknowns)


@pytest.mark.parametrize("unit", [1e2, 1e4])
def test_the_optimum_does_not_depend_on_the_unit(unit: float) -> None:
    program = Consistent(REGRESSOR.base, heavier(1.3)).program(whitened(information_of(0.05)))
    one, other = (
        solved(program.conic(5.0, unit=u), "here")[: len(program.unknowns.weak)]
        for u in (1.0, unit)
    )
    np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("noise", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("gamma", [1e-3, 0.3, 10.0])
def test_reversed_efforts_are_solved(noise: float, gamma: float) -> None:
    estimator, program = reversed_efforts(noise)
    u = estimator.solve(program, gamma)
    known = program.unknowns
    assert all(np.linalg.eigvalsh(x)[0] > 0.0 for x in known.pseudo(u))
    least, rng = program.cost(u, gamma), np.random.default_rng(0)
    for _ in range(100):
        inside = at_prior(known).copy()
        inside[: 10 * len(known.priors)] *= np.exp(rng.normal())
        inside[10 * len(known.priors) :] = np.abs(rng.normal(size=len(known.terms)))
        for step in (1e-3, 1e-1):
            assert program.cost(u + step * (inside - u), gamma) >= (1.0 - 1e-4) * least
