r"""Gauss–Newton within bounds: every step a bounded linear problem, solved exactly.

A step minimises $\|J d + r\|^2$ within the bounds by an active set [Stark1995], and is shortened
until the criterion falls by a fair part of what was promised. How a step is taken is the problem's
own business: along a straight line, or along a curve that begins like it.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from steelyard.arrays import Array

STUCK = 1e-8
"""Gain, relative to the criterion or to 1, that rounding may hide: no step gains anything."""

FAIR = 1e-4
"""Part of the promise that a step has to keep."""

SHORTER = 0.5
"""Factor by which a step that keeps less is shortened."""

SHORTENED = 60
"""How often at most."""


class Problem(Protocol):
    """A criterion that looks like a sum of squares from near by."""

    def cost(self, x: Array) -> float:
        """The criterion; infinite where there is none."""
        ...

    def near(self, x: Array) -> tuple[Array, Array]:
        """Residuals `(r,)` and derivatives `(r, k)`.

        Half their squares have the criterion's slope, and its curvature or about that.
        """
        ...

    def moved(self, x: Array, step: Array, part: float) -> Array | None:
        """The place after a part of a step; `None` if there is none."""
        ...


@dataclass(frozen=True, eq=False)
class GaussNewtonResult:
    """Where it ended.

    Attributes:
        x: The unknowns.
        cost: The criterion.
        promise: What a further step would gain, as far as the linear problem knows.
        converged: Whether that is small enough.
        steps: Steps that it took.
    """

    x: Array
    cost: float
    promise: float
    converged: bool
    steps: int


def bounded_gauss_newton(
    problem: Problem,
    start: Array,
    lower: Array,
    upper: Array,
    steps: int,
    tolerance: float,
) -> GaussNewtonResult:
    """Minimise a criterion.

    Args:
        problem: The criterion.
        start: Within the bounds, shape `(k,)`.
        lower: Shape `(k,)`.
        upper: Shape `(k,)`.
        steps: Most steps.
        tolerance: Gain that is not worth a step.
    """
    x, cost, promise = start, problem.cost(start), np.inf
    for number in range(steps):
        residuals, slopes = problem.near(x)
        step = bounded_step(residuals, slopes, lower - x, upper - x)
        change = slopes @ step
        promise = -float((residuals + 0.5 * change) @ change)
        if promise <= tolerance:
            return GaussNewtonResult(x, cost, promise, True, number)
        found = _taken(problem, x, cost, step, promise)
        if found is None:
            return GaussNewtonResult(
                x, cost, promise, promise <= STUCK * max(1.0, abs(cost)), number
            )
        x, cost = np.clip(found[0], lower, upper), found[1]
    return GaussNewtonResult(x, cost, promise, False, steps)


def _taken(
    problem: Problem, x: Array, cost: float, step: Array, promise: float
) -> tuple[Array, float] | None:
    """The place after as much of a step as keeps a fair part of its promise, and the cost there."""
    part = 1.0
    for _ in range(SHORTENED):
        trial = problem.moved(x, step, part)
        reached = np.inf if trial is None else problem.cost(trial)
        if trial is not None and reached < cost - FAIR * part * promise:
            return trial, reached
        part *= SHORTER
    return None


def bounded_step(residuals: Array, slopes: Array, low: Array, high: Array) -> Array:
    """The step `(k,)` of least squares for residuals `(r,)` and slopes `(r, k)` within bounds.

    Only what has bounds takes part in the search for those that hold.
    """
    from scipy.optimize import lsq_linear

    bounded = np.isfinite(low) | np.isfinite(high)
    order = np.argsort(bounded, kind="stable")
    count = int(np.sum(~bounded))
    lengths = np.maximum(np.linalg.norm(slopes[:, order], axis=0), 1e-150)
    basis, triangle = np.linalg.qr(slopes[:, order] / lengths)
    right = -basis.T @ residuals
    step = np.linalg.solve(triangle, right)
    ends = [end[order][count:] * lengths[count:] for end in (low, high)]
    ends = [np.minimum(ends[0], 0.0), np.maximum(ends[1], 0.0)]
    if np.any((step[count:] < ends[0]) | (step[count:] > ends[1])):
        wide = np.minimum(ends[0], -1e-300), np.maximum(ends[1], 1e-300)
        part, rest = triangle[count:, count:], right[count:]
        found = lsq_linear(part, rest, wide, method="bvls", tol=1e-14, max_iter=10 * len(rest))
        step[count:] = np.clip(found.x, *ends)
        top = right[:count] - triangle[:count, count:] @ step[count:]
        step[:count] = np.linalg.solve(triangle[:count, :count], top)
    placed = np.empty(len(step))
    placed[order] = step / lengths
    return placed
