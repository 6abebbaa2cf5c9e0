"""Whether another order of columns still has to explain the efforts of all joints that move."""

from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import LEAST_SPAN, Likelihood


def keeps_evidence(likelihood: Likelihood, interpretation: Interpretation) -> bool:
    """Whether efforts that belong to motion as declared do so under an interpretation too.

    An order that gives the effort of a joint in motion to a resting position is not to be
    compared with others: what contradicts it no longer counts.
    """
    return _in_motion(likelihood, likelihood.declared) <= _in_motion(likelihood, interpretation)


def _in_motion(likelihood: Likelihood, interpretation: Interpretation) -> set[int]:
    """Effort columns of the positions that move."""
    span = likelihood.excerpt.span.tolist()
    pairs = zip(
        interpretation.position,
        interpretation.effort,
        interpretation.position_scale.tolist(),
        strict=True,
    )
    return {e for p, e, scale in pairs if abs(scale) * span[p] > LEAST_SPAN}
