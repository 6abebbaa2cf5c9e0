"""Whether efforts are logged in time with the positions."""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding, Judgement
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.telling import agrees, findings
from steelyard.diagnosis.hypotheses.verdict import Verdict, verdict
from steelyard.diagnosis.residual_delay import residual_delay


class EffortDelay:
    """Efforts that are late, or early."""

    name: ClassVar[str] = "effort delay"
    asks: ClassVar[str] = "Are all efforts logged late, or early, by one time?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves; a short delay is sought in the residuals of a fit."""
        found = findings(case, self.name, _fine, _advice)
        judged = [verdict(case, evidence) for evidence in case.logs]
        if any(held is not None and _wrong(held) for held in judged):
            return found
        late = residual_delay(case, self.name)
        return found if late is None else (late, *(f for f in found if f.log))


def _wrong(held: Verdict) -> bool:
    """Whether a delay is known already, or another cause is to be mended first."""
    return any(r.cause == EffortDelay.name or j is Judgement.WRONG for r, j in held.winners)


def _fine(held: Verdict) -> str:
    return agrees(held, "efforts have no delay common to all joints")


def _advice(rival: Rival) -> str:
    return f"{rival.says}: take the delay out"
