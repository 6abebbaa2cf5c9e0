"""Whether the arm carries something that nobody spoke of."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.decided import least_mass
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class PayloadLeft:
    """A payload left on."""

    name: ClassVar[str] = "payload"
    asks: ClassVar[str] = "Is the arm empty?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    trial = held.ranking.trial
    if trial.knowledge.identified:
        return agrees(held, "the arm carries nothing")
    mass = least_mass(trial)
    return agrees(held, f"no load of {mass:.2g} kg or more, if the model file's masses are right")


def _advice(rival: Rival) -> str:
    return (
        f"{rival.says}: identify without this log, give it as --loaded, or weigh the load with "
        "steelyard payload"
    )
