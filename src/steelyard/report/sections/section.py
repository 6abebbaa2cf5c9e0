"""What a section is: a title, and its data for the page, the terminal and `--json`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.report.html import fill
from steelyard.report.sections.tables import PlainTable, text_table

if TYPE_CHECKING:
    from rich.console import RenderableType

Numbers = Mapping[str, Any]
"""Everything a section's template shows, by name."""


class Section(ABC):
    """One section of the report."""

    name: ClassVar[str]
    """The section's identifier in the page."""

    title: ClassVar[str]
    """Its heading."""

    folded: ClassVar[bool] = False
    """Whether the page shows its heading alone, until a click opens it."""

    @abstractmethod
    def numbers(self, content: Any) -> Numbers | None:
        """What there is to show; `None` leaves the section out."""

    @abstractmethod
    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""

    def to_dict(self, content: Any) -> dict[str, Any]:
        """Fields of `--json`; they are there, and `None`, where there is nothing to show."""
        return {}

    def printed(self, content: Any) -> Iterable[RenderableType]:
        """What the terminal shows, an empty line before each."""
        return ()

    def detailed(self, content: Any) -> Iterable[RenderableType]:
        """What the terminal shows below that with `--verbose`."""
        return ()


class TableSection(Section):
    """A section that is plain tables."""

    in_terminal: ClassVar[bool] = False
    """Whether the terminal shows them with `--verbose`."""

    @abstractmethod
    def tables(self, content: Any) -> Sequence[PlainTable]:
        """The tables; none leaves the section out."""

    def numbers(self, content: Any) -> Numbers | None:
        """The tables under the section's title."""
        tables = self.tables(content)
        return {"tables": tables, "title": self.title} if tables else None

    def show(self, numbers: Numbers) -> str:
        """The tables as safe HTML."""
        return fill("tables.html", numbers)

    def detailed(self, content: Any) -> Iterable[RenderableType]:
        """The tables, if the terminal shows them."""
        if self.in_terminal:
            yield from (text_table(table, self.title) for table in self.tables(content))


class FigureSection(Section):
    """A section that is figures, with words and tables."""

    template: ClassVar[str] = "figures.html"

    def show(self, numbers: Numbers) -> str:
        """The figures as safe HTML; numbers that the section does not have are empty."""
        empty = {"words": "", "tables": (), "folded": "", "legend": (), "note": ""}
        return fill(self.template, {"title": self.title, **empty, **numbers})
