"""Correct what a motion lacks between its samples: by a little more optimising, then by size."""

import time
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.barrier import InequalityConstraints, bounds
from steelyard.excitation.problem import Problem
from steelyard.excitation.search.newton import BACK, minimised_by
from steelyard.progress import Progress

_TIMES = 12
_ROUNDING = 1e-9
_NEAR = 1e-4
_EDGE = 0.05
_HALF = 0.5
_PLACES = 41
_HALVINGS = 7

FINEST = 1e-3
"""First share by which a motion is shrunk that cannot be proven."""

LEAST = 0.02
"""Share of a motion below which it is given up."""

REPAIRS = 5
"""Rounds of optimising again before a motion is made smaller."""

CLOSER = 4
"""Most samples of the constraints while repairing, over those while searching."""

MORE = 1.5
"""What is reserved for what a proof lacked."""


@dataclass(frozen=True, eq=False)
class Kept:
    """A motion that keeps the limits of its joints, and what is proven of its constraints.

    Attributes:
        x: Coefficients, shape `(n, m)`.
        proven: Margins of each constraint that hold at all times, `(k,)` each.
    """

    x: Array
    proven: tuple[Array, ...]

    @property
    def holds(self) -> bool:
        """Whether all constraints hold at all times."""
        return all(bool(np.all(margins >= 0.0)) for margins in self.proven)

    @property
    def lacks(self) -> list[Array]:
        """By how much each margin of each constraint is not proven, `(k,)` each."""
        return [np.maximum(-margins, 0.0) for margins in self.proven]


def proven(problem: Problem, x: Array, progress: Progress) -> Kept:
    """What is proven of a motion."""
    motion = problem.basis.motion(x)
    return Kept(x, tuple(c.proven(motion, progress) for c in problem.constraints))


def repaired(problem: Problem, x: Array, deadline: float, progress: Progress) -> Kept | None:
    """The motion with every constraint proven, as far as that can be had.

    What a proof lacks is reserved, with some more, and the motion optimised again from inside the
    feasible set at closer samples, some rounds long or until there is no time.

    Args:
        problem: What is designed.
        x: A motion that is feasible at the samples; its limits may lack between them.
        deadline: When to stop optimising, of `time.monotonic`.
        progress: Told of the proofs.

    Returns:
        The motion, which may lack something still; `None` if not even standing keeps the limits
        of the joints.
    """
    inside = scaled(problem, x)
    if inside is None:
        return None
    extra, inequalities = (
        [np.zeros(len(c.labels)) for c in problem.constraints],
        problem.inequalities,
    )
    kept = proven(problem, inside, progress)
    for _ in range(REPAIRS):
        if kept.holds or time.monotonic() > deadline:
            break
        extra = [e + MORE * lack for e, lack in zip(extra, kept.lacks, strict=True)]
        inequalities = (
            inequalities.refined()
            if len(inequalities.t) < CLOSER * len(problem.inequalities.t)
            else inequalities
        )
        within = _within(problem, inequalities, x)
        x = minimised_by(
            deadline, problem.objective, inequalities, within, stages=BACK, extra=extra
        )
        again = scaled(problem, x)
        if again is None:
            break
        kept = proven(problem, again, progress)
    return kept


def _within(problem: Problem, inequalities: InequalityConstraints, x: Array) -> Array:
    """The motion, or as much of it about one of its postures as is feasible at the samples."""
    if inequalities.smallest_margin(x) > 0.0:
        return x
    best, share = x, 0.0
    for still in (_still(problem, x), _freest(problem, x)):
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            inside = inequalities.smallest_margin(still + middle * (x - still)) > 0.0
            low, high = (middle, high) if inside else (low, middle)
        if low > share:
            best, share = still + low * (x - still), low
    return np.asarray(best)


def scaled(problem: Problem, x: Array) -> Array | None:
    """Every joint's motion about standing at its start, as large as its limits allow at all times.

    What a motion lacks is convex in its size: on the chord between a size that keeps all limits and
    one that does not, nothing is lacking where the chord says so. Where standing is still, the
    chord is exact; extremes are roots of polynomials.

    Returns:
        Coefficients, shape `(n, m)`; `None` if not even standing keeps the limits.
    """
    still = _still(problem, x)
    over = _excess(problem, x)
    good = np.all(over <= 0.0, axis=1)
    if np.all(good):
        return x
    under = np.where(good[:, None], over, _excess(problem, still))
    if np.any(under > 0.0):
        return None
    kept, failed = np.where(good, 1.0, 0.0), np.ones(len(x))
    for _ in range(_TIMES):
        if np.all((failed - kept < _NEAR) | (under.max(axis=1) > -_NEAR)):
            break
        size = kept + (1.0 - _ROUNDING) * _chord(under, over) * (failed - kept)
        excess = _excess(problem, _sized(still, x, size))
        good = np.all(excess <= 0.0, axis=1)
        kept, failed = np.where(good, size, kept), np.where(good, failed, size)
        under, over = (
            np.where(good[:, None], excess, under),
            np.where(good[:, None], over, excess),
        )
    return _sized(still, x, kept)


def _sized(still: Array, x: Array, size: Array) -> Array:
    """A share of every joint's motion, shape `(n, m)`; the very same where it is all of it."""
    part = size[:, None]
    return np.where(part == 1.0, x, still + part * (x - still))


def _chord(under: Array, over: Array) -> Array:
    """Where between two sizes nothing is lacking on the chords of excess, shape `(n,)`."""
    beyond = over > 0.0
    rise = np.where(beyond, over - under, 1.0)
    return np.asarray(np.min(np.where(beyond, -under / rise, 1.0), axis=1))


def _excess(problem: Problem, x: Array) -> Array:
    """By how much extremes are beyond their limits, in half ranges of these, shape `(n, k)`."""
    motion, found = problem.basis.motion(x), list[Array]()
    for order, (lower, upper) in enumerate(bounds(problem.limits)):
        least, most = motion.extremes(order)
        half = 0.5 * (upper - lower)
        found += [(most - upper) / half, (lower - least) / half]
    return np.stack(found, axis=1)


def _still(problem: Problem, x: Array) -> Array:
    """Standing where the motion begins; within the limits, if it begins outside."""
    basis, limits = problem.basis, problem.limits
    start = basis.shapes([0.0], 0)[0] @ x.T + basis.offset([0.0], 0)[0]
    edge = _EDGE * (limits.upper - limits.lower)
    outside = (start <= limits.lower) | (start >= limits.upper)
    inside = np.clip(start, limits.lower + edge, limits.upper - edge)
    return basis.still(np.where(outside, inside, start))


def shrunk(problem: Problem, x: Array, progress: Progress) -> Array | None:
    """The most of a motion that is proven, smaller about standing at one of its postures.

    That is its start, or where not half of it is left so, its freest posture.
    """
    best: tuple[float, Array] | None = None
    start, freest = _still(problem, x), _freest(problem, x)
    for still in (start,) if np.array_equal(start, freest) else (start, freest):
        share = _share(problem, still, x, progress)
        if share is not None and (best is None or share > best[0]):
            best = share, np.asarray(still + share * (x - still))
        if best is not None and best[0] > _HALF:
            break
    return None if best is None else best[1]


def _share(problem: Problem, still: Array, x: Array, progress: Progress) -> float | None:
    """The largest share of the motion about standing that is proven, to a tenth of a percent."""
    failed, step = 1.0, FINEST
    while True:
        kept = max(failed - step, LEAST)
        if _proven(problem, still + kept * (x - still), progress):
            break
        if kept == LEAST:
            return None
        failed, step = kept, 3.0 * step
    while failed - kept > 2.0 * FINEST:
        middle = 0.5 * (failed + kept)
        if _proven(problem, still + middle * (x - still), progress):
            kept = middle
        else:
            failed = middle
    return kept


def _freest(problem: Problem, x: Array) -> Array:
    """Standing at that posture of the motion which is farthest from all constraints."""
    times = np.linspace(0.0, problem.basis.duration, _PLACES)
    places = problem.basis.motion(x).derivative(times, 0)
    still, least = np.zeros_like(places), np.full(len(places), np.inf)
    for constraint in problem.constraints:
        margins = constraint.margins(places, still, still).values
        least = np.minimum(least, (margins / constraint.activation_distance).min(axis=1))
    return problem.basis.still(places[int(np.argmax(least))])


def _proven(problem: Problem, x: Array, progress: Progress) -> bool:
    """Whether all constraints hold at all times."""
    motion = problem.basis.motion(x)
    return all(
        bool(np.all(constraint.proven(motion, progress) >= 0.0))
        for constraint in problem.constraints
    )
