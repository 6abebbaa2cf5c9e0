"""All efforts of the other sign, or all positions: of arms with a mirror plane, bodies fit both.

Mirrored bodies turn every torque of the mirrored motion. So the two cannot be distinguished by any
log of such an arm; that efforts are of the other sign is a single convention, and by far the
likelier mistake.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.hypothesis import Hypothesis
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood
from steelyard.diagnosis.likelihood.possible import possible

CLOSE = 3.0
"""Log-likelihood within which the two fit equally well."""
BOTH = ": both fit with free link inertias, and this log cannot distinguish them"
JOINTS, EFFORTS = "all positions have the opposite sign", "all efforts have the opposite sign"


def efforts_first(now: Interpretation, hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Hypotheses, the likeliest first, turned efforts before turned positions that fit as well.

    Args:
        now: The interpretation that they start from.
        hypotheses: The likeliest first.
    """
    if not hypotheses or not _turned(
        now.position_scale, hypotheses[0].interpretation.position_scale
    ):
        return tuple(hypotheses)
    least = hypotheses[0].log_likelihood - CLOSE
    for hypothesis in hypotheses[1:]:
        if hypothesis.log_likelihood > least and of_efforts(now, hypothesis):
            return (hypothesis, *(r for r in hypotheses if r is not hypothesis))
    return tuple(hypotheses)


def of_efforts(now: Interpretation, hypothesis: Hypothesis) -> bool:
    """Whether a hypothesis does nothing but turn the signs of all efforts."""
    after = hypothesis.interpretation
    return (
        hypothesis.cause == "effort sign"
        and len(after.effort) > 1
        and _turned(now.effort_scale, after.effort_scale)
        and np.array_equal(now.position_scale, after.position_scale)
    )


def mirrors(now: Interpretation, one: Hypothesis, other: Hypothesis) -> bool:
    """Whether one hypothesis turns all efforts and the other one all positions."""
    return of_efforts(now, one) and _turned(now.position_scale, other.interpretation.position_scale)


def with_mirror(
    likelihood: Likelihood, before: Interpretation, hypothesis: Hypothesis
) -> Hypothesis:
    """A hypothesis that turns all efforts, or all positions, and names the other one if that fits.

    Args:
        likelihood: The log.
        before: The interpretation that it starts from.
        hypothesis: The explanation.
    """
    after = hypothesis.interpretation
    positions = _turned(before.position_scale, after.position_scale)
    if len(after.effort) < 2 or positions == _turned(before.effort_scale, after.effort_scale):
        return hypothesis
    if hypothesis.cause != ("position sign" if positions else "effort sign"):
        return hypothesis
    mirror = after.changed(position_scale=-after.position_scale, effort_scale=-after.effort_scale)
    mine, other = possible(likelihood, after), possible(likelihood, mirror)
    if mine is None or other is None:
        return hypothesis
    if float(mine.score.log_likelihood - other.score.log_likelihood) > CLOSE:
        return hypothesis
    return replace(
        hypothesis, says=f"{hypothesis.says}, or {EFFORTS if positions else JOINTS}{BOTH}"
    )


def _turned(before: Array, after: Array) -> bool:
    return bool(np.all(np.sign(before) == -np.sign(after)))
