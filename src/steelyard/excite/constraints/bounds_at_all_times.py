r"""What holds at all times of a motion: bounds over stretches of time, and their refinement.

Between two breaks a motion is smooth and its snap bounded, $|q^{(4)}| \le S$, so within $r$ of a
stretch's middle the jerk is at most $J = |\dddot q_m| + S r$, or what it is over all times, and

$$|q - q_m| \le |\dot q_m| r + |\ddot q_m| r^2/2 + J r^3/6, \quad
  |\dot q - \dot q_m| \le |\ddot q_m| r + J r^2/2, \quad |\ddot q - \ddot q_m| \le J r.$$

A least margin is proven by bounding it over every stretch, and again over parts of those
stretches whose bound is still too far below the least margin that was seen at a middle. Where that
margin is small but kept, it is the sign that counts: half of it is too far then.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.symbolic.interval_bounds import enclosed
from steelyard.symbolic.program_and_softening import Program

STRETCHES = 512  # stretches of time to begin with
MOST_STRETCHES = 100_000  # stretches after which a proof ends with the bound that it has

_PIECES = 8
_ROUNDING = 1e-12
_FINEST = 0.02


@dataclass(frozen=True, eq=False)
class Stretches:
    """Stretches of time, by middles and half lengths `(B,)` [s], and where a motion is within them.

    Position, velocity, acceleration and jerk at the middles (`at`), their bounds over the
    stretches, each `(n, B)`, and how far those at the middles may be from the motion's, each `(n,
    1)`.
    """

    middle: Array
    half: Array
    at: tuple[Array, ...]
    lower: tuple[Array, ...]
    upper: tuple[Array, ...]
    rounding: tuple[Array, ...]

    def middles(self, program: Program, *shared: Array) -> tuple[Array, Array]:
        """Bounds of a program at the middles, each `(outputs, B)`.

        It takes as many of position, velocity, acceleration and jerk, in this order, as it has
        inputs beside `shared`, which do not change in time.
        """
        count = len(program.inputs) - len(shared)
        lower = [x - r for x, r in zip(self.at[:count], self.rounding, strict=False)]
        upper = [x + r for x, r in zip(self.at[:count], self.rounding, strict=False)]
        return enclosed(program, [*lower, *shared], [*upper, *shared])

    def throughout(self, program: Program, *shared: Array) -> tuple[Array, Array]:
        """Bounds of a program over the whole stretches; see `middles`."""
        count = len(program.inputs) - len(shared)
        return enclosed(program, [*self.lower[:count], *shared], [*self.upper[:count], *shared])


Bound = Callable[[Stretches], tuple[Array, Array]]
"""Lower bounds of `k` margins at the middles of stretches and all over them, each `(k, B)`."""


class Course:
    """A motion with the bounds of its derivatives over all times."""

    def __init__(self, trajectory: ExactTrajectory) -> None:
        self._trajectory, self.duration = trajectory, trajectory.duration
        ends = [trajectory.extremes(order) for order in range(4)]
        sizes = [np.maximum(np.abs(low), np.abs(high))[:, None] for low, high in ends]
        self._rounding = tuple(_ROUNDING * size for size in sizes)
        self._least = [low[:, None] - r for (low, _), r in zip(ends, self._rounding, strict=True)]
        self._most = [high[:, None] + r for (_, high), r in zip(ends, self._rounding, strict=True)]
        self._jerk = sizes[3] + self._rounding[3]
        snap = np.maximum(*(np.abs(end) for end in trajectory.extremes(4)))[:, None]
        self._snap = (1.0 + _ROUNDING) * snap

    def edges(self, count: int) -> Array:
        """Times from start to end, the breaks and about `count` more, ascending."""
        breaks = np.unique(np.concatenate([[0.0, self.duration], self._trajectory.breaks]))
        longest = self.duration / count
        numbers = np.ceil(np.diff(breaks) / longest * (1.0 - 1e-9)).astype(int).clip(1)
        parts = [
            np.linspace(start, end, number, endpoint=False)
            for start, end, number in zip(breaks[:-1], breaks[1:], numbers, strict=True)
        ]
        return np.concatenate([*parts, breaks[-1:]])

    def stretches(self, start: Array, end: Array) -> Stretches:
        """Stretches from `start` to `end`, each `(B,)` [s], none of them across a break."""
        middle = 0.5 * (start + end)
        # a little more than half: the middle is rounded
        half = 0.5 * (end - start) * (1.0 + 1e-9) + 1e-15 * self.duration
        at = tuple(self._trajectory.derivative(middle, order).T for order in range(4))
        reach = self._reach(at, half)
        away = [r + s for r, s in zip(reach, self._rounding, strict=True)]
        lower = tuple(np.maximum(x - a, g) for x, a, g in zip(at, away, self._least, strict=True))
        upper = tuple(np.minimum(x + a, g) for x, a, g in zip(at, away, self._most, strict=True))
        return Stretches(middle, half, at, lower, upper, self._rounding)

    def _reach(self, at: Sequence[Array], half: Array) -> list[Array]:
        """How far position, velocity, acceleration and jerk come from the middle's, `(n, B)`."""
        _, speed, bend, jerk = (np.abs(x) + r for x, r in zip(at, self._rounding, strict=True))
        jerk = np.minimum(jerk + half * self._snap, self._jerk)
        reach = [
            half * (speed + half * (bend / 2.0 + half * jerk / 6.0)),
            half * (bend + half * jerk / 2.0),
            half * jerk,
            half * self._snap,
        ]
        return [x * (1.0 + 1e-9) for x in reach]


def proven_minimum(
    trajectory: ExactTrajectory, bound: Bound, tolerance: Array, count: int = STRETCHES
) -> Array:
    """Lower bounds of margins that hold at all times, `(k,)`.

    A bound may stay the tolerance, `(k,)`, below the least margin at a middle, or a fiftieth of
    that where it decides whether the margin is kept. Begins with `count` stretches.
    """
    course = Course(trajectory)
    edges = course.edges(count)
    start, end = edges[:-1], edges[1:]
    seen = np.full(len(tolerance), np.inf)
    proven = seen.copy()
    used = len(start)
    while len(start):
        values, lower = bound(course.stretches(start, end))
        seen = np.minimum(seen, values.min(axis=1))
        spare = values - goals(seen, tolerance)[:, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = ((values - lower) / spare).max(axis=0)
        open_ = ~(ratio <= 1.0)
        pieces = np.clip(np.nan_to_num(np.ceil(ratio), nan=_PIECES), 2, _PIECES).astype(np.intp)
        used += int(pieces[open_].sum())
        if used > MOST_STRETCHES:
            open_[:] = False
        if not open_.all():
            proven = np.minimum(proven, lower[:, ~open_].min(axis=1))
        start, end, _ = cut(start[open_], end[open_], pieces[open_])
    return proven


def goals(seen: Array, tolerance: Array) -> Array:
    """The bounds of margins that are good enough, from the least margins seen, shape `(k,)`."""
    sharp = np.clip(0.5 * seen, _FINEST * tolerance, tolerance)
    return seen - np.where(seen > 0.0, sharp, tolerance)


def cut(
    start: Array, end: Array, pieces: NDArray[np.intp]
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Every stretch in as many equal parts as requested, without gaps; and whose each is."""
    owner = np.repeat(np.arange(len(pieces)), pieces)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    origin, length = start[owner], ((end - start) / pieces)[owner]
    return origin + number * length, origin + (number + 1) * length, owner
