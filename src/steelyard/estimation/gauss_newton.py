r"""Nonlinear least squares within bounds: damped Gauss–Newton, every step a bounded linear problem.

A step minimises $\|J d + r\|^2 + \mu\,\|D d\|^2$ within the bounds, with the lengths $D$ of the
columns of $J$, exactly, by an active set [Stark1995]; $\mu$ follows how true the last step's
promise was [Marquardt1963]. It is then bent by the residuals' second derivative along it
[Transtrum2012]: where the valley is narrow and curved, straight steps hardly get on.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array

SETTLED = 1e-10
"""What a step still promises to gain, relative to the criterion or to 1, where it is solved."""

FIRST, LEAST, MOST = 1e-3, 1e-12, 1e12
"""Damping to begin with, and its range."""

FREE = 1e-8
"""Damping up to which a promise is that of Gauss–Newton itself."""

PROBE = 0.01
"""Part of a step after which the residuals are looked at for their curvature."""

BENT = 1.0
"""Longest correction of a step for curvature, relative to the step."""


@dataclass(frozen=True, eq=False)
class Settled:
    """Where it ended.

    Attributes:
        x: The unknowns.
        cost: Half the squares of the residuals.
        promise: What a further step would gain, as far as linear.
        settled: Whether that is next to nothing.
    """

    x: Array
    cost: float
    promise: float
    settled: bool


def bounded_gauss_newton(
    function: Callable[[Array], tuple[Array, Array]],
    start: Array,
    lower: Array,
    upper: Array,
    steps: int,
) -> Settled:
    """Minimise half the sum of squares of residuals.

    Args:
        function: Residuals `(r,)` and their derivatives `(r, k)`.
        start: Within the bounds, shape `(k,)`.
        lower: Shape `(k,)`.
        upper: Shape `(k,)`.
        steps: Most evaluations of the function.
    """
    x, damping, promise = start, FIRST, np.inf
    residuals, slopes = function(x)
    cost = 0.5 * float(residuals @ residuals)
    for _ in range(steps):
        near = _Near(x, residuals, slopes, lower - x, upper - x, damping)
        step = near.step(residuals)
        left = slopes @ step + residuals
        promise = cost - 0.5 * float(left @ left)
        if promise <= SETTLED * max(1.0, cost):
            if damping <= FREE:
                return Settled(x, cost, promise, True)
            damping = max(0.01 * damping, LEAST)
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            trial = np.clip(x + near.bent(function, step), lower, upper)
            there, turned = function(trial)
            reached = 0.5 * float(there @ there)
            truth = (cost - reached) / promise if np.isfinite(turned).all() else -1.0
        if truth > 0.0:
            x, residuals, slopes, cost = trial, there, turned, reached
        factor = 0.1 if truth > 0.75 else 1.0 if truth > 0.25 else 5.0
        damping = float(np.clip(factor * damping, LEAST, MOST))
    return Settled(x, cost, promise, False)


class _Near:
    """The damped linear problem around one place."""

    def __init__(
        self, x: Array, residuals: Array, slopes: Array, low: Array, high: Array, damping: float
    ) -> None:
        self._x, self._residuals, self._slopes = x, residuals, slopes
        self._low, self._high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        self._lengths = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
        damped = np.sqrt(damping) * np.eye(len(x))
        basis, self._triangle = np.linalg.qr(np.vstack([slopes / self._lengths, damped]))
        self._basis = basis[: len(residuals)]

    def step(self, residuals: Array, taken: Array | float = 0.0) -> Array:
        """The step for residuals `(r,)` within the bounds, after another one."""
        from scipy.optimize import lsq_linear

        right = -self._basis.T @ residuals
        ends = [(end - taken) * self._lengths for end in (self._low, self._high)]
        free = np.linalg.solve(self._triangle, right)
        if np.all((free >= ends[0]) & (free <= ends[1])):
            return np.asarray(free / self._lengths)
        ends = [np.minimum(ends[0], -1e-300), np.maximum(ends[1], 1e-300)]
        found = lsq_linear(self._triangle, right, ends, method="bvls", tol=1e-14)
        return np.asarray(found.x / self._lengths)

    def bent(self, function: Callable[[Array], tuple[Array, Array]], step: Array) -> Array:
        """The step along the curve on which the residuals fall as the linear problem has it."""
        probed = function(self._x + PROBE * step)[0] - self._residuals
        bend = (probed / PROBE - self._slopes @ step) / PROBE
        if not np.isfinite(bend).all():
            return step
        turn = self.step(bend, step)
        size, most = (float(np.linalg.norm(self._lengths * d)) for d in (turn, step))
        return step + turn if size <= BENT * most else step
