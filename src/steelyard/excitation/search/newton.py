r"""Minimise a criterion under inequality constraints: a barrier, and Newton's method on it.

$f(x) + \mu\,b(x)$ is minimised for falling $\mu$ while the criterion $f$ becomes sharper. The
barrier's second derivatives are exact, those of the criterion are learnt from its slopes (damped
BFGS [Nocedal2006]): every step is a small linear system, and every step stays feasible.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.barrier import Barrier, InequalityConstraints
from steelyard.progress import Stopped

Objective = Callable[[Array, float], tuple[float, Array]]
"""Coefficients and sharpness to the value to be minimised and its slope."""

Watch = Callable[[Array], None]
"""Told of every step's coefficients; may raise `progress.Stopped`."""

STAGES = ((4.0, 1e-1), (4.0, 1e-2), (16.0, 1e-2), (16.0, 1e-3), (64.0, 1e-3), (64.0, 1e-4))
"""Sharpness and weight of the barrier, one after the other."""

BACK = ((16.0, 1e-1), (64.0, 1e-2), (64.0, 1e-3), (64.0, 1e-4))
"""From a minimum off the constraints and to them again: then they can keep more than before."""

_FRACTION_TO_BOUNDARY = 0.95
_ENOUGH = 1e-4
_SHRINK = 0.4
_TRIALS = 12


class Deadline:
    """Watches a search, and ends it when its time is spent.

    Args:
        at: When that is, of `time.monotonic`.
        begun: Where the search begins, if it does so in the feasible set.

    Attributes:
        latest: The last coefficients that were reported to it, if any.
    """

    def __init__(self, at: float, *begun: Array) -> None:
        self._at, self.latest = at, list(begun)

    def __call__(self, x: Array) -> None:
        """Keep them; raises `Stopped` past the deadline."""
        self.latest = [x]
        if time.monotonic() > self._at:
            raise Stopped("the time limit is reached")


@dataclass(frozen=True, eq=False)
class _Point:
    x: Array
    value: float
    gradient: Array
    barrier: Barrier


def minimised(
    objective: Objective,
    inequalities: InequalityConstraints,
    x: Array,
    *,
    stages: tuple[tuple[float, float], ...] = STAGES,
    extra: Sequence[Array] = (),
    between: bool = True,
    steps: int = 60,
    tolerance: float = 1e-3,
    watch: Watch = lambda x: None,
) -> Array:
    """The nearest minimum from a motion in the feasible set.

    Args:
        objective: What is minimised, like the logarithm of a criterion.
        inequalities: Inequality constraints of the motion.
        x: Where to begin, strictly inside; shape `(n, m)`.
        stages: Sharpness and weight of the barrier, one after the other.
        extra: What each constraint's margins keep on top, each `(k,)`; nothing if empty.
        between: Whether every stage keeps free what margins dip between samples; see
            `InequalityConstraints.with_reserves`.
        steps: Most steps per stage.
        tolerance: Predicted gain of a step at which a stage ends.
        watch: Told of every step.
    """
    hessian = np.eye(x.size)
    for sharpness, weight in stages:
        inner = inequalities.with_reserves(x, extra) if between else inequalities
        point = _at(objective, inner, x, sharpness)
        if point is None:
            return x
        for _ in range(steps):
            watch(point.x)
            moved, gain = _step(objective, inner, point, hessian, sharpness, weight)
            if moved is None:
                break
            hessian = _learnt(hessian, moved.x - point.x, moved.gradient - point.gradient)
            point = moved
            if gain < tolerance:
                break
        x = point.x
    return x


def minimised_by(
    deadline: float,
    objective: Objective,
    inequalities: InequalityConstraints,
    x: Array,
    *,
    stages: tuple[tuple[float, float], ...],
    extra: Sequence[Array] = (),
) -> Array:
    """See `minimised`; where that is not reached by the deadline, how far it came."""
    watch = Deadline(deadline, x)
    try:
        return minimised(objective, inequalities, x, stages=stages, extra=extra, watch=watch)
    except Stopped:
        return watch.latest[0]


def _at(
    objective: Objective, inequalities: InequalityConstraints, x: Array, sharpness: float
) -> _Point | None:
    """The point, if it is inside and shows something."""
    barrier = inequalities.barrier(x)
    if barrier is None:
        return None
    value, gradient = objective(x, sharpness)
    return _Point(x, value, gradient, barrier) if np.isfinite(value) else None


def _step(
    objective: Objective,
    inequalities: InequalityConstraints,
    point: _Point,
    hessian: Array,
    sharpness: float,
    weight: float,
) -> tuple[_Point | None, float]:
    """A step that lowers criterion and barrier, and the gain that its quadratic model foretold."""
    gradient = (point.gradient + weight * point.barrier.gradient).ravel()
    full = hessian + weight * point.barrier.hessian
    try:
        dx = np.asarray(np.linalg.solve(full, -gradient)).reshape(point.x.shape)
    except np.linalg.LinAlgError:  # curvatures too far apart for the digits there are
        dx = np.linalg.lstsq(full, -gradient, rcond=None)[0].reshape(point.x.shape)
    gain = -float(gradient @ dx.ravel())
    now = point.value + weight * point.barrier.value
    margins, change = inequalities.limit_margins(point.x), inequalities.margin_rates(dx)
    towards = change < 0.0
    to_boundary = np.min(margins[towards] / -change[towards], initial=np.inf)
    size = min(1.0, _FRACTION_TO_BOUNDARY * float(to_boundary))
    for _ in range(_TRIALS):
        tried = _at(objective, inequalities, point.x + size * dx, sharpness)
        if tried is not None:
            then = tried.value + weight * tried.barrier.value
            if then <= now - _ENOUGH * size * gain:
                return tried, gain
        size *= _SHRINK
    return None, gain


def _learnt(hessian: Array, dx: Array, change: Array) -> Array:
    """Damped BFGS: stays positive definite whatever the criterion does."""
    step, y = dx.ravel(), change.ravel()
    along = hessian @ step
    bend = float(step @ along)
    if not bend > 0.0:
        return hessian
    agreement = float(step @ y)
    if agreement < 0.2 * bend:
        share = 0.8 * bend / (bend - agreement)
        y = share * y + (1.0 - share) * along
        agreement = float(step @ y)
    return hessian - np.outer(along, along) / bend + np.outer(y, y) / agreement
