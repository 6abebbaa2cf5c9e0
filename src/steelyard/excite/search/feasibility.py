"""Feasible postures, and random motions about them to start a search from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint import Constraint
from steelyard.excite.constraints.motion_limits import MotionLimits
from steelyard.excite.search.margins_barrier_and_newton import InequalityConstraints

POSTURE_ATTEMPTS = 60  # random postures among which a free one is sought before none is reported

_MIDDLE_SHARE = 0.4
_EDGE_SHARE = 0.95
_FREE_ROOM_SHARE = 0.8
_SIZE_SHRINK = 0.7
_POWERS = 20  # times that a motion is shrunk before it is next to nothing, a thousandth
_WANTED_MARGIN = 0.05
_POSTURES = 30
_DRAWN_POSTURES = 180


class NoMotion(DataError):
    """No motion was found that keeps everything."""


class Lack(NamedTuple):
    """A margin of a constraint that is not positive."""

    constraint: Constraint
    label: str
    value: float

    def __str__(self) -> str:
        return f"{self.label} (violated by {-self.value:.3g} {self.constraint.unit})"


@dataclass(frozen=True, eq=False)
class Standing:
    """A posture, shape `(n,)`, and what it lacks, worst first."""

    posture: Array
    lacks: tuple[Lack, ...]


def standing(constraints: Sequence[Constraint], posture: Array) -> Standing:
    """What standing still at a posture lacks."""
    still = np.zeros((1, len(posture)))
    lacks = [
        Lack(constraint, label, float(value))
        for constraint in constraints
        for label, value in zip(
            constraint.labels,
            constraint.margins(posture[None], still, still).values[0],
            strict=True,
        )
        if not value > 0.0
    ]
    return Standing(posture, tuple(sorted(lacks, key=lambda lack: lack.value)))


def nearest_free(
    limits: MotionLimits, constraints: Sequence[Constraint], posture: Array
) -> Standing:
    """Where a descent of what is lacking ends that begins at a posture."""
    from scipy.optimize import minimize

    if not constraints or not standing(constraints, posture).lacks:
        return Standing(posture, ())
    edge = (1.0 - _EDGE_SHARE) * 0.5 * (limits.upper - limits.lower)
    bounds = list(zip(limits.lower + edge, limits.upper - edge, strict=True))
    still = np.zeros((1, len(posture)))

    def lack(q: Array) -> tuple[float, Array]:
        value, slope = 0.0, np.zeros(len(q))
        for constraint in constraints:
            margins = constraint.margins(q[None], still, still)
            short = np.minimum(
                margins.values[0] / constraint.activation_distance - _WANTED_MARGIN, 0.0
            )
            value += float(short @ short)
            if margins.by_q is not None:
                slope += 2.0 * (short / constraint.activation_distance) @ margins.by_q[0]
        return value, slope

    found = minimize(lack, posture, jac=True, method="L-BFGS-B", bounds=bounds)
    return standing(constraints, np.asarray(found.x))


def postures(
    limits: MotionLimits,
    constraints: Sequence[Constraint],
    random: np.random.Generator,
    attempts: int = POSTURE_ATTEMPTS,
) -> Iterator[Standing]:
    """Postures that descents from random ones end at; the first half of them in the middle."""
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    for attempt in range(attempts):
        share = _MIDDLE_SHARE if attempt < attempts // 2 else _EDGE_SHARE
        yield nearest_free(
            limits, constraints, middle + share * half * random.uniform(-1.0, 1.0, len(middle))
        )


def random_starts(
    inequalities: InequalityConstraints, random: np.random.Generator, count: int
) -> list[Array]:
    """All of `each_start` with all joints at once."""
    return list(each_start(inequalities, random, count))


def each_start(
    inequalities: InequalityConstraints,
    random: np.random.Generator,
    count: int,
    limbs: Sequence[Sequence[int]] = (),
) -> Iterator[Array]:
    """Motions about random postures, as large as the constraints allow but for a fifth.

    As many as `count`, if so many postures are free; some of them, but one at least, if not. Limbs
    are joints that are given as much room as there is one after the other, in random order.
    """
    found = 0
    for posture in _free(inequalities, random, count):
        still = inequalities.basis.still(posture)
        if inequalities.smallest_margin(still) > 0.0:
            moved = _widened_in_turn(inequalities, still, random, limbs)
            if moved is not None:
                found += 1
                yield moved
        if found == count:
            return
    if not found:
        raise NoMotion(
            f"no motion about any of {count + _POSTURES} random postures keeps all limits and "
            "constraints",
            where="[excitation]",
            fix="widen the limits or the boxes, or give a start posture farther from the limits",
        )


def _free(
    inequalities: InequalityConstraints, random: np.random.Generator, count: int
) -> Iterator[Array]:
    """Random postures that are free, and where too few are, ends of descents from others."""
    limits = inequalities.limits
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    drawn = middle + _MIDDLE_SHARE * half * random.uniform(
        -1.0, 1.0, (max(3 * count, _DRAWN_POSTURES), len(middle))
    )
    still, free = np.zeros_like(drawn), np.ones(len(drawn), dtype=bool)
    for constraint in inequalities.constraints:
        free &= (constraint.margins(drawn, still, still).values > 0.0).all(axis=1)
    yield from drawn[free]
    if free.sum() < count:
        for place in postures(limits, inequalities.constraints, random, _POSTURES):
            yield place.posture


def _widened_in_turn(
    inequalities: InequalityConstraints,
    still: Array,
    random: np.random.Generator,
    limbs: Sequence[Sequence[int]],
) -> Array | None:
    """A random change of standing still, as much of it as the constraints allow each limb."""
    change = random.standard_normal(still.shape)
    if len(limbs) < 2:
        return widened(inequalities, still, change)
    moved, any_ = still, False
    for number in random.permutation(len(limbs)):
        part, joints = np.zeros_like(change), list(limbs[number])
        part[joints] = change[joints]
        wider = widened(inequalities, moved, part)
        if wider is not None:
            moved, any_ = wider, True
    return moved if any_ else None


def widened(inequalities: InequalityConstraints, still: Array, change: Array) -> Array | None:
    """Standing still plus as much of a change as the constraints allow; `None` if hardly any."""
    sized = _FREE_ROOM_SHARE * inequalities.room(still, change)[:, None] * change
    # the power of the shrinking at which the motion comes inside, by halving their range
    low, high = 0, _POWERS
    while low < high:
        middle = (low + high) // 2
        moved = still + _SIZE_SHRINK**middle * sized
        inside = inequalities.coarser.smallest_margin(moved) > 0.0
        low, high = (low, middle) if inside else (middle + 1, high)
    for power in range(low, _POWERS):
        moved = still + _SIZE_SHRINK**power * sized
        if inequalities.smallest_margin(moved) > 0.0:
            return np.asarray(moved)
    return None
