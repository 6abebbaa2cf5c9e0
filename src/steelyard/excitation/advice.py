"""What else would help: other motions beside the designed one, and what they would add."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.limits import MotionLimits
from steelyard.excitation.objective import Case
from steelyard.excitation.planned.sweeps import friction_sweeps, static_postures
from steelyard.excitation.predicted_accuracy import PredictedAccuracy, deviations, information
from steelyard.excitation.problem import jumping
from steelyard.motion import Trajectory

SAMPLES_A_SECOND = 50.0
MOST_SAMPLES = 100_000
"""Of motions of more than half an hour."""

ENOUGH = 5_000
"""Samples of another motion: it moves one joint at a time or none, and its joints take minutes."""

HELPS = 0.8
"""A deviation that falls below this share is worth telling."""

FREE = ", if the workspace allows it"
"""Other motions keep the limits of joints; boxes and clearances are looked at when planned."""

_POSTURES = 20


@dataclass(frozen=True, eq=False)
class Advice:
    """A motion beside the designed one.

    Attributes:
        what: The motion, in a few words.
        seconds: Its length [s].
        std: Deviations of the parameters with both, shape `(b,)`.
        helps: Parameters whose deviation falls most, with the share that is left, best first.
    """

    what: str
    seconds: float
    std: Array
    helps: tuple[tuple[str, float], ...]


def advice(
    shown: PredictedAccuracy,
    trajectory: Trajectory,
    cases: Sequence[Case],
    noise_weights: Array,
    limits: MotionLimits,
    prior: Array | None = None,
) -> tuple[Advice, ...]:
    """Further motions and what they would add, as long as the designed one where that can be.

    Args:
        shown: What the designed motion shows.
        trajectory: The designed motion.
        cases: What it was judged by.
        noise_weights: Independent samples a second over the variance of the noise, shape `(n,)`.
        limits: Of the joints.
        prior: Information of earlier runs, shape `(b, b)`.
    """
    first = jumping(cases)[0]
    case = _weighed(first, noise_weights)
    found = [_of("repeating the motion", trajectory.duration, shown.gram, shown, prior)]
    # where loops close in a part of the joints' ranges only, other motions need a plan of their own
    for what, motion in () if case.shows.model.robot.passive else _others(limits):
        gram = information(case, motion, min(samples_of(motion.duration), ENOUGH))
        found.append(_of(what, motion.duration, gram, shown, prior))
    return tuple(found)


def samples_of(seconds: float) -> int:
    """Samples that say what a motion shows."""
    return int(min(SAMPLES_A_SECOND * seconds, MOST_SAMPLES))


def _others(limits: MotionLimits) -> list[tuple[str, Trajectory]]:
    others: list[tuple[str, Trajectory]] = []
    try:
        sweeps = friction_sweeps(limits, speeds=3, slowest=0.1, longest_s=2.0)
        others.append((f"one joint after another at three speeds{FREE}", sweeps))
        still = static_postures(limits, count=_POSTURES, seed=0, dwell_s=1.0)
        others.append((f"{_POSTURES} static postures{FREE}", still))
    except DataError:
        # a joint without room for them: the designed motion is what there is
        pass
    return others


def _weighed(case: Case, weights: Array) -> Case:
    return replace(case, shows=replace(case.shows, weights=weights))


def _of(
    what: str, seconds: float, gram: Array, shown: PredictedAccuracy, prior: Array | None
) -> Advice:
    before = shown.std(prior)
    whole = shown.gram + gram if prior is None else shown.gram + gram + prior
    after = deviations(whole)
    with np.errstate(invalid="ignore"):
        share = np.where(
            np.isfinite(before), after / before, np.where(np.isfinite(after), 0.0, 1.0)
        )
    order = np.argsort(share, kind="stable")
    helps = tuple((shown.names[k], float(share[k])) for k in order if share[k] < HELPS)
    return Advice(what, seconds, after, helps)
