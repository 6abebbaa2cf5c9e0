"""Whether columns belong to the joints that the robot file says."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class JointOrder:
    """Columns in another order: of positions, of efforts, or of both."""

    name: ClassVar[str] = "joint order"
    asks: ClassVar[str] = "Is every column that of its joint?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    return agrees(held, "columns are those of their joints")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: put the columns in the order of the joints"
