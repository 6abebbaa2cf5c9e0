"""What every check can do."""

from typing import Protocol

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding


class Check(Protocol):
    """One thing that may be wrong with logs."""

    @property
    def name(self) -> str:
        """One word or two, as users see it: `clock`."""
        ...

    @property
    def question(self) -> str:
        """The question in a few words: "Is the clock regular?"."""
        ...

    @property
    def quick(self) -> bool:
        """Whether `identify` runs it before the fit."""
        ...

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log, or one for all logs together; none where it does not apply."""
        ...
