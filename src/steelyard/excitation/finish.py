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
from steelyard.excitation.walls import bounds
from steelyard.progress import Progress, silent

POLISH = ((256.0, 1e-5),)
"""Last stage: the criterion nearly itself, the barrier nearly gone."""

_TIMES = 8
_ROUNDING = 1e-9

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
        DataError: No candidate can be made to keep its constraints.
        Stopped: `progress` asked to stop.
    """
    best: tuple[float, Array] | None = None
    for x in candidates:
        if best is not None and time.monotonic() > deadline:
            break
        tries = [scaled(problem, x)]
        if time.monotonic() < deadline:
            polished = minimised(problem.objective, problem.walls, tries[0], stages=POLISH)
            tries.append(scaled(problem, polished))
        for tried in sorted(tries, key=problem.figure):
            if best is not None and problem.figure(tried) >= best[0]:
                break
            proven = _shrunk(problem, tried, progress)
            if proven is not None and (best is None or problem.figure(proven) < best[0]):
                best = problem.figure(proven), proven
                break
    if best is None:
        raise DataError(
            "no motion was found that can be proven to keep all constraints",
            where="excitation",
            mend="widen the boxes or the margins, or give a start posture with more room",
        )
    return Finished(best[1], problem.basis.motion(best[1]), best[0])


def scaled(problem: Problem, x: Array) -> Array:
    """Every joint's motion about its start, shrunk until it keeps the joint's limits at all times.

    Exact: from the extremes of the motion, which are roots of polynomials.
    """
    still = _still(problem, x)
    factors = np.ones(len(x))
    for _ in range(_TIMES):
        motion = problem.basis.motion(still + factors[:, None] * (x - still))
        lack = _needed(problem, motion)
        if np.all(lack >= 1.0):
            break
        factors = factors * np.minimum(lack, 1.0) * (1.0 - _ROUNDING)
    return np.asarray(still + factors[:, None] * (x - still))


def _needed(problem: Problem, motion: ExactTrajectory) -> Array:
    """Factor per joint that brings it to its limits, counted from its start, shape `(n,)`."""
    start = motion.derivative([0.0], 0)[0]
    factor = np.full(len(start), np.inf)
    for order, (lower, upper) in enumerate(bounds(problem.limits)):
        least, most = motion.extremes(order)
        base = start if order == 0 else np.zeros_like(start)
        up, down = most - base, base - least
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.fmin(factor, np.where(up > 0.0, (upper - base) / up, np.inf))
            factor = np.fmin(factor, np.where(down > 0.0, (base - lower) / down, np.inf))
    return factor


def _still(problem: Problem, x: Array) -> Array:
    """Standing where the motion begins."""
    basis = problem.basis
    start = basis.shapes([0.0], 0)[0] @ x.T + basis.offset([0.0], 0)[0]
    return basis.still(start)


def _shrunk(problem: Problem, x: Array, progress: Progress) -> Array | None:
    """The largest share of the motion about its start that is proven, to a tenth of a percent."""
    if not problem.constraints or _proven(problem, x, progress):
        return x
    still = _still(problem, x)
    failed, step = 1.0, FINEST
    while not _proven(problem, still + (failed - step) * (x - still), progress):
        failed, step = failed - step, 3.0 * step
        if failed - step < LEAST:
            return None
    kept = failed - step
    while failed - kept > 2.0 * FINEST:
        middle = 0.5 * (failed + kept)
        if _proven(problem, still + middle * (x - still), progress):
            kept = middle
        else:
            failed = middle
    return np.asarray(still + kept * (x - still))


def _proven(problem: Problem, x: Array, progress: Progress) -> bool:
    """Whether all constraints hold at all times."""
    motion = problem.basis.motion(x)
    return all(
        bool(np.all(constraint.proven(motion, progress) >= 0.0))
        for constraint in problem.constraints
    )
