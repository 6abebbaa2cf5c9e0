"""Whether the gain and the gear ratio of every joint are right."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.hypotheses.gains_left import gains_left
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict


class Gain:
    """An effort that is off by a factor."""

    name: ClassVar[str] = "gain"
    asks: ClassVar[str] = "Are gains and gear ratios right?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves, or that no log shows a gain that is to be identified."""
        found = findings(case, self.name, _fine, _advice)
        if any(finding.judgement for finding in found):
            return found
        return gains_left(case, self.name) or found


def _fine(held: Verdict) -> str:
    trial = held.ranking.trial
    if any(trial.signals.unknown_gains):
        return "gains are to be identified, and are not compared with the model file"
    return agrees(held, "gains and gear ratios are right")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: use this gain; is it the gear ratio that is wrong?"
