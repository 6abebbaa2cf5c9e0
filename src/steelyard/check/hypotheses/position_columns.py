r"""Hypotheses that read the positions in another way: sign, order, unit, zero, gear ratio.

The reference predicts the efforts at $q_j + \delta$, with friction as every hypothesis may have it.
Along $\delta$ the log-likelihood is sought on a grid that is drawn closer around its best point;
the curvature at the top gives the standard deviation.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, permutations, product
from math import pi

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.excerpt import Interpretation
from steelyard.check.hypotheses.likelihood import (
    FITTED_NUMBER_COST,
    Hypothesis,
    Likelihood,
    choice_cost,
    keeps_evidence,
    one_of,
)
from steelyard.estimate.estimate import Z95
from steelyard.estimate.nonlinear.zero_offset import LOOSEST

SAMPLE_BATCH = 12_000
"""Samples evaluated at once."""
OTHER_POSITION_UNITS = {"revolute": {"degrees": pi / 180.0}, "prismatic": {"millimetres": 1e-3}}
OTHER_TIME_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
MOST_PERMUTED_JOINTS = 7
"""Most joints of which all orders and all signs are tried."""
COARSE_SAMPLES, COARSE_SWEEPS = 120, 6
"""Samples, and sweeps of the friction's fit, for that."""
REFINED_DRAFTS = 12
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
    yield from scored_drafts(likelihood, drafts)


def deep_hypotheses(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Hypothesis]:
    """The best of all signs and of all orders."""
    n = len(interpretation.position)
    if not 2 < n <= MOST_PERMUTED_JOINTS:
        return
    coarse = replace(
        likelihood, excerpt=likelihood.excerpt.thinned(COARSE_SAMPLES), sweeps=COARSE_SWEEPS
    )
    for family in (_all_signs(likelihood, interpretation), _all_orders(interpretation)):
        drafts = list(family)
        quick = sorted(scored_drafts(coarse, drafts), key=lambda r: -r.log_likelihood)[
            :REFINED_DRAFTS
        ]
        yield from scored_drafts(
            likelihood, [Draft(r.cause, r.says, r.interpretation, r.cost, r.joints) for r in quick]
        )


def scored_drafts(likelihood: Likelihood, drafts: Sequence[Draft]) -> Iterator[Hypothesis]:
    """Drafts with their scores, many at a time; orders that leave efforts out have none."""
    whole = [
        d
        for d in drafts
        if d.cause != "joint order" or keeps_evidence(likelihood, d.interpretation)
    ]
    size = max(1, SAMPLE_BATCH // len(likelihood.excerpt.t))
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
        yield _flipped(interpretation, (j,), f"'{name}' has the opposite sign", choice_cost(n))
    if n > 1:
        yield _flipped(
            interpretation, tuple(range(n)), "all positions have the opposite sign", choice_cost(n)
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
            interpretation, order, False, f"positions of {pair} exchanged", 2.0 * choice_cost(n)
        )
        yield _ordered(interpretation, order, True, f"{pair} exchanged", 2.0 * choice_cost(n))


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
    for kind, units in OTHER_POSITION_UNITS.items():
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
                    yield Draft("position unit", text, changed, choice_cost(2 * n), joints)
    for unit, scale in OTHER_TIME_UNITS.items():
        for factor, says in ((scale, "in"), (1.0 / scale, "not in")):
            changed = interpretation.changed(time=factor * interpretation.time)
            yield Draft("clock", f"time {says} {unit}", changed, choice_cost(6), ())


def _all_signs(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Draft]:
    n = len(interpretation.position)
    sets = chain.from_iterable(combinations(range(n), k) for k in range(2, n))
    for joints in sets:
        numbers = ", ".join(str(j + 1) for j in joints)
        cost = choice_cost(n) * min(len(joints), n - len(joints))
        yield _flipped(interpretation, joints, f"joints {numbers} have the opposite sign", cost)


def _all_orders(interpretation: Interpretation) -> Iterator[Draft]:
    n = len(interpretation.position)
    cost = n * choice_cost(n)
    for order in permutations(range(n)):
        if sum(j != k for j, k in enumerate(order)) > 2:
            numbers = ", ".join(str(interpretation.position[k] + 1) for k in order)
            yield _ordered(interpretation, order, False, f"positions in the order {numbers}", cost)
            yield _ordered(interpretation, order, True, f"joints in the order {numbers}", cost)


ZERO_CAUSE = "joint zeros"
"""The check that an explanation by a zero belongs to."""
ZERO_GRID = np.array(
    [-3.5, -2.8, -2.2, -1.6, -1.2, -0.8, -0.4, -0.2, -0.1, 0.0]
    + [0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.2, 2.8, 3.5]
)
"""Offsets that are tried first [rad; m]."""
COARSE_ZERO_SAMPLES = 300
"""Samples for that."""
ZERO_POINTS, ZERO_ZOOMS = 9, 3
"""Offsets between the neighbours of the best one, and how often they are drawn closer."""
CLOSE_ZEROS = 3.0
"""Log-likelihood within which zeros of two joints cannot be distinguished."""


@dataclass(frozen=True)
class JointZero:
    """The zero offset of a joint: its position is the logged one plus it.

    Attributes:
        joint: Index of the joint.
        name: The joint's name.
        unit: `rad` or `m`.
        value: The likeliest offset; 0 where it is not identifiable.
        std: Its standard deviation; infinite where it is not identifiable.
    """

    joint: int
    name: str
    unit: str
    value: float
    std: float

    @property
    def identifiable(self) -> bool:
        """Whether the log identifies it."""
        return bool(np.isfinite(self.std))

    @property
    def words(self) -> str:
        """Like `elbow -0.0931 ± 0.0102 rad`."""
        return f"{self.name} {self.value:.3f} ± {Z95 * self.std:.3f} {self.unit}"


def zero_hypotheses(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Hypothesis]:
    """The best zero of each joint whose zero the log identifies; the likeliest names its like."""
    zeros = [zero for zero in zero_offsets(likelihood, interpretation) if zero.identifiable]
    cost = FITTED_NUMBER_COST + choice_cost(likelihood.signals.n)
    drafts = [
        Draft(
            ZERO_CAUSE,
            f"zero offset of {zero.words}",
            with_moved_zero(interpretation, zero.joint, zero.value),
            cost,
            (zero.joint,),
        )
        for zero in zeros
    ]
    found = [
        replace(hypothesis, spread=zero.std)
        for zero, hypothesis in zip(zeros, scored_drafts(likelihood, drafts), strict=True)
    ]
    if found:
        yield from _with_indistinguishable(zeros, found)


def _with_indistinguishable(
    zeros: list[JointZero], found: list[Hypothesis]
) -> Iterator[Hypothesis]:
    """The hypotheses, of which the likeliest names those that it cannot be distinguished from."""
    best = max(found, key=lambda hypothesis: hypothesis.log_likelihood)
    alike = [
        zero.words
        for zero, other in zip(zeros, found, strict=True)
        if other is not best and other.log_likelihood > best.log_likelihood - CLOSE_ZEROS
    ]
    if alike:
        found[found.index(best)] = replace(best, says=f"{best.says} (or of {', '.join(alike)})")
    yield from found


def zero_offsets(likelihood: Likelihood, interpretation: Interpretation) -> tuple[JointZero, ...]:
    """Offsets of all joints, each by itself; of an open chain with declared zeros, else none."""
    robot = likelihood.knowledge.robot
    if robot.passive or any(likelihood.signals.unknown_offsets):
        return ()
    coarse = replace(likelihood, excerpt=likelihood.excerpt.thinned(COARSE_ZERO_SAMPLES))
    found = []
    for joint, coordinate in enumerate(robot.coordinates):
        k = int(
            np.clip(
                np.argmax(_zero_likelihoods(coarse, interpretation, joint, ZERO_GRID)),
                1,
                len(ZERO_GRID) - 2,
            )
        )
        value, std = _refined_zero(likelihood, interpretation, joint, ZERO_GRID[k - 1 : k + 2])
        if std > LOOSEST[coordinate.unit]:
            value, std = 0.0, np.inf
        found.append(JointZero(joint, coordinate.name, coordinate.unit, value, std))
    return tuple(found)


def _refined_zero(
    likelihood: Likelihood, interpretation: Interpretation, joint: int, near: Array
) -> tuple[float, float]:
    """Top of the log-likelihood between two offsets, and its standard deviation, or infinity."""
    low, high = float(near[0]), float(near[-1])
    for _ in range(ZERO_ZOOMS):
        grid = np.linspace(low, high, ZERO_POINTS)
        k = int(
            np.clip(
                np.argmax(_zero_likelihoods(likelihood, interpretation, joint, grid)),
                1,
                ZERO_POINTS - 2,
            )
        )
        low, high = float(grid[k - 1]), float(grid[k + 1])
    middle, step = 0.5 * (low + high), 0.5 * (high - low)
    before, top, after = _zero_likelihoods(
        likelihood, interpretation, joint, np.array([low, middle, high], dtype=np.float64)
    )
    bend = (before - 2.0 * top + after) / step**2
    if not bend < 0.0:
        return 0.0, np.inf
    value = middle + float(np.clip(0.5 * (before - after) / step / bend, -step, step))
    return value, float(1.0 / np.sqrt(-bend))


def _zero_likelihoods(
    likelihood: Likelihood, interpretation: Interpretation, joint: int, offsets: Array
) -> Array:
    """Log-likelihood at offsets of one joint, of the same shape."""
    drafts = [
        Draft(ZERO_CAUSE, "", with_moved_zero(interpretation, joint, x), 0.0, (joint,))
        for x in offsets
    ]
    return np.array([found.log_likelihood for found in scored_drafts(likelihood, drafts)])


def with_moved_zero(interpretation: Interpretation, joint: int, offset: float) -> Interpretation:
    """The interpretation with one joint's zero moved further."""
    before = interpretation.zeros
    zeros = np.zeros(len(interpretation.position)) if before is None else before.copy()
    zeros[joint] += offset
    return interpretation.changed(zeros=zeros)


LARGEST_RATIO_FACTOR = 4.0
"""Largest factor by which a ratio is looked for to be off, either way."""
RATIO_GRID = 25
RATIO_ROUNDS = 3


def ratio_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """One motor's ratio off, the factor that agrees best for each of them."""
    if likelihood.signals.position_map is None:
        return
    for joint in range(likelihood.signals.n):
        factors = np.geomspace(1.0 / LARGEST_RATIO_FACTOR, LARGEST_RATIO_FACTOR, RATIO_GRID)
        for _ in range(RATIO_ROUNDS):
            drafts = [_ratio_draft(likelihood, interpretation, joint, f) for f in factors]
            hypotheses = [r for draft in drafts for r in scored_drafts(likelihood, [draft])]
            best = int(np.argmax([r.log_likelihood for r in hypotheses]))
            low, high = factors[max(best - 1, 0)], factors[min(best + 1, len(factors) - 1)]
            winner, factors = hypotheses[best], np.geomspace(low, high, 9)
        yield winner


def _ratio_draft(
    likelihood: Likelihood, interpretation: Interpretation, joint: int, factor: float
) -> Draft:
    changed = with_ratio(interpretation, joint, factor)
    name = likelihood.knowledge.robot.joint_names[joint]
    says = f"gear ratio of '{name}' times {factor:.4g}"
    return Draft(
        "gain", says, changed, choice_cost(likelihood.signals.n) + FITTED_NUMBER_COST, (joint,)
    )


def with_ratio(interpretation: Interpretation, joint: int, factor: float) -> Interpretation:
    """A motor that turns so much more often with its joint than declared."""
    factors: Array = np.ones(len(interpretation.position))
    factors[joint] = factor
    return interpretation.changed(ratios=interpretation.ratios * factors)
