"""Whether the gain and the gear ratio of every joint are right."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.rival import Rival
from steelyard.diagnosis.rivals_effort import poorly_shown
from steelyard.diagnosis.telling import agrees, findings, last_of, told
from steelyard.diagnosis.verdict import Verdict


class Gain:
    """An effort that is off by a factor."""

    name: ClassVar[str] = "gain"
    asks: ClassVar[str] = "Are gains and gear ratios right?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        return findings(case, self.name, _fine, _advice)


def _fine(held: Verdict) -> str:
    trial = held.ranking.trial
    if any(trial.signals.unknown_gains):
        return "gains are to be identified, and are not compared with the model file"
    weak = () if trial.knowledge.identified else poorly_shown(trial, last_of(held).reading)
    if weak and told(held):
        listed = ", ".join(f"'{name}'" for name in weak)
        return f"gains agree with the nominal model; those of {listed} are poorly identifiable"
    return agrees(held, "gains and gear ratios are right")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: use this gain; is it the gear ratio that is wrong?"
