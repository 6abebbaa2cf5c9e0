r"""Newton's method on a criterion with a logarithmic barrier of inequality constraints.

Limits of joints are linear in the coefficients, $o_{jr} - \totali s_{ri} x_{ji} \ge 0$; their
barrier is $-\sum \log$ of the margins in units of the limit. Other constraints matter only nearer
than their activation distance: with $s$ the margin over the activation distance their barrier is
$-\log s - (1 - s) - \tfrac12 (1 - s)^2$ for $s < 1$ and zero beyond, twice differentiable at 1.

$f(x) + \mu\,b(x)$ is minimised for falling $\mu$ while the criterion $f$ becomes sharper. The
barrier's second derivatives are exact, those of the criterion are learnt from its slopes (damped
BFGS [Nocedal2006]): every step is a small linear system, and every step stays feasible.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.progress import Stopped
from steelyard.excite.search.inequality_constraints import Barrier, InequalityConstraints

ObjectiveFunction = Callable[[Array, float], tuple[float, Array]]
"""Coefficients and sharpness to the value to be minimised and its slope."""

StepWatch = Callable[[Array], None]  # told of every step; may raise `Stopped`

STAGES = ((4.0, 1e-1), (4.0, 1e-2), (16.0, 1e-2), (16.0, 1e-3), (64.0, 1e-3), (64.0, 1e-4))
"""Sharpness and weight of the barrier, one after the other."""

BACK_STAGES = ((16.0, 1e-1), (64.0, 1e-2), (64.0, 1e-3), (64.0, 1e-4))
"""From a minimum off the constraints and to them again: then they can keep more than before."""

_FRACTION_TO_BOUNDARY = 0.95
_ENOUGH_GAIN = 1e-4
_STEP_SHRINK = 0.4
_STEP_TRIALS = 12


class Deadline:
    """Ends a search at a time of `time.monotonic`, and keeps the latest coefficients, if any.

    A search that begins in the feasible set gives them where it does so.
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


@dataclass(frozen=True, eq=False)
class _Stage:
    """What is minimised at one sharpness of the criterion and one weight of the barrier."""

    objective: ObjectiveFunction
    inequalities: InequalityConstraints
    sharpness: float
    weight: float

    def at(self, x: Array) -> _Point | None:
        """The point, if it is inside and shows something."""
        barrier = self.inequalities.barrier(x)
        if barrier is None:
            return None
        value, gradient = self.objective(x, self.sharpness)
        return _Point(x, value, gradient, barrier) if np.isfinite(value) else None

    def step(self, point: _Point, hessian: Array) -> tuple[_Point | None, float]:
        """A step that lowers criterion and barrier, and the gain that its model foretold."""
        inequalities, weight = self.inequalities, self.weight
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
        for _ in range(_STEP_TRIALS):
            tried = self.at(point.x + size * dx)
            if tried is not None:
                then = tried.value + weight * tried.barrier.value
                if then <= now - _ENOUGH_GAIN * size * gain:
                    return tried, gain
            size *= _STEP_SHRINK
        return None, gain


def minimised(
    objective: ObjectiveFunction,
    inequalities: InequalityConstraints,
    x: Array,
    *,
    stages: tuple[tuple[float, float], ...] = STAGES,
    extra: Sequence[Array] = (),
    between: bool = True,
    steps: int = 60,
    tolerance: float = 1e-3,
    watch: StepWatch = lambda x: None,
) -> Array:
    """The nearest minimum of an objective from a motion strictly inside, `(n, m)`.

    Stages are sharpness and weight of the barrier, one after the other, of most `steps` each; one
    ends where the predicted gain of a step is below the tolerance. Each constraint's margins keep
    `extra` on top, `(k,)` each, if given, and with `between` what they dip between samples, see
    `with_reserves`.
    """
    hessian = np.eye(x.size)
    for sharpness, weight in stages:
        inner = inequalities.with_reserves(x, extra) if between else inequalities
        stage = _Stage(objective, inner, sharpness, weight)
        point = stage.at(x)
        if point is None:
            return x
        for _ in range(steps):
            watch(point.x)
            moved, gain = stage.step(point, hessian)
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
    objective: ObjectiveFunction,
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
