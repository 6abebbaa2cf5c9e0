"""Efforts that were read with a scale: noted beside the headline."""

from typing import ClassVar

import numpy as np

from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.estimation.estimate import Z95
from steelyard.terms.laws.load_dependent import LoadDependent
from steelyard.terms.laws.spring import Spring

ALIKE = (Spring.law, LoadDependent.law)
"""Terms whose efforts change with posture or load, as those of a wrong scale do."""

WRONG = 1.3
"""Factor, either way, beyond the interval of a scale, from which on a gain is doubtful."""


class ScaledEfforts:
    """Scales of the efforts that differ from 1 by more than their interval."""

    name: ClassVar[str] = "effort scales"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding, if scales were estimated; doubtful if a gain is far off."""
        scales = case.scales
        if scales is None:
            return ()
        far = np.abs(np.log(scales.found.values)) > Z95 * scales.found.std
        values = zip(scales.joints, scales.found.values, scales.half_width, far, strict=True)
        off = [f"{joint} {x:.2f} ± {half:.2f}" for joint, x, half, is_far in values if is_far]
        listed = ", ".join(off) or "none significant by itself"
        beyond = np.abs(np.log(scales.found.values)) - Z95 * scales.found.std > np.log(WRONG)
        wrong = tuple(j for j, is_wrong in zip(scales.joints, beyond, strict=True) if is_wrong)
        says = (
            f"a scale of the efforts is estimated per joint ({listed}): sensors or gains may be "
            "off by these factors, or a missing term may have the same effect. Masses are as "
            f"uncertain as the scales{_term_instead(case, scales.found.distance)}"
        )
        brief = (
            f"sensors or gains may be off, or a term missing: estimated scales {listed}"
            if off
            else "estimated scales of the efforts are used: together they differ significantly "
            "from 1, though none does by itself"
        )
        if not wrong:
            return (Finding(self.name, "", Severity.OK, says, "", headline=True, brief=brief),)
        fix = Fix(f"Check gain and unit of the effort of {', '.join(wrong)}")
        brief = f"{brief}. {fix.says}"
        return (
            Finding(
                self.name, "", Severity.DOUBTFUL, says, "", wrong, fix, headline=True, brief=brief
            ),
        )


def _term_instead(case: FittedCase, distance: float) -> str:
    """A term that looks like a scale and explains more of what is left beside them than they do.

    Args:
        case: The fitted model and its runs.
        distance: Of the scales from 1, squared, which is about what they take from chi square.
    """
    if not case.tested:
        return ""
    first, gain = case.tested[0]
    if first.kind not in ALIKE or first.chi2 <= distance:
        return ""
    more = (
        f"; {first.says} explains more than the scales (reduces χ² by {first.chi2:.0f} in "
        f"addition to them, the scales by {distance:.0f})"
    )
    if gain is None or not gain.confirmed:
        return f"{more}, but is not confirmed on left-out motion"
    return (
        f"{more} and reduces the error on left-out motion ({gain.words}): add it, and keep it if "
        "the error as logged falls"
    )
