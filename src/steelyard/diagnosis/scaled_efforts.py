"""Efforts that were read with a scale: said beside the headline."""

from typing import ClassVar

import numpy as np

from steelyard.diagnosis.finding import Finding, Judgement
from steelyard.diagnosis.fitted_case import FittedCase
from steelyard.estimation.estimate import Z95


class ScaledEfforts:
    """Scales of the efforts that differ from 1 by more than their interval."""

    name: ClassVar[str] = "effort scales"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One remark, if scales were estimated."""
        scales = case.scales
        if scales is None:
            return ()
        far = np.abs(np.log(scales.found.values)) > Z95 * scales.found.std
        values = zip(scales.joints, scales.found.values, scales.half_width, far, strict=True)
        off = [f"{joint} {x:.2f} ± {half:.2f}" for joint, x, half, is_far in values if is_far]
        listed = ", ".join(off) or "none by itself beyond its interval"
        says = (
            f"efforts are read with a scale per joint ({listed}): sensors or gains are off by so "
            "much, or the model lacks something that looks like it; masses are as uncertain as "
            "the scales"
        )
        return (Finding(self.name, "", Judgement.OK, says, "", headline=True),)
