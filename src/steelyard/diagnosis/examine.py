"""All suspicions put to a case."""

from collections.abc import Sequence
from dataclasses import dataclass

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.check import Suspicion
from steelyard.diagnosis.finding import Edit, Finding, Judgement
from steelyard.diagnosis.register import SUSPICIONS
from steelyard.diagnosis.together import together
from steelyard.progress import tell


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found.

    Attributes:
        findings: In the order of the suspicions, then of the logs.
    """

    findings: tuple[Finding, ...]

    @property
    def judgement(self) -> Judgement:
        """The worst of all."""
        return max((f.judgement for f in self.findings), default=Judgement.OK)

    @property
    def edits(self) -> tuple[Edit, ...]:
        """What would mend the robot file, each key once.

        Of findings that are wrong; only if there are none, of doubtful ones: these may well come
        from what is wrong, and are looked at again once it is mended.
        """
        chosen: dict[tuple[str, ...], Edit] = {}
        for finding in self.findings:
            if finding.judgement == self.judgement != Judgement.OK and finding.mend is not None:
                for edit in finding.mend.edits:
                    chosen.setdefault(edit.path, edit)
        return tuple(chosen.values())


def examine(
    case: Case, *, quick: bool = False, suspicions: Sequence[Suspicion] | None = None
) -> Diagnosis:
    """Ask every suspicion.

    Args:
        case: Robot, logs and what is known beforehand.
        quick: Whether to ask the quick ones only.
        suspicions: Which to ask; all that are registered if `None`.

    Raises:
        Stopped: The case's `progress` asked to stop.
    """
    asked = [s for s in (SUSPICIONS if suspicions is None else suspicions) if s.quick or not quick]
    findings: list[Finding] = []
    for number, suspicion in enumerate(asked):
        tell(case.progress, f"checking: {suspicion.name}", number, len(asked))
        findings += suspicion(case)
    return Diagnosis(together(findings))
