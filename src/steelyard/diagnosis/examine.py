"""All checks put to a case."""

from collections.abc import Sequence
from dataclasses import dataclass

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.check import Check
from steelyard.diagnosis.finding import Edit, Finding, Severity
from steelyard.diagnosis.register import CHECKS
from steelyard.diagnosis.together import together
from steelyard.progress import tell


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found.

    Attributes:
        findings: In the order of the checks, then of the logs.
    """

    findings: tuple[Finding, ...]

    @property
    def severity(self) -> Severity:
        """The worst of all."""
        return max((f.severity for f in self.findings), default=Severity.OK)

    @property
    def edits(self) -> tuple[Edit, ...]:
        """What would correct the robot file, each key once.

        Of findings that are wrong; only if there are none, of doubtful ones: these may well come
        from what is wrong, and are looked at again once it is corrected.
        """
        chosen: dict[tuple[str, ...], Edit] = {}
        for finding in self.findings:
            if finding.severity == self.severity != Severity.OK and finding.fix is not None:
                for edit in finding.fix.edits:
                    chosen.setdefault(edit.path, edit)
        return tuple(chosen.values())


def examine(case: Case, *, quick: bool = False, checks: Sequence[Check] | None = None) -> Diagnosis:
    """Ask every check.

    Args:
        case: Robot, logs and what is known beforehand.
        quick: Whether to ask the quick ones only.
        checks: Which to ask; all that are registered if `None`.

    Raises:
        Stopped: The case's `progress` requested a stop.
    """
    selected = [s for s in (CHECKS if checks is None else checks) if s.quick or not quick]
    findings: list[Finding] = []
    for number, check in enumerate(selected):
        tell(case.progress, f"checking: {check.name}", number, len(selected))
        findings += check(case)
    return Diagnosis(together(findings))
