"""Whether efforts of a log that is predicted are cut off at a limit: the error counts them."""

from typing import ClassVar

from steelyard.diagnosis.finding import Finding, Severity, percent_of
from steelyard.diagnosis.fitted.fitted_case import FittedCase

SHARE = 0.002
"""Share of the values of all efforts from which on they are named."""


class Clipped:
    """Efforts at a limit in runs that were not fitted."""

    name: ClassVar[str] = "clipped efforts"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """A remark per run."""
        found = []
        for run in case.unseen:
            count = run.quality.marked.cut_off
            values = run.quality.rows * len(run.recording.signals.effort_units)
            if count > SHARE * values:
                says = (
                    f"{count} efforts ({percent_of(count / values)}) are saturated: the "
                    "error includes them, though the required effort was not measured there"
                )
                remark = Finding(self.name, run.name, Severity.OK, says, "", headline=True)
                found.append(remark)
        return tuple(found)
