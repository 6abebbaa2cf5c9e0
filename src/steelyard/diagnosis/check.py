"""What every suspicion can do."""

from typing import ClassVar, Protocol

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding


class Suspicion(Protocol):
    """One thing that may be wrong with logs.

    Attributes:
        name: One word or two, as users see it: `clock`.
        asks: The question in a few words: "Is the clock regular?"
        quick: Whether `identify` asks it before it begins.
    """

    name: ClassVar[str]
    asks: ClassVar[str]
    quick: ClassVar[bool]

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log, or one for all logs together; none where it does not apply."""
        ...
