"""Whether positions count the way the robot's model does."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class PositionSign:
    """Encoders that count the other way."""

    name: ClassVar[str] = "position sign"
    asks: ClassVar[str] = "Do positions count the right way?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    return agrees(held, "positions count the right way")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: say which columns count against their joint"
