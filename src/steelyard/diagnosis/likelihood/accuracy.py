r"""How accurately a log shows a fitted factor: a gain, or a gear ratio.

Along the factor's logarithm $x$ the log-likelihood of an interpretation is a parabola near its top,
so that $\sigma_x^{-2} = -\mathrm d^2 \log L / \mathrm d x^2$, with the likelihood's honest number
of samples and what the model leaves for noise.
"""

import numpy as np
from numpy.typing import NDArray

from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood

STEP = 0.03
"""By how much the factor is changed either way, relative."""
LEAST = 1e-3
"""Least standard deviation that is stated, relative."""


def spread_of(likelihood: Likelihood, interpretation: Interpretation) -> float:
    """Largest relative standard deviation of an interpretation's fitted gains and gear ratios.

    Args:
        likelihood: The log.
        interpretation: How it is read, with the fitted factors.

    Returns:
        Zero where nothing differs from what is declared, infinity where the log does not show it.
    """
    gains = interpretation.effort_scale / likelihood.declared.effort_scale
    kinds = (("ratios", interpretation.ratios != 1.0), ("gains", np.abs(gains) != 1.0))
    found = [
        _spread(likelihood, interpretation, kind, np.arange(len(gains)) == joint)
        for kind, changed in kinds
        for joint in np.flatnonzero(changed)
    ]
    return max(found, default=0.0)


def _spread(
    likelihood: Likelihood, interpretation: Interpretation, kind: str, joint: NDArray[np.bool_]
) -> float:
    likelihoods = []
    for step in (-STEP, 0.0, STEP):
        factors = np.where(joint, np.exp(step), 1.0)
        changed = (
            interpretation.changed(ratios=interpretation.ratios * factors)
            if kind == "ratios"
            else interpretation.with_factors(factors)
        )
        likelihoods.append(float(likelihood.score(changed).log_likelihood[0]))
    bend = (2.0 * likelihoods[1] - likelihoods[0] - likelihoods[2]) / STEP**2
    return max(LEAST, float(bend**-0.5)) if bend > 0.0 else float("inf")
