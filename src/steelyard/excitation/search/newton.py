r"""Minimise a criterion within walls: a barrier, and Newton's method on it.

$f(x) + \mu\,b(x)$ is minimised for falling $\mu$ while the criterion $f$ becomes sharper. The
barrier's second derivatives are exact, those of the criterion are learnt from its slopes (damped
BFGS [Nocedal2006]): every step is a small linear system, and no step leaves the walls.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.barrier import Barrier, Walls
from steelyard.progress import Stopped

Objective = Callable[[Array, float], tuple[float, Array]]
"""Coefficients and sharpness to the value to be minimised and its slope."""

Watch = Callable[[Array], None]
"""Told of every step's coefficients; may raise `progress.Stopped`."""

STAGES = ((4.0, 1e-1), (4.0, 1e-2), (16.0, 1e-2), (16.0, 1e-3), (64.0, 1e-3), (64.0, 1e-4))
"""Sharpness and weight of the barrier, one after the other."""

BACK = ((16.0, 1e-1), (64.0, 1e-2), (64.0, 1e-3), (64.0, 1e-4))
"""From a minimum off the walls and to them again: then they can keep more than before."""

_TO_WALL = 0.95
_ENOUGH = 1e-4
_SHRINK = 0.4
_TRIALS = 12


class Deadline:
    """Watches a search, and ends it when its time is spent.

    Args:
        at: When that is, of `time.monotonic`.
        begun: Where the search begins, if it does so inside the walls.

    Attributes:
        latest: The last coefficients that it was told of, if any.
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
    slope: Array
    barrier: Barrier


def minimised(
    objective: Objective,
    walls: Walls,
    x: Array,
    *,
    stages: tuple[tuple[float, float], ...] = STAGES,
    extra: Sequence[Array] = (),
    between: bool = True,
    steps: int = 60,
    tolerance: float = 1e-3,
    watch: Watch = lambda x: None,
) -> Array:
    """The nearest minimum from a motion inside the walls.

    Args:
        objective: What is minimised, like the logarithm of a figure.
        walls: What may not be touched.
        x: Where to begin, strictly inside; shape `(n, m)`.
        stages: Sharpness and weight of the barrier, one after the other.
        extra: What each constraint's margins keep on top, each `(k,)`; nothing if empty.
        between: Whether every stage keeps free what margins dip between samples; see
            `Walls.reserving`.
        steps: Most steps per stage.
        tolerance: Predicted gain of a step at which a stage ends.
        watch: Told of every step.
    """
    curvature = np.eye(x.size)
    for sharpness, weight in stages:
        inner = walls.reserving(x, extra) if between else walls
        point = _at(objective, inner, x, sharpness)
        if point is None:
            return x
        for _ in range(steps):
            watch(point.x)
            moved, gain = _step(objective, inner, point, curvature, sharpness, weight)
            if moved is None:
                break
            curvature = _learnt(curvature, moved.x - point.x, moved.slope - point.slope)
            point = moved
            if gain < tolerance:
                break
        x = point.x
    return x


def minimised_by(
    deadline: float,
    objective: Objective,
    walls: Walls,
    x: Array,
    *,
    stages: tuple[tuple[float, float], ...],
    extra: Sequence[Array] = (),
) -> Array:
    """See `minimised`; where that is not reached by the deadline, how far it came."""
    watch = Deadline(deadline, x)
    try:
        return minimised(objective, walls, x, stages=stages, extra=extra, watch=watch)
    except Stopped:
        return watch.latest[0]


def _at(objective: Objective, walls: Walls, x: Array, sharpness: float) -> _Point | None:
    """The point, if it is inside and shows something."""
    barrier = walls.barrier(x)
    if barrier is None:
        return None
    value, slope = objective(x, sharpness)
    return _Point(x, value, slope, barrier) if np.isfinite(value) else None


def _step(
    objective: Objective,
    walls: Walls,
    point: _Point,
    curvature: Array,
    sharpness: float,
    weight: float,
) -> tuple[_Point | None, float]:
    """A step that lowers criterion and barrier, and the gain that its quadratic model foretold."""
    slope = (point.slope + weight * point.barrier.slope).ravel()
    full = curvature + weight * point.barrier.curvature
    try:
        dx = np.asarray(np.linalg.solve(full, -slope)).reshape(point.x.shape)
    except np.linalg.LinAlgError:  # curvatures too far apart for the digits there are
        dx = np.linalg.lstsq(full, -slope, rcond=None)[0].reshape(point.x.shape)
    gain = -float(slope @ dx.ravel())
    now = point.value + weight * point.barrier.value
    margins, change = walls.linear(point.x), walls.away(dx)
    towards = change < 0.0
    to_wall = np.min(margins[towards] / -change[towards], initial=np.inf)
    size = min(1.0, _TO_WALL * float(to_wall))
    for _ in range(_TRIALS):
        tried = _at(objective, walls, point.x + size * dx, sharpness)
        if tried is not None:
            then = tried.value + weight * tried.barrier.value
            if then <= now - _ENOUGH * size * gain:
                return tried, gain
        size *= _SHRINK
    return None, gain


def _learnt(curvature: Array, dx: Array, change: Array) -> Array:
    """Damped BFGS: stays positive definite whatever the criterion does."""
    step, y = dx.ravel(), change.ravel()
    along = curvature @ step
    bend = float(step @ along)
    if not bend > 0.0:
        return curvature
    agreement = float(step @ y)
    if agreement < 0.2 * bend:
        share = 0.8 * bend / (bend - agreement)
        y = share * y + (1.0 - share) * along
        agreement = float(step @ y)
    return curvature - np.outer(along, along) / bend + np.outer(y, y) / agreement
