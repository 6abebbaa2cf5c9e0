"""Whether effort columns hold what the robot file says."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class EffortKind:
    """Currents for torques or the reverse, percents, torques without gravity."""

    name: ClassVar[str] = "effort kind"
    asks: ClassVar[str] = "Are efforts what they are declared to be?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    return agrees(held, "efforts are of the kind declared")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: declare what the columns hold"
