"""Whether efforts have the sign that they should."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.friction_sign import friction_signs
from steelyard.diagnosis.hypotheses.ranking import known_of
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class EffortSign:
    """Efforts of the other sign, of all joints or of one."""

    name: ClassVar[str] = "effort sign"
    asks: ClassVar[str] = "Do efforts have the right sign?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves; without masses, what friction tells."""
        driven = friction_signs(case, self.name) if known_of(case) is None else ()
        return driven or findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    return agrees(held, "efforts have the right sign")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: turn the sign of the gain"
