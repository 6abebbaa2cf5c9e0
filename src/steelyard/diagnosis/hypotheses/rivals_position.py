"""Explanations that read the positions in another way: sign, order, unit; or the time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, permutations, product
from math import pi

import numpy as np

from steelyard.diagnosis.hypotheses.evidence_kept import keeps_evidence
from steelyard.diagnosis.hypotheses.reading import Reading
from steelyard.diagnosis.hypotheses.rival import Rival, choice, one_of
from steelyard.diagnosis.hypotheses.trial import Trial

BATCH = 12_000
"""Samples evaluated at once."""
UNITS = {"revolute": {"degrees": pi / 180.0}, "prismatic": {"millimetres": 1e-3}}
TIMES = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
DEEPEST = 7
"""Most joints of which all orders and all signs are tried."""
COARSE, QUICK = 120, 6
"""Samples, and sweeps of the friction's fit, for that."""
FINE = 12
"""How many of the best of them are looked at again."""


@dataclass(frozen=True, eq=False)
class Draft:
    """A rival that has no score yet."""

    cause: str
    says: str
    reading: Reading
    cost: float
    joints: tuple[int, ...]


def position_rivals(trial: Trial, reading: Reading) -> Iterator[Rival]:
    """One change each: a sign, two joints exchanged, a unit."""
    drafts = [*_signs(trial, reading), *_swaps(trial, reading), *_units(trial, reading)]
    yield from judged(trial, drafts)


def deep_rivals(trial: Trial, reading: Reading) -> Iterator[Rival]:
    """The best of all signs and of all orders."""
    n = len(reading.position)
    if not 2 < n <= DEEPEST:
        return
    coarse = replace(trial, excerpt=trial.excerpt.thinned(COARSE), sweeps=QUICK)
    for family in (_all_signs(trial, reading), _all_orders(reading)):
        drafts = list(family)
        quick = sorted(judged(coarse, drafts), key=lambda r: -r.log_likelihood)[:FINE]
        yield from judged(
            trial, [Draft(r.cause, r.says, r.reading, r.cost, r.joints) for r in quick]
        )


def judged(trial: Trial, drafts: Sequence[Draft]) -> Iterator[Rival]:
    """Drafts with their scores, many at a time; orders that leave efforts out have none."""
    whole = [d for d in drafts if d.cause != "joint order" or keeps_evidence(trial, d.reading)]
    size = max(1, BATCH // len(trial.excerpt.t))
    for start in range(0, len(whole), size):
        part = whole[start : start + size]
        readings = [d.reading for d in part]
        efforts = np.array([r.effort for r in readings])
        scales = np.array([r.effort_scale for r in readings])
        score = trial.scored(trial.sums(readings), efforts, scales)
        for k, d in enumerate(part):
            yield Rival(d.cause, d.says, d.reading, d.cost, d.joints, one_of(score, k))


def _signs(trial: Trial, reading: Reading) -> Iterator[Draft]:
    names = trial.knowledge.robot.joint_names
    n = len(names)
    for j, name in enumerate(names):
        yield _flipped(reading, (j,), f"'{name}' has the opposite sign", choice(n))
    if n > 1:
        yield _flipped(reading, tuple(range(n)), "all positions have the opposite sign", choice(n))


def _flipped(reading: Reading, joints: tuple[int, ...], says: str, cost: float) -> Draft:
    sign = np.ones(len(reading.position))
    sign[list(joints)] = -1.0
    changed = reading.changed(position_scale=sign * reading.position_scale)
    return Draft("position sign", says, changed, cost, joints)


def _swaps(trial: Trial, reading: Reading) -> Iterator[Draft]:
    """Two joints exchanged: positions alone, or with their efforts."""
    names = trial.knowledge.robot.joint_names
    n = len(names)
    for a, b in combinations(range(n), 2):
        order = list(range(n))
        order[a], order[b] = b, a
        pair = f"'{names[a]}' and '{names[b]}'"
        yield _ordered(reading, order, False, f"positions of {pair} exchanged", 2.0 * choice(n))
        yield _ordered(reading, order, True, f"{pair} exchanged", 2.0 * choice(n))


def _ordered(reading: Reading, order: Sequence[int], both: bool, says: str, cost: float) -> Draft:
    position = tuple(reading.position[k] for k in order)
    effort = tuple(reading.effort[k] for k in order) if both else reading.effort
    moved = tuple(j for j, k in enumerate(order) if j != k)
    return Draft(
        "joint order", says, reading.changed(position=position, effort=effort), cost, moved
    )


def _units(trial: Trial, reading: Reading) -> Iterator[Draft]:
    """Positions in other units, all or those of one joint; time in another unit."""
    coordinates = trial.knowledge.robot.coordinates
    n = len(coordinates)
    for kind, units in UNITS.items():
        mine = [j for j, c in enumerate(coordinates) if c.kind == kind]
        sets = [tuple(mine), *((j,) for j in mine)] if len(mine) > 1 else [tuple(mine)]
        for joints, (unit, scale) in product(sets, units.items()):
            for factor, says in ((scale, "in {}"), (1.0 / scale, "not in {}")):
                if joints:
                    factors = np.ones(n)
                    factors[list(joints)] = factor
                    changed = reading.changed(position_scale=factors * reading.position_scale)
                    who = "positions" if len(joints) > 1 else f"'{coordinates[joints[0]].name}'"
                    text = f"{who} {says.format(unit)}"
                    yield Draft("position unit", text, changed, choice(2 * n), joints)
    for unit, scale in TIMES.items():
        for factor, says in ((scale, "in"), (1.0 / scale, "not in")):
            changed = reading.changed(time=factor * reading.time)
            yield Draft("clock", f"time {says} {unit}", changed, choice(6), ())


def _all_signs(trial: Trial, reading: Reading) -> Iterator[Draft]:
    n = len(reading.position)
    sets = chain.from_iterable(combinations(range(n), k) for k in range(2, n))
    for joints in sets:
        numbers = ", ".join(str(j + 1) for j in joints)
        cost = choice(n) * min(len(joints), n - len(joints))
        yield _flipped(reading, joints, f"joints {numbers} count the other way", cost)


def _all_orders(reading: Reading) -> Iterator[Draft]:
    n = len(reading.position)
    cost = n * choice(n)
    for order in permutations(range(n)):
        if sum(j != k for j, k in enumerate(order)) > 2:
            numbers = ", ".join(str(reading.position[k] + 1) for k in order)
            yield _ordered(reading, order, False, f"positions in the order {numbers}", cost)
            yield _ordered(reading, order, True, f"joints in the order {numbers}", cost)
