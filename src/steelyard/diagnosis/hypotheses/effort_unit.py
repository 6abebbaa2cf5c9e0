"""Whether efforts are in the unit that the robot file says."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class EffortUnit:
    """Efforts a thousand times too large or too small."""

    name: ClassVar[str] = "effort unit"
    asks: ClassVar[str] = "Are efforts in the unit declared?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    return agrees(held, "efforts are in the unit declared")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: declare the unit in which efforts are logged"
