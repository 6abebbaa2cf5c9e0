r"""A consistent estimate from a point near it, by Newton's method.

An interior-point solver comes near the optimum in a dozen steps and needs as many again for the
digits that the weighted squares show; it cannot begin at the solution of a similar problem. Within
consistent bodies the objective is smooth: with the bounds that hold as equations, a few Newton
steps, shortened while they gain nothing, end at rounding. The problem is convex, so a point with
no slope, bounds that hold pulling outward, is the optimum; where that cannot be confirmed, or a
body lies at the margin of physical consistency, nothing is returned.
"""

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimation.consistent.program import Program

ROUNDS = 30
"""Most Newton steps and changes of the bounds that hold."""

NEAR = 1e-6
"""Slack of a bound that is taken to hold at first, the row in unit length."""

SMALL = 1e-20
"""Decrement, relative to the cost, at which there is nothing left to gain."""

ROUNDING = 1e-12
"""Rise of the cost, relative to it, that is rounding."""

HALVINGS = 6
"""Most times that a step is halved."""


def polished(program: Program, u: Array, gamma: float) -> Array | None:
    """The optimum from a point near it; `None` where it cannot be confirmed.

    Args:
        program: The program.
        u: The point, shape `(m,)`.
        gamma: Weight of the prior.
    """
    if not _inside(program, u):
        return None
    rows, ends, equal = _planes(program)
    slack = ends - rows @ u
    if slack.min(initial=0.0) < -NEAR or np.abs(slack[equal]).max(initial=0.0) > NEAR:
        return None
    holds = equal | (slack <= NEAR)
    data = program.unknowns.matrix.T @ program.unknowns.matrix
    for _ in range(ROUNDS):
        curved = program.precision(u, gamma) + data
        off = (ends - rows @ u)[holds]
        try:
            step, pulls = _newton(curved, program.slope(u, gamma), rows[holds], off)
        except np.linalg.LinAlgError:
            return None
        wrong = (pulls < 0.0) & ~equal[holds]
        if wrong.any():
            holds[np.flatnonzero(holds)[int(np.argmin(np.where(wrong, pulls, 0.0)))]] = False
            continue
        room, first = _share(rows, ends, holds, u, step)
        share = _gaining(program, gamma, u, room * step, float(np.abs(pulls) @ np.abs(off)))
        if share is None:
            return None
        u = u + share * room * step
        if share < 1.0:
            continue
        if room < 1.0:
            holds[first] = True
        elif step @ curved @ step <= SMALL * max(1.0, program.cost(u, gamma)):
            return u
    return None


def _planes(program: Program) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Bounds and constraints as rows, each at most an end; and which are equations."""
    constraints = program.constraints
    equal = constraints.equal
    low, high = np.isfinite(constraints.lower) & ~equal, np.isfinite(constraints.upper) & ~equal
    rows = np.vstack(
        [constraints.matrix[equal], -constraints.matrix[low], constraints.matrix[high]]
    )
    ends = np.concatenate(
        [constraints.upper[equal], -constraints.lower[low], constraints.upper[high]]
    )
    return rows, ends, np.arange(len(rows)) < int(equal.sum())


def _newton(curved: Array, slope: Array, rows: Array, ends: Array) -> tuple[Array, Array]:
    """The step to the optimum of the model on the rows, and how hard each row is pulled."""
    m, count = len(slope), len(rows)
    scale = 1.0 / np.sqrt(np.diag(curved))
    matrix = np.zeros((m + count, m + count))
    matrix[:m, :m] = curved * scale[:, None] * scale
    matrix[:m, m:] = (rows * scale).T
    matrix[m:, :m] = rows * scale
    found = np.linalg.solve(matrix, np.concatenate([-slope * scale, ends]))
    return found[:m] * scale, found[m:]


def _share(
    rows: Array, ends: Array, holds: NDArray[np.bool_], u: Array, step: Array
) -> tuple[float, int]:
    """How much of a step the other bounds leave, and which is reached first."""
    ahead = rows @ step
    slack = np.maximum(ends - rows @ u, 0.0)
    free = ~holds & (ahead > 0.0)
    shares = np.where(free, slack / np.where(free, ahead, 1.0), np.inf)
    first = int(np.argmin(shares)) if len(shares) else 0
    return min(1.0, float(shares.min(initial=np.inf))), first


def _gaining(program: Program, gamma: float, u: Array, step: Array, allowed: float) -> float | None:
    """Share of a step with all bodies inside that gains; `None` if none does.

    Args:
        program: The program.
        gamma: Weight of the prior.
        u: Where the step begins, shape `(m,)`.
        step: The step, shape `(m,)`.
        allowed: What it may cost to fulfil the rows that hold.
    """
    most = program.cost(u, gamma)
    most += allowed + ROUNDING * max(1.0, most)
    for halvings in range(HALVINGS + 1):
        share = 0.5**halvings
        end = u + share * step
        if _inside(program, end) and program.cost(end, gamma) <= most:
            return share
    return None


def _inside(program: Program, u: Array) -> bool:
    """Whether every body is well within the margin."""
    margin = program.form.margin
    return bool(
        np.linalg.eigvalsh(program.unknowns.pseudo(u))[:, 0].min(initial=np.inf) > 1.01 * margin
    )
