"""Plain tables in sections: headings, rows of words, one of them marked."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """Cells, ready to be read; the first one names the row."""

    cells: Sequence[str]
    marked: bool = False


@dataclass(frozen=True)
class PlainTable:
    """One table.

    Attributes:
        caption: Heading above it; empty for none.
        words: What to know before reading it.
        headings: One per column.
        rows: The rows.
        text: Columns that hold words, not numbers.
    """

    caption: str
    words: str
    headings: Sequence[str]
    rows: Sequence[Row]
    text: Sequence[int] = (0,)
