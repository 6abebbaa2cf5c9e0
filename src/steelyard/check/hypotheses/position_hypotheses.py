r"""Hypotheses that read the positions in another way: sign, order, unit, zero, gear ratio.

The reference predicts the efforts at $q_j + \delta$, with friction as every hypothesis may have it;
the likeliest $\delta$ is sought.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations, permutations, product
from math import pi

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.check.hypotheses.readings_and_likelihood import (
    CLOSE_HYPOTHESES,
    FITTED_NUMBER_COST,
    ZOOMED_POINTS,
    Hypothesis,
    Reading,
    choice_cost,
    likeliest,
    scored,
)
from steelyard.estimate.nonlinear.nonlinear_parameters import LOOSEST
from steelyard.robot.robot import Robot

OTHER_POSITION_UNITS = {"revolute": {"degrees": pi / 180.0}, "prismatic": {"millimetres": 1e-3}}
OTHER_TIME_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
MOST_PERMUTED_JOINTS = 7  # most joints of which all orders and all signs are tried
COARSE_SAMPLES, COARSE_SWEEPS = 120, 6  # samples, and sweeps of the friction's fit, for that
REFINED_HYPOTHESES = 12  # how many of the best of them are looked at again


def position_changes(reading: Reading) -> Iterator[Hypothesis]:
    """One change each, not scored: a sign, two joints exchanged, a unit of positions or of time."""
    names = reading.likelihood.names
    n = len(names)
    for j, name in enumerate(names):
        yield _turned(reading, (j,), f"'{name}' has the opposite sign", choice_cost(n))
    if n > 1:
        says = "all positions have the opposite sign"
        yield _turned(reading, tuple(range(n)), says, choice_cost(n))
    for a, b in combinations(range(n), 2):
        order = list(range(n))
        order[a], order[b] = b, a
        pair = f"'{names[a]}' and '{names[b]}'"
        for both, whose in ((False, f"positions of {pair}"), (True, pair)):
            yield _ordered(reading, order, both, f"{whose} exchanged", 2.0 * choice_cost(n))
    yield from _units(reading)


def deep_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """The best of all signs and of all orders."""
    n = len(reading.position)
    if not 2 < n <= MOST_PERMUTED_JOINTS:
        return
    coarse = reading.on(reading.likelihood.thinned(COARSE_SAMPLES, COARSE_SWEEPS))
    signs, orders = [], []
    for joints in chain.from_iterable(combinations(range(n), k) for k in range(2, n)):
        says = f"joints {', '.join(str(j + 1) for j in joints)} have the opposite sign"
        cost = choice_cost(n) * min(len(joints), n - len(joints))
        signs.append(_turned(coarse, joints, says, cost))
    for order in permutations(range(n)):
        if sum(j != k for j, k in enumerate(order)) > 2:
            numbers = ", ".join(str(coarse.position[k] + 1) for k in order)
            for both, whose in ((False, "positions"), (True, "joints")):
                says = f"{whose} in the order {numbers}"
                orders.append(_ordered(coarse, order, both, says, n * choice_cost(n)))
    for family in (signs, orders):
        best = sorted(scored(family), key=lambda r: -r.log_likelihood)[:REFINED_HYPOTHESES]
        yield from scored([replace(h, reading=h.reading.on(reading.likelihood)) for h in best])


def _turned(reading: Reading, joints: tuple[int, ...], says: str, cost: float) -> Hypothesis:
    signs = np.where(np.isin(np.arange(len(reading.position)), joints), -1.0, 1.0)
    turned = reading.changed(position_scale=signs * reading.position_scale)
    return Hypothesis("position sign", says, turned, cost, joints)


def _ordered(
    reading: Reading, order: Sequence[int], both: bool, says: str, cost: float
) -> Hypothesis:
    moved = tuple(j for j, k in enumerate(order) if j != k)
    return Hypothesis("joint order", says, reading.ordered(order, efforts=both), cost, moved)


def _units(reading: Reading) -> Iterator[Hypothesis]:
    """Positions in other units, all or those of one joint; time in another unit."""
    coordinates = reading.knowledge.robot.coordinates
    n = len(coordinates)
    for kind, units in OTHER_POSITION_UNITS.items():
        mine = [j for j, c in enumerate(coordinates) if c.kind == kind]
        sets = [tuple(mine), *((j,) for j in mine)] if len(mine) > 1 else [tuple(mine)]
        for joints, (unit, scale) in product(filter(None, sets), units.items()):
            who = "positions" if len(joints) > 1 else f"'{coordinates[joints[0]].name}'"
            for factor, says in ((scale, "in"), (1.0 / scale, "not in")):
                factors = np.where(np.isin(np.arange(n), joints), factor, 1.0)
                changed = reading.changed(position_scale=factors * reading.position_scale)
                text = f"{who} {says} {unit}"
                yield Hypothesis("position unit", text, changed, choice_cost(2 * n), joints)
    for unit, scale in OTHER_TIME_UNITS.items():
        for factor, says in ((scale, "in"), (1.0 / scale, "not in")):
            changed = reading.changed(time=factor * reading.time)
            yield Hypothesis("clock", f"time {says} {unit}", changed, choice_cost(6), ())


ZERO_CAUSE = "joint zeros"  # the check that an explanation by a zero belongs to
ZERO_GRID = np.array(
    [-3.5, -2.8, -2.2, -1.6, -1.2, -0.8, -0.4, -0.2, -0.1, 0.0]
    + [0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.2, 2.8, 3.5]
)
"""Offsets that are tried first [rad; m]."""
COARSE_ZERO_SAMPLES = 300  # samples for that
ZERO_ZOOMS = 2
NEAR_ZERO = 0.4  # how far from a reading's own zero the likeliest is looked for [rad; m]


@dataclass(frozen=True)
class JointZero:
    """The zero offset of a joint: its position is the logged one plus it."""

    joint: int  # index of the joint
    name: str  # the joint's name
    unit: str  # `rad` or `m`
    value: float  # the likeliest offset; 0 where it is not identifiable
    std: float  # its standard deviation; infinite where it is not identifiable

    @property
    def identifiable(self) -> bool:
        """Whether the log identifies it."""
        return bool(np.isfinite(self.std))

    @property
    def words(self) -> str:
        """Like `elbow -0.0931 ± 0.0102 rad`."""
        return f"{self.name} {self.value:.3f} ± {Z95 * self.std:.3f} {self.unit}"


def zero_hypotheses(reading: Reading) -> list[Hypothesis]:
    """The best zero of each joint whose zero the log identifies; the likeliest names its like."""
    zeros = [zero for zero in zero_offsets(reading) if zero.identifiable]
    cost = FITTED_NUMBER_COST + choice_cost(len(reading.position))
    found = scored(
        [
            Hypothesis(
                ZERO_CAUSE,
                f"zero offset of {zero.words}",
                reading.with_zero(zero.joint, zero.value),
                cost,
                (zero.joint,),
                spread=zero.std,
            )
            for zero in zeros
        ]
    )
    if not found:
        return []
    best = max(range(len(found)), key=lambda k: found[k].log_likelihood)
    least = found[best].log_likelihood - CLOSE_HYPOTHESES
    alike = [zeros[k].words for k, h in enumerate(found) if k != best and h.log_likelihood > least]
    if alike:
        says = f"{found[best].says} (or of {', '.join(alike)})"
        found[best] = replace(found[best], says=says)
    return found


def zero_offsets(reading: Reading) -> tuple[JointZero, ...]:
    """Offsets of all joints, each by itself; of an open chain with declared zeros, else none."""
    robot, log = reading.knowledge.robot, reading.likelihood
    if robot.passive or any(log.signals.unknown_offsets):
        return ()
    coarse = reading.on(log.thinned(COARSE_ZERO_SAMPLES))
    found = []
    for joint, coordinate in enumerate(robot.coordinates):
        values = _zero_likelihoods(coarse, joint, ZERO_GRID)
        k = int(np.clip(np.argmax(values), 1, len(ZERO_GRID) - 2))
        grid = np.linspace(ZERO_GRID[k - 1], ZERO_GRID[k + 1], ZOOMED_POINTS)
        value, std = likeliest(partial(_zero_likelihoods, reading, joint), grid, ZERO_ZOOMS)
        if std > LOOSEST[coordinate.unit]:
            value, std = 0.0, np.inf
        found.append(JointZero(joint, coordinate.name, coordinate.unit, value, std))
    return tuple(found)


def zero_near(reading: Reading, joint: int) -> tuple[float, float]:
    """The likeliest zero near a reading's own [rad; m], and its standard deviation, or infinity."""
    grid = np.linspace(-NEAR_ZERO, NEAR_ZERO, ZOOMED_POINTS)
    return likeliest(partial(_zero_likelihoods, reading, joint), grid, ZERO_ZOOMS)


def _zero_likelihoods(reading: Reading, joint: int, offsets: Array) -> Array:
    moved = [
        Hypothesis(ZERO_CAUSE, "", reading.with_zero(joint, x), 0.0, (joint,)) for x in offsets
    ]
    return np.array([found.log_likelihood for found in scored(moved)])


UPRIGHT_AXIS = 0.05
"""Part of gravity across a first axis up to which it is taken to be along it [m/s²]."""


def zeros_without_effect(robot: Robot) -> tuple[bool, ...]:
    """Joints whose zeros no motion identifies, for parameters express them, or none has an effect.

    A first joint that turns about the direction of gravity or slides, and joints of last bodies.
    """
    parents = {body.parent for body in robot.bodies}
    found = [False] * robot.n
    for k, body in enumerate(robot.bodies):
        along = np.linalg.norm(np.cross(body.rotation @ body.axis, robot.gravity))
        first = body.parent < 0 and (body.kind == "prismatic" or along <= UPRIGHT_AXIS)
        if body.coordinate < robot.n and (first or k not in parents):
            found[body.coordinate] = True
    return tuple(found)


LARGEST_RATIO_FACTOR = 4.0  # largest factor by which a ratio is looked for to be off, either way
RATIO_GRID, RATIO_ROUNDS = 25, 3


def ratio_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """One motor's ratio off, the factor that agrees best for each of them."""
    log = reading.likelihood
    if log.signals.position_map is None:
        return
    cost = choice_cost(log.signals.n) + FITTED_NUMBER_COST
    for joint, name in enumerate(log.names):
        factors = np.geomspace(1.0 / LARGEST_RATIO_FACTOR, LARGEST_RATIO_FACTOR, RATIO_GRID)
        mine = np.arange(log.signals.n) == joint
        for _ in range(RATIO_ROUNDS):
            readings = [
                reading.changed(ratios=reading.ratios * np.where(mine, x, 1.0)) for x in factors
            ]
            best = int(np.argmax([one.log_likelihood for one in readings]))
            winner, factor = readings[best], factors[best]
            low, high = factors[max(best - 1, 0)], factors[min(best + 1, len(factors) - 1)]
            factors = np.geomspace(low, high, ZOOMED_POINTS)
        says = f"gear ratio of '{name}' times {factor:.4g}"
        yield Hypothesis("gain", says, winner, cost, (joint,), winner.score)
