"""The consistent estimate's optimum against CVXPY with Clarabel, and how many solutions it takes.

The same program, written by hand in CVXPY's own words from the whitened data and the priors: only
these two are shared. Twenty problems: seven links, noise, motion and priors drawn anew in each.
CVXPY gets a tolerance of 1e-12: with 1e-10 its own squares are off by up to 7e-5.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.consistent_cases import drawn, perturbed

from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.least_squares.weighted_robust_and_whitened import whitened

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from cvxpy_oracle import cvxpy_problem, solved  # noqa: E402

PROBLEMS, GAMMAS = 20, (1.0, 10.0, 100.0)


def differences() -> Iterator[tuple[float, float, int]]:
    """Per problem: half the squares' difference, relative difference of the cost, solutions."""
    for seed in range(PROBLEMS):
        case = drawn("panda", seed)
        knowledge = perturbed(case, np.random.default_rng(seed))
        consistent = Consistent(case.regressor.base, knowledge)
        data = whitened(case.information)
        program, gamma = consistent.program(data), GAMMAS[seed % len(GAMMAS)]
        u = consistent.solve(program, gamma)
        problem, squares = cvxpy_problem(data, consistent, gamma)
        solved(problem, 1e-12)
        mine = program.unknowns.chi_squared(u)
        found = consistent.weighed(data, program)
        yield 0.5 * abs(mine - float(squares.value)), mine, found.solves


def main() -> list[Claim]:
    """Greatest difference, and greatest number of solutions of a search."""
    rows = list(differences())
    worst, most = max(row[0] for row in rows), max(row[2] for row in rows)
    return [
        Claim(
            f"chi²/2 against CVXPY, {PROBLEMS} problems", f"{worst:.1e}", "<= 1e-6", worst <= 1e-6
        ),
        Claim("solutions of a search for the prior's weight", f"{most}", "<= 15", most <= 15),
    ]


if __name__ == "__main__":
    main_of(main)
