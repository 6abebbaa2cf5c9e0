"""Whether gravity points where the robot file says."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class Mounting:
    """An arm that is mounted in another way."""

    name: ClassVar[str] = "mounting"
    asks: ClassVar[str] = "Does gravity point where the robot file says?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    return agrees(held, "gravity points where the robot file says")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: say where gravity points in the base frame"
