"""The consistent estimate's optimum against CVXPY with Clarabel, and how many solutions it takes.

The same program, written by hand in CVXPY's own words from the whitened data and the priors: only
these two are shared. Twenty problems: seven links, noise, motion and priors drawn anew in each.
CVXPY gets a tolerance of 1e-12: with 1e-10 its own squares are off by up to 7e-5.
"""

from collections.abc import Iterator

import cvxpy as cp
import numpy as np
from claims import Claim, main_of
from consistent_cases import drawn, perturbed

from steelyard.estimation.consistent import Consistent
from steelyard.estimation.unknowns import WIDEST
from steelyard.estimation.whitened import Whitened, whitened
from steelyard.regression.regressor import Regressor
from steelyard.robot.inertia import INERTIAL_NAMES

PROBLEMS, GAMMAS = 20, (1.0, 10.0, 100.0)


def cvxpy_problem(
    data: Whitened, regressor: Regressor, consistent: Consistent, gamma: float
) -> tuple[cp.Problem, cp.Expression]:
    """The program and its weighted squares."""
    base, knowledge = regressor.base, consistent.knowledge
    phi: dict[str, cp.Expression] = {}
    cost, constraints = 0.0, []
    for body, prior in zip(knowledge.bodies, knowledge.priors, strict=True):
        assert prior is not None
        factor = np.linalg.cholesky(prior.pseudo)
        x = cp.Variable((4, 4), PSD=True)
        pseudo = factor @ x @ factor.T
        inertia = cp.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
        places = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
        ten = [pseudo[3, 3], *(pseudo[k, 3] for k in range(3)), *(inertia[p] for p in places)]
        phi |= {f"{n}.{body}": v for n, v in zip(INERTIAL_NAMES, ten, strict=True)}
        cost += gamma * (cp.trace(x) - cp.log_det(x))
        constraints.append(x >> consistent.form.margin * np.eye(4))
    place = {name: k for k, name in enumerate(base.base_names)}
    lift = base.lift[[place[name] for name in data.names]]
    lengths = np.linalg.norm(data.matrix @ lift, axis=0)
    for k, name in enumerate(base.names):
        if name in phi:
            continue
        phi[name] = cp.Variable()
        cost += 0.5 * cp.square(phi[name] * lengths[k] / data.effort / WIDEST)
        if np.isfinite(knowledge.lower[k]):
            constraints.append(phi[name] >= knowledge.lower[k])
    full = cp.hstack([phi[name] for name in base.names])
    squares = cp.sum_squares(data.matrix @ lift @ full - data.vector)
    return cp.Problem(cp.Minimize(0.5 * squares + cost), constraints), squares


def differences() -> Iterator[tuple[float, float, int]]:
    """Per problem: half the squares' difference, relative difference of the cost, solutions."""
    for seed in range(PROBLEMS):
        case = drawn("panda", seed)
        knowledge = perturbed(case, np.random.default_rng(seed))
        consistent = Consistent(case.regressor.base, knowledge)
        data = whitened(case.information)
        program, gamma = consistent.program(data), GAMMAS[seed % len(GAMMAS)]
        u = consistent.solve(program, gamma)
        problem, squares = cvxpy_problem(data, case.regressor, consistent, gamma)
        problem.solve(
            solver=cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12, max_iter=300
        )
        assert problem.status in ("optimal", "optimal_inaccurate"), problem.status
        mine = program.unknowns.chi_squared(u)
        found = consistent.weighed(program)
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
