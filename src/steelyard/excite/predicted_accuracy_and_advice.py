"""Predicted accuracy of each parameter by a motion, and further motions that would help."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import exp, inf

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.motion import Trajectory
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.design_problem_and_information import Case, jumping
from steelyard.excite.optimality_criteria import CRITERIA, worst
from steelyard.excite.planned.plans_from_tables import friction_sweeps, static_postures

_CHUNK = 20_000
_ROUNDING = 1e-13  # information along an axis, over the largest, that rounding alone may leave
_BLIND_SHARE = 1e-6  # share of a parameter, squared, in axes without information: it is unknown


@dataclass(frozen=True, eq=False)
class PredictedAccuracy:
    """The information of a motion about `b` base parameters, with the noise given, `(b, b)`.

    Condition numbers of the regressor are of columns as they are (`raw`) and of unit norm, and so
    are its singular values, falling, `(b,)`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    gram: Array
    criterion_value: float
    raw: float
    normalised: float
    singular: Array

    def std(self, prior: Array | None = None) -> Array:
        """Standard deviations to be expected, `(b,)`; infinite for what nothing shows."""
        return deviations(self.gram if prior is None else self.gram + prior)


def deviations(gram: Array) -> Array:
    """Standard deviations from information; infinite for what it does not distinguish."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 0.0))
    result, seen = np.full(len(gram), np.inf), size > 0.0
    if not seen.any():
        return result
    size = size[seen]
    values, axes = np.linalg.eigh(gram[np.ix_(seen, seen)] / size[:, None] / size)
    resolved = values > _ROUNDING * values[-1]
    single = np.sum(axes[:, ~resolved] ** 2, axis=1) < _BLIND_SHARE
    variance = np.sum(axes[:, resolved] ** 2 / values[resolved], axis=1)
    result[seen] = np.where(single, np.sqrt(variance) / size, np.inf)
    return result


def predicted_accuracy(
    trajectory: Trajectory, cases: Sequence[Case], noise_weights: Array, samples: int
) -> PredictedAccuracy:
    """What a motion shows, from samples over it, the end left out.

    Weights are independent samples a second over the variance of the noise, shape `(n,)`.
    """
    sharp = jumping(cases)
    pairs = [(case.criterion, information_of_motion(case, trajectory, samples)) for case in sharp]
    first = sharp[0]
    even = replace(first, shows=replace(first.shows, weights=np.ones(len(noise_weights))))
    noisy = replace(first, shows=replace(first.shows, weights=noise_weights))
    plain = information_of_motion(even, trajectory, samples)
    size = np.sqrt(np.maximum(np.diagonal(plain), 1e-300))
    spectrum = np.linalg.eigvalsh(plain / size[:, None] / size)[::-1]
    base = first.shows.base
    return PredictedAccuracy(
        base.base_names,
        base.base_units,
        information_of_motion(noisy, trajectory, samples),
        exp(worst(pairs, inf)[0]),
        CRITERIA["condition"].value(plain),
        CRITERIA["normalised_condition"].value(plain),
        np.sqrt(np.maximum(spectrum, 0.0)),
    )


def information_of_motion(case: Case, trajectory: Trajectory, samples: int) -> Array:
    """Information of a motion at even samples, each counting for its time, `(b, b)`."""
    step = trajectory.duration / samples
    total = np.zeros((len(case.shows.base),) * 2)
    for first in range(0, samples, _CHUNK):
        count = np.arange(first, min(first + _CHUNK, samples))
        motion = trajectory.sample(step * count)
        q, dq, ddq = (np.ascontiguousarray(x.T) for x in (motion.q, motion.dq, motion.ddq))
        total += case.shows.at(q, dq, ddq, step=step).gram
    return total


SAMPLES_A_SECOND = 50.0
MOST_SAMPLES = 100_000  # of motions of more than half an hour

ENOUGH_ADVICE_SAMPLES = 5_000
"""Samples of another motion: it moves one joint at a time or none, and its joints take minutes."""

HELPFUL_SHARE = 0.8  # a deviation that falls below this share is worth telling

FREE_WORKSPACE_NOTE = ", if the workspace allows it"
"""Other motions keep the limits of joints; boxes and clearances are looked at when planned."""

_ADVICE_POSTURES = 20


@dataclass(frozen=True, eq=False)
class Advice:
    """A motion beside the designed one, its length [s] and the deviations with both, `(b,)`.

    It `helps` the parameters whose deviation falls most, with the share that is left, best first.
    """

    what: str
    seconds: float
    std: Array
    helps: tuple[tuple[str, float], ...]


def advised_motions(
    shown: PredictedAccuracy,
    trajectory: Trajectory,
    cases: Sequence[Case],
    noise_weights: Array,
    limits: MotionLimits,
    prior: Array | None = None,
) -> tuple[Advice, ...]:
    """Further motions and what they would add, as long as the designed one where that can be.

    Weights are independent samples a second over the variance of the noise, `(n,)`; `prior` is the
    information of earlier runs, `(b, b)`.
    """
    first = jumping(cases)[0]
    case = replace(first, shows=replace(first.shows, weights=noise_weights))
    found = [
        _advice_of_motion("repeating the motion", trajectory.duration, shown.gram, shown, prior)
    ]
    # where loops close in a part of the joints' ranges only, other motions need a plan of their own
    for what, motion in () if case.shows.model.robot.passive else _other_motions(limits):
        gram = information_of_motion(
            case, motion, min(samples_of(motion.duration), ENOUGH_ADVICE_SAMPLES)
        )
        found.append(_advice_of_motion(what, motion.duration, gram, shown, prior))
    return tuple(found)


def samples_of(seconds: float) -> int:
    """Samples that say what a motion shows."""
    return int(min(SAMPLES_A_SECOND * seconds, MOST_SAMPLES))


def _other_motions(limits: MotionLimits) -> list[tuple[str, Trajectory]]:
    others: list[tuple[str, Trajectory]] = []
    # a joint may have no room for them: the designed motion is what there is then
    with suppress(DataError):
        sweeps = friction_sweeps(limits, speeds=3, slowest=0.1, longest_s=2.0)
        others.append((f"one joint after another at three speeds{FREE_WORKSPACE_NOTE}", sweeps))
        still = static_postures(limits, count=_ADVICE_POSTURES, seed=0, dwell_s=1.0)
        others.append((f"{_ADVICE_POSTURES} static postures{FREE_WORKSPACE_NOTE}", still))
    return others


def _advice_of_motion(
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
    helps = tuple((shown.names[k], float(share[k])) for k in order if share[k] < HELPFUL_SHARE)
    return Advice(what, seconds, after, helps)
