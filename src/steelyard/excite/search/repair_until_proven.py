"""From a motion that is feasible at samples to one that is proven feasible at all times."""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.search.feasibility import NoMotion
from steelyard.excite.search.margins_barrier_and_newton import (
    BACK_STAGES,
    InequalityConstraints,
    minimised_by,
)
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory

_SHRINK_ROUNDS = 12
_ROUNDING = 1e-9
_NEAR_LIMIT = 1e-4
_SIZE_EDGE = 0.05
_HALF_SIZE = 0.5
_POSTURE_PLACES = 41
_HALVINGS = 7

FIRST_SHRINK_SHARE = 1e-3  # first share by which a motion is shrunk that cannot be proven
LEAST_MOTION_SHARE = 0.02  # share of a motion below which it is given up
REPAIRS = 5  # rounds of optimising again before a motion is made smaller
MOST_REPAIR_DENSITY = 4  # most samples of the constraints in repair, over those in the search
REPAIR_RESERVE = 1.5  # what is reserved for what a proof lacked


@dataclass(frozen=True, eq=False)
class Kept:
    """A motion that keeps the limits of its joints, by its coefficients `(n, m)`.

    What is `proven` are the margins of each constraint at all times, `(k,)` each.
    """

    x: Array
    trajectory: ExactTrajectory
    proven: tuple[Array, ...]
    criterion_value: float = math.inf

    @classmethod
    def of(cls, problem: Problem, x: Array) -> "Kept":
        """Prove what can be proven."""
        motion = problem.basis.motion(x)
        return cls(x, motion, tuple(c.proven(motion) for c in problem.constraints))

    @property
    def holds(self) -> bool:
        """Whether all constraints hold at all times."""
        return all(bool(np.all(margins >= 0.0)) for margins in self.proven)


def repaired(problem: Problem, x: Array, deadline: float) -> Kept | None:
    """The motion with every constraint proven, as far as that can be had by the deadline.

    What a proof lacks is reserved, with some more, and the motion optimised again from inside the
    feasible set at closer samples. It may lack something still; `None` if not even standing keeps
    the limits of the joints.
    """
    inside = scaled(problem, x)
    if inside is None:
        return None
    extra = [np.zeros(len(c.labels)) for c in problem.constraints]
    inequalities = problem.inequalities
    kept = Kept.of(problem, inside)
    for _ in range(REPAIRS):
        if kept.holds or time.monotonic() > deadline:
            break
        extra = [
            e + REPAIR_RESERVE * np.maximum(-margins, 0.0)
            for e, margins in zip(extra, kept.proven, strict=True)
        ]
        if len(inequalities.t) < MOST_REPAIR_DENSITY * len(problem.inequalities.t):
            inequalities = inequalities.refined()
        within = _within(problem, inequalities, x)
        x = minimised_by(
            deadline, problem.objective, inequalities, within, stages=BACK_STAGES, extra=extra
        )
        again = scaled(problem, x)
        if again is None:
            break
        kept = Kept.of(problem, again)
    return kept


def _within(problem: Problem, inequalities: InequalityConstraints, x: Array) -> Array:
    """The motion, or as much of it about one of its postures as is feasible at the samples."""
    if inequalities.smallest_margin(x) > 0.0:
        return x
    best, share = x, 0.0
    for still in (_standing_at_start(problem, x), _freest(problem, x)):
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
    chord is exact; extremes are roots of polynomials. `None` if not even standing keeps the limits.
    """
    still = _standing_at_start(problem, x)
    over = _excess(problem, x)
    good = np.all(over <= 0.0, axis=1)
    if np.all(good):
        return x
    under = np.where(good[:, None], over, _excess(problem, still))
    if np.any(under > 0.0):
        return None
    kept, failed = np.where(good, 1.0, 0.0), np.ones(len(x))

    def sized(size: Array) -> Array:
        """A share of every joint's motion; the very same where it is all of it."""
        part = size[:, None]
        return np.where(part == 1.0, x, still + part * (x - still))

    for _ in range(_SHRINK_ROUNDS):
        if np.all((failed - kept < _NEAR_LIMIT) | (under.max(axis=1) > -_NEAR_LIMIT)):
            break
        # where nothing is lacking on the chords of excess
        beyond = over > 0.0
        zero = -under / np.where(beyond, over - under, 1.0)
        chord = np.min(np.where(beyond, zero, 1.0), axis=1)
        size = kept + (1.0 - _ROUNDING) * chord * (failed - kept)
        excess = _excess(problem, sized(size))
        good = np.all(excess <= 0.0, axis=1)
        kept, failed = np.where(good, size, kept), np.where(good, failed, size)
        fits = good[:, None]
        under, over = np.where(fits, excess, under), np.where(fits, over, excess)
    return sized(kept)


def _excess(problem: Problem, x: Array) -> Array:
    """By how much extremes are beyond their limits, in half ranges of these, shape `(n, k)`."""
    motion, found = problem.basis.motion(x), list[Array]()
    for order, (lower, upper) in enumerate(problem.limits.bounds):
        least, most = motion.extremes(order)
        half = 0.5 * (upper - lower)
        found += [(most - upper) / half, (lower - least) / half]
    return np.stack(found, axis=1)


def _standing_at_start(problem: Problem, x: Array) -> Array:
    """Standing where the motion begins; within the limits, if it begins outside."""
    basis, limits = problem.basis, problem.limits
    start = basis.shapes([0.0], 0)[0] @ x.T + basis.offset([0.0], 0)[0]
    edge = _SIZE_EDGE * (limits.upper - limits.lower)
    outside = (start <= limits.lower) | (start >= limits.upper)
    inside = np.clip(start, limits.lower + edge, limits.upper - edge)
    return basis.still(np.where(outside, inside, start))


def shrunk(problem: Problem, x: Array) -> Array | None:
    """The most of a motion that is proven, smaller about standing at one of its postures.

    That is its start, or where not half of it is left so, its freest posture.
    """
    best: tuple[float, Array] | None = None
    start, freest = _standing_at_start(problem, x), _freest(problem, x)
    for still in (start,) if np.array_equal(start, freest) else (start, freest):
        share = _proven_share(problem, still, x)
        if share is not None and (best is None or share > best[0]):
            best = share, np.asarray(still + share * (x - still))
        if best is not None and best[0] > _HALF_SIZE:
            break
    return None if best is None else best[1]


def _proven_share(problem: Problem, still: Array, x: Array) -> float | None:
    """The largest share of the motion about standing that is proven, to a tenth of a percent."""

    def holds(share: float) -> bool:
        """Whether all constraints hold at all times."""
        motion = problem.basis.motion(still + share * (x - still))
        return all(np.all(c.proven(motion) >= 0.0) for c in problem.constraints)

    failed, step = 1.0, FIRST_SHRINK_SHARE
    while True:
        kept = max(failed - step, LEAST_MOTION_SHARE)
        if holds(kept):
            break
        if kept == LEAST_MOTION_SHARE:
            return None
        failed, step = kept, 3.0 * step
    while failed - kept > 2.0 * FIRST_SHRINK_SHARE:
        middle = 0.5 * (failed + kept)
        kept, failed = (middle, failed) if holds(middle) else (kept, middle)
    return kept


def _freest(problem: Problem, x: Array) -> Array:
    """Standing at that posture of the motion which is farthest from all constraints."""
    times = np.linspace(0.0, problem.basis.duration, _POSTURE_PLACES)
    places = problem.basis.motion(x).derivative(times, 0)
    still, least = np.zeros_like(places), np.full(len(places), np.inf)
    for constraint in problem.constraints:
        margins = constraint.margins(places, still, still).values
        least = np.minimum(least, (margins / constraint.activation_distance).min(axis=1))
    return problem.basis.still(places[int(np.argmax(least))])


POLISH_STAGES = ((256.0, 1e-5),)  # last stage: the criterion nearly itself, the barrier nearly gone


def finished(problem: Problem, candidates: Iterable[Array], deadline: float = math.inf) -> Kept:
    """The best of some motions, once each is polished, scaled exactly and proven.

    Candidates are coefficients, the most promising first; at least one is finished. A motion is not
    begun with that would pass the deadline, of `time.monotonic`, by what the slowest before took.
    """
    best: Kept | None = None
    lacking, slowest = list[Array](), 0.0
    for x in candidates:
        if best is not None and time.monotonic() + slowest > deadline:
            break
        for tried in sorted(
            _polished_motions(problem, x, deadline - slowest), key=problem.criterion_value
        ):
            if best is not None and problem.criterion_value(tried) >= best.criterion_value:
                break
            start = time.monotonic()
            kept = repaired(problem, tried, deadline)
            slowest = max(slowest, time.monotonic() - start)
            if kept is None:
                continue
            if not kept.holds:
                lacking.append(kept.x)
                continue
            kept = replace(kept, criterion_value=problem.criterion_value(kept.x))
            if best is None or kept.criterion_value < best.criterion_value:
                best = kept
                break
    if best is None:
        best = _best_made_smaller(problem, lacking, deadline)
    if best is not None and not math.isfinite(best.criterion_value):
        raise DataError(
            "no motion was found that identifies all parameters; a base parameter may be "
            "unidentifiable with all motions of this family within these limits",
            where="[excitation]",
            fix="allow more: harmonics, a longer period, wider limits; or name the laws and "
            "parameters that matter in [excitation.criterion] chosen",
        )
    if best is None:
        raise NoMotion(
            "no motion was found that can be proven to keep all constraints",
            where="excitation",
            fix="widen the boxes or the margins, or give a start posture farther from the limits",
        )
    return best


def _best_made_smaller(problem: Problem, lacking: list[Array], deadline: float) -> Kept | None:
    """Of motions that lack something, the best made smaller until it is proven."""
    best: Kept | None = None
    for x in sorted(lacking, key=problem.criterion_value):
        if best is not None and time.monotonic() > deadline:
            break
        less = shrunk(problem, x)
        value = math.inf if less is None else problem.criterion_value(less)
        if less is not None and (best is None or value < best.criterion_value):
            best = replace(Kept.of(problem, less), criterion_value=value)
    return best


def _polished_motions(problem: Problem, x: Array, deadline: float) -> list[Array]:
    """The motion scaled, and polished if there is time; those that keep the limits of joints."""
    first = scaled(problem, x)
    if first is None or time.monotonic() > deadline:
        return [] if first is None else [first]
    x = minimised_by(deadline, problem.objective, problem.inequalities, first, stages=POLISH_STAGES)
    second = scaled(problem, x)
    return [first] if second is None else [first, second]
