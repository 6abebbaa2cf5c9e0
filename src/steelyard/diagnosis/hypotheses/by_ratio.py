"""Gear ratios that are off, where a log's positions are those of motors."""

from collections.abc import Iterator

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.by_position import Draft, judged
from steelyard.diagnosis.hypotheses.hypothesis import FREE, Hypothesis, choice
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood

LARGEST = 4.0
"""Largest factor by which a ratio is looked for to be off, either way."""
GRID = 25
ROUNDS = 3


def ratio_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation
) -> Iterator[Hypothesis]:
    """One motor's ratio off, the factor that agrees best for each of them."""
    if likelihood.signals.position_map is None:
        return
    for joint in range(likelihood.signals.n):
        factors = np.geomspace(1.0 / LARGEST, LARGEST, GRID)
        for _ in range(ROUNDS):
            drafts = [_draft(likelihood, interpretation, joint, f) for f in factors]
            hypotheses = [r for draft in drafts for r in judged(likelihood, [draft])]
            best = int(np.argmax([r.log_likelihood for r in hypotheses]))
            low, high = factors[max(best - 1, 0)], factors[min(best + 1, len(factors) - 1)]
            winner, factors = hypotheses[best], np.geomspace(low, high, 9)
        yield winner


def _draft(
    likelihood: Likelihood, interpretation: Interpretation, joint: int, factor: float
) -> Draft:
    changed = with_ratio(interpretation, joint, factor)
    name = likelihood.knowledge.robot.joint_names[joint]
    says = f"gear ratio of '{name}' times {factor:.4g}"
    return Draft("gain", says, changed, choice(likelihood.signals.n) + FREE, (joint,))


def with_ratio(interpretation: Interpretation, joint: int, factor: float) -> Interpretation:
    """A motor that turns so much more often with its joint than declared."""
    factors: Array = np.ones(len(interpretation.position))
    factors[joint] = factor
    return interpretation.changed(ratios=interpretation.ratios * factors)
