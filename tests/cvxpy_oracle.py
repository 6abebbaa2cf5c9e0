"""The consistent estimate's program in CVXPY's own words; data and priors are all it shares."""

import warnings

import cvxpy as cp
import numpy as np

from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import WIDEST
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.least_squares.weighted_robust_and_whitened import Whitened
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES


def cvxpy_problem(
    data: Whitened, consistent: Consistent, gamma: float
) -> tuple[cp.Problem, cp.Expression]:
    """The program and its weighted squares."""
    base, knowledge = consistent.base, consistent.knowledge
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


def solved(problem: cp.Problem, tolerance: float) -> None:
    """Solve with Clarabel; a result that it calls inaccurate is as good as it gets."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        problem.solve(
            solver=cp.CLARABEL,
            tol_gap_abs=tolerance,
            tol_gap_rel=tolerance,
            tol_feas=tolerance,
            max_iter=300,
        )
    assert problem.status in ("optimal", "optimal_inaccurate"), problem.status
