"""From a motion that is feasible at samples to one that is proven feasible at all times."""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.problem import Problem
from steelyard.excitation.search.newton import minimised_by
from steelyard.excitation.search.repair import Kept, proven, repaired, scaled, shrunk
from steelyard.excitation.search.starts import NoMotion
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.progress import Progress, silent

POLISH = ((256.0, 1e-5),)
"""Last stage: the criterion nearly itself, the barrier nearly gone."""


@dataclass(frozen=True, eq=False)
class Finished:
    """A motion whose limits are exact and whose constraints are proven.

    Attributes:
        x: Its coefficients, shape `(n, m)`.
        trajectory: The motion.
        criterion_value: The criterion.
        proven: Margins of each constraint that hold at all times, `(k,)` each.
    """

    x: Array
    trajectory: ExactTrajectory
    criterion_value: float
    proven: tuple[Array, ...]


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
        deadline: When to stop once there is one, of `time.monotonic`; a motion is not begun with
            that would pass it, by what the slowest one before took to prove.
        progress: Told of the proofs.

    Raises:
        DataError: No candidate shows all parameters.
        NoMotion: No candidate can be made to keep its constraints.
        Stopped: `progress` requested a stop.
    """
    best: tuple[float, Kept] | None = None
    lacking, slowest = list[Array](), 0.0
    for x in candidates:
        if best is not None and time.monotonic() + slowest > deadline:
            break
        for tried in sorted(_tries(problem, x, deadline - slowest), key=problem.criterion_value):
            if best is not None and problem.criterion_value(tried) >= best[0]:
                break
            start = time.monotonic()
            kept = repaired(problem, tried, deadline, progress)
            slowest = max(slowest, time.monotonic() - start)
            if kept is None:
                continue
            if not kept.holds:
                lacking.append(kept.x)
            elif best is None or problem.criterion_value(kept.x) < best[0]:
                best = problem.criterion_value(kept.x), kept
                break
    if best is None:
        best = _smaller(problem, lacking, deadline, progress)
    if best is not None and not math.isfinite(best[0]):
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
    criterion_value, kept = best
    return Finished(kept.x, problem.basis.motion(kept.x), criterion_value, kept.proven)


def _smaller(
    problem: Problem, lacking: list[Array], deadline: float, progress: Progress
) -> tuple[float, Kept] | None:
    """Of motions that lack something, the best made smaller until it is proven; its criterion."""
    best: tuple[float, Kept] | None = None
    for x in sorted(lacking, key=problem.criterion_value):
        if best is not None and time.monotonic() > deadline:
            break
        less = shrunk(problem, x, progress)
        if less is not None and (best is None or problem.criterion_value(less) < best[0]):
            best = problem.criterion_value(less), proven(problem, less, progress)
    return best


def _tries(problem: Problem, x: Array, deadline: float) -> list[Array]:
    """The motion scaled, and polished if there is time; those that keep the limits of joints."""
    first = scaled(problem, x)
    if first is None or time.monotonic() > deadline:
        return [] if first is None else [first]
    x = minimised_by(deadline, problem.objective, problem.inequalities, first, stages=POLISH)
    second = scaled(problem, x)
    return [first] if second is None else [first, second]
