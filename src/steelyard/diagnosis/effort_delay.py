"""Whether efforts are logged in time with the positions."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.rival import Rival
from steelyard.diagnosis.telling import agrees, findings
from steelyard.diagnosis.verdict import Verdict


class EffortDelay:
    """Efforts that are late, or early."""

    name: ClassVar[str] = "effort delay"
    asks: ClassVar[str] = "Are efforts logged in time with positions?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    return agrees(held, "efforts are in time with positions")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: take the delay out"
