"""From a motion that keeps its walls at samples to one that is proven to keep them at all times."""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.exact import ExactTrajectory
from steelyard.excitation.newton import minimised
from steelyard.excitation.problem import Problem
from steelyard.excitation.starts import NoMotion
from steelyard.excitation.walls import bounds
from steelyard.progress import Progress, Stopped, silent

POLISH = ((256.0, 1e-5),)
"""Last stage: the criterion nearly itself, the barrier nearly gone."""

_TIMES = 12
_ROUNDING = 1e-9
_NEAR = 1e-4
_EDGE = 0.05
_HALF = 0.5
_PLACES = 41

FINEST = 1e-3
"""First share by which a motion is shrunk that cannot be proven."""

LEAST = 0.02
"""Share of a motion below which it is given up."""


@dataclass(frozen=True, eq=False)
class Finished:
    """A motion whose limits are exact and whose constraints are proven.

    Attributes:
        x: Its coefficients, shape `(n, m)`.
        trajectory: The motion.
        figure: The criterion.
    """

    x: Array
    trajectory: ExactTrajectory
    figure: float


def finished(
    problem: Problem,
    candidates: Iterable[Array],
    deadline: float = math.inf,
    progress: Progress = silent,
) -> Finished:
    """The best of some motions, once each is polished, scaled exactly and proven.

    Args:
        problem: What is designed.
        candidates: Coefficients, the most promising first; at least one.
        deadline: When to stop once there is one, of `time.monotonic`.
        progress: Told of the proofs.

    Raises:
        DataError: No candidate shows all parameters.
        NoMotion: No candidate can be made to keep its constraints.
        Stopped: `progress` asked to stop.
    """
    best: tuple[float, Array] | None = None
    for x in candidates:
        if best is not None and time.monotonic() > deadline:
            break
        for tried in sorted(_tries(problem, x, deadline), key=problem.figure):
            if best is not None and problem.figure(tried) >= best[0]:
                break
            proven = _shrunk(problem, tried, progress)
            if proven is not None and (best is None or problem.figure(proven) < best[0]):
                best = problem.figure(proven), proven
                break
    if best is not None and not math.isfinite(best[0]):
        raise DataError(
            "no motion was found that shows all parameters; a base parameter of the model may show "
            "in no motion of this family within these limits",
            where="[excitation]",
            mend="allow more: harmonics, a longer period, wider limits; or name the laws and "
            "parameters that matter in [excitation.criterion] chosen",
        )
    if best is None:
        raise NoMotion(
            "no motion was found that can be proven to keep all constraints",
            where="excitation",
            mend="widen the boxes or the margins, or give a start posture with more room",
        )
    return Finished(best[1], problem.basis.motion(best[1]), best[0])


def _tries(problem: Problem, x: Array, deadline: float) -> list[Array]:
    """The motion scaled, and polished if there is time; those that keep the limits of joints."""
    first = scaled(problem, x)
    if first is None or time.monotonic() > deadline:
        return [] if first is None else [first]
    second = scaled(problem, _polished(problem, first, deadline))
    return [first] if second is None else [first, second]


def _polished(problem: Problem, x: Array, deadline: float) -> Array:
    """The motion after the last stage, or as far as that came in time."""
    latest = [x]

    def watch(x: Array) -> None:
        latest[:] = [x]
        if time.monotonic() > deadline:
            raise Stopped("the time is spent")

    try:
        return minimised(problem.objective, problem.walls, x, stages=POLISH, watch=watch)
    except Stopped:
        return latest[0]


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


def _shrunk(problem: Problem, x: Array, progress: Progress) -> Array | None:
    """The motion, or the most of it that is proven, smaller about standing at one of its postures.

    That is its start, or where not half of it is left so, its freest posture.
    """
    if not problem.constraints or _proven(problem, x, progress):
        return x
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
        least = np.minimum(least, (margins / constraint.room).min(axis=1))
    return problem.basis.still(places[int(np.argmax(least))])


def _proven(problem: Problem, x: Array, progress: Progress) -> bool:
    """Whether all constraints hold at all times."""
    motion = problem.basis.motion(x)
    return all(
        bool(np.all(constraint.proven(motion, progress) >= 0.0))
        for constraint in problem.constraints
    )
