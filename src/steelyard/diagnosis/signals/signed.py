"""Do efforts have a sign, or were their absolute values logged?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.pictures import of_joints
from steelyard.diagnosis.signal_overview import MOVED, look, with_rows

FEWEST = 2
"""Joints whose effort touches zero and keeps its sign, from which on chance does not explain it."""
TOUCHING = 0.05
"""Share of an effort's greatest size that the least must come below. One that carries a weight
throughout stays away from zero."""


@dataclass(frozen=True)
class Signed:
    """Efforts of all joints keep one sign, and those of some touch zero."""

    name: ClassVar[str] = "signed efforts"
    question: ClassVar[str] = "Do efforts change their sign?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that has rows."""
        return tuple(self._look(case, evidence) for evidence in with_rows(case))

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        overview = look(case, evidence)
        effort, size = overview.effort, np.abs(overview.effort)
        low, high = effort.min(axis=0), effort.max(axis=0)
        moves = (np.ptp(overview.q, axis=0) > MOVED) & (high > low)
        one_sign = moves & ((low >= 0.0) | (high <= 0.0))
        touching = one_sign & (size.min(axis=0) <= TOUCHING * size.max(axis=0))
        unsigned = bool(touching.sum() >= FEWEST and (one_sign == moves).all())
        joints = tuple(j for j, is_one in zip(case.joints, one_sign, strict=True) if is_one)
        figure = f"{len(joints)} of {int(moves.sum())} joints that move have efforts of one sign"
        if not unsigned:
            says = "efforts change their sign, or carry a weight"
            return Finding(self.name, evidence.name, Severity.OK, says, figure)
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL,
            "efforts of all joints that move keep one sign and touch zero, as absolute values do",
            figure,
            joints,
            Fix("log torques or currents with their sign"),
            of_joints("logged effort", [("least", low, "points"), ("greatest", high, "points")]),
        )
