"""What a section is: a title, numbers, and a way to show them."""

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from steelyard.report.content import ReportContent

Numbers = Mapping[str, Any]
"""Everything a section's template shows, by name."""


class Section(Protocol):
    """One section of the report."""

    name: ClassVar[str]
    """The section's identifier in the page."""

    title: ClassVar[str]
    """Its heading."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """What there is to show; `None` leaves the section out."""
        ...

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        ...
