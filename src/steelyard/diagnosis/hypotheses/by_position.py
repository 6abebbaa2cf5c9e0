"""Explanations that read the positions in another way: sign, order, unit; or the time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, permutations, product
from math import pi

import numpy as np

from steelyard.diagnosis.hypotheses.hypothesis import Hypothesis, choice, one_of
from steelyard.diagnosis.likelihood.evidence_kept import keeps_evidence
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood

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
    """A hypothesis that has no score yet."""

    cause: str
    says: str
    interpretation: Interpretation
    cost: float
    joints: tuple[int, ...]


def position_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """One change each: a sign, two joints exchanged, a unit."""
    drafts = [
        *_signs(likelihood, interpretation),
        *_swaps(likelihood, interpretation),
        *_units(likelihood, interpretation),
    ]
    yield from judged(likelihood, drafts)


def deep_hypotheses(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Hypothesis]:
    """The best of all signs and of all orders."""
    n = len(interpretation.position)
    if not 2 < n <= DEEPEST:
        return
    coarse = replace(likelihood, excerpt=likelihood.excerpt.thinned(COARSE), sweeps=QUICK)
    for family in (_all_signs(likelihood, interpretation), _all_orders(interpretation)):
        drafts = list(family)
        quick = sorted(judged(coarse, drafts), key=lambda r: -r.log_likelihood)[:FINE]
        yield from judged(
            likelihood, [Draft(r.cause, r.says, r.interpretation, r.cost, r.joints) for r in quick]
        )


def judged(likelihood: Likelihood, drafts: Sequence[Draft]) -> Iterator[Hypothesis]:
    """Drafts with their scores, many at a time; orders that leave efforts out have none."""
    whole = [
        d
        for d in drafts
        if d.cause != "joint order" or keeps_evidence(likelihood, d.interpretation)
    ]
    size = max(1, BATCH // len(likelihood.excerpt.t))
    for start in range(0, len(whole), size):
        part = whole[start : start + size]
        interpretations = [d.interpretation for d in part]
        efforts = np.array([r.effort for r in interpretations])
        scales = np.array([r.effort_scale for r in interpretations])
        motions = {r.of_motion: r for r in interpretations}
        places = {motion: k for k, motion in enumerate(motions)}
        sums = likelihood.sums(list(motions.values()))
        score = likelihood.scored(
            sums.of([places[r.of_motion] for r in interpretations]), efforts, scales
        )
        for k, d in enumerate(part):
            yield Hypothesis(d.cause, d.says, d.interpretation, d.cost, d.joints, one_of(score, k))


def _signs(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Draft]:
    names = likelihood.knowledge.robot.joint_names
    n = len(names)
    for j, name in enumerate(names):
        yield _flipped(interpretation, (j,), f"'{name}' has the opposite sign", choice(n))
    if n > 1:
        yield _flipped(
            interpretation, tuple(range(n)), "all positions have the opposite sign", choice(n)
        )


def _flipped(
    interpretation: Interpretation, joints: tuple[int, ...], says: str, cost: float
) -> Draft:
    sign = np.ones(len(interpretation.position))
    sign[list(joints)] = -1.0
    changed = interpretation.changed(position_scale=sign * interpretation.position_scale)
    return Draft("position sign", says, changed, cost, joints)


def _swaps(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Draft]:
    """Two joints exchanged: positions alone, or with their efforts."""
    names = likelihood.knowledge.robot.joint_names
    n = len(names)
    for a, b in combinations(range(n), 2):
        order = list(range(n))
        order[a], order[b] = b, a
        pair = f"'{names[a]}' and '{names[b]}'"
        yield _ordered(
            interpretation, order, False, f"positions of {pair} exchanged", 2.0 * choice(n)
        )
        yield _ordered(interpretation, order, True, f"{pair} exchanged", 2.0 * choice(n))


def _ordered(
    interpretation: Interpretation, order: Sequence[int], both: bool, says: str, cost: float
) -> Draft:
    position = tuple(interpretation.position[k] for k in order)
    effort = tuple(interpretation.effort[k] for k in order) if both else interpretation.effort
    moved = tuple(j for j, k in enumerate(order) if j != k)
    return Draft(
        "joint order", says, interpretation.changed(position=position, effort=effort), cost, moved
    )


def _units(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Draft]:
    """Positions in other units, all or those of one joint; time in another unit."""
    coordinates = likelihood.knowledge.robot.coordinates
    n = len(coordinates)
    for kind, units in UNITS.items():
        mine = [j for j, c in enumerate(coordinates) if c.kind == kind]
        sets = [tuple(mine), *((j,) for j in mine)] if len(mine) > 1 else [tuple(mine)]
        for joints, (unit, scale) in product(sets, units.items()):
            for factor, says in ((scale, "in {}"), (1.0 / scale, "not in {}")):
                if joints:
                    factors = np.ones(n)
                    factors[list(joints)] = factor
                    changed = interpretation.changed(
                        position_scale=factors * interpretation.position_scale
                    )
                    who = "positions" if len(joints) > 1 else f"'{coordinates[joints[0]].name}'"
                    text = f"{who} {says.format(unit)}"
                    yield Draft("position unit", text, changed, choice(2 * n), joints)
    for unit, scale in TIMES.items():
        for factor, says in ((scale, "in"), (1.0 / scale, "not in")):
            changed = interpretation.changed(time=factor * interpretation.time)
            yield Draft("clock", f"time {says} {unit}", changed, choice(6), ())


def _all_signs(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Draft]:
    n = len(interpretation.position)
    sets = chain.from_iterable(combinations(range(n), k) for k in range(2, n))
    for joints in sets:
        numbers = ", ".join(str(j + 1) for j in joints)
        cost = choice(n) * min(len(joints), n - len(joints))
        yield _flipped(interpretation, joints, f"joints {numbers} have the opposite sign", cost)


def _all_orders(interpretation: Interpretation) -> Iterator[Draft]:
    n = len(interpretation.position)
    cost = n * choice(n)
    for order in permutations(range(n)):
        if sum(j != k for j, k in enumerate(order)) > 2:
            numbers = ", ".join(str(interpretation.position[k] + 1) for k in order)
            yield _ordered(interpretation, order, False, f"positions in the order {numbers}", cost)
            yield _ordered(interpretation, order, True, f"joints in the order {numbers}", cost)
