"""Are rows corrupt: how many, and where?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Picture, Severity, Trace, percent_of
from steelyard.diagnosis.signal_overview import look
from steelyard.diagnosis.signals.clock import irregular
from steelyard.diagnosis.signals.units import reading
from steelyard.errors import LogError
from steelyard.measurement import Run
from steelyard.measurement.rows.validity import Verdict

FEW, MANY = 0.05, 0.3
"""Shares of broken rows from which on a log is doubtful, and wrong."""
END = 100
"""Rows at the start that are a log's head, and at the end its tail."""
BROKEN = (Verdict.UNREADABLE, Verdict.ABSURD, Verdict.JUMP)


@dataclass(frozen=True)
class Rows:
    """Cells that are missing, no numbers, or garbage; and why a log cannot be made a run."""

    name: ClassVar[str] = "rows"
    question: ClassVar[str] = "Are rows corrupt?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log."""
        return tuple(self._look(case, evidence) for evidence in case.logs)

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        broken = look(case, evidence).broken
        count, total = _counted(evidence, broken)
        share = count / max(total, 1)
        severity = (
            Severity.WRONG
            if share > MANY or total == 0
            else Severity.DOUBTFUL
            if share > FEW
            else Severity.OK
        )
        fix = None if severity == Severity.OK else Fix("record or copy the log again")
        says = f"{count} corrupt rows{_where(broken)}, dropped" if count else "no corrupt rows"
        if isinstance(evidence.run, LogError):
            says += f"; as declared, the log cannot be used: {evidence.run.wrong}"
            if _unexplained(case, evidence):
                severity, fix = Severity.WRONG, Fix(evidence.run.fix)
        return Finding(
            self.name,
            evidence.name,
            severity,
            says,
            f"{count} of {total} rows ({percent_of(share)}), at most {100.0 * FEW:g} % allowed",
            fix=fix,
            picture=_picture(broken) if broken.any() else None,
            brief=f"{count} corrupt rows dropped" if count else "",
        )


def _unexplained(case: Case, evidence: Evidence) -> bool:
    """Whether neither units, nor the clock, nor a motion that is missing explain the refusal."""
    units = reading(case, evidence)
    if units.cost < units.declared_cost or irregular(case, evidence):
        return False
    return look(case, evidence).moves


def _counted(evidence: Evidence, broken: NDArray[np.bool_]) -> tuple[int, int]:
    """Broken rows and all rows: of the whole log if it is longer than the excerpt."""
    if isinstance(evidence.run, Run) and evidence.run.quality.rows > len(broken):
        quality = evidence.run.quality
        return sum(quality.dropped.get(verdict.reason, 0) for verdict in BROKEN), quality.rows
    return int(broken.sum()), len(broken)


def _where(broken: NDArray[np.bool_]) -> str:
    """Where broken rows are, in words."""
    at = np.flatnonzero(broken)
    if len(at) == 0:
        return ""
    if at[-1] < END:
        return f" at the start (rows {at[0]} to {at[-1]})"
    if at[0] >= len(broken) - END:
        return f" at the end (from row {at[0]})"
    return f" (the first is row {at[0]}, the last {at[-1]})"


def _picture(broken: NDArray[np.bool_]) -> Picture:
    """Broken rows per hundredth of the log."""
    edges = np.linspace(0.0, len(broken), 101)
    count, _ = np.histogram(np.flatnonzero(broken), edges)
    bars = Trace("broken rows", 0.5 * (edges[1:] + edges[:-1]), count.astype(np.float64), "bars")
    return Picture("row", "broken rows", (bars,))
