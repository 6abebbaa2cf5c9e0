"""Plain tables in sections: headings, rows of words, one of them marked."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

COLUMNS_OF_DENSE_TABLE = 7  # from which on a table is set smaller, to fit on a screen
LETTERS_OF_LONG_NAME = 30  # more than a narrow column takes in a cell

Item = TypeVar("Item")


@dataclass(frozen=True)
class Row:
    """Cells, ready to be read; the first one names the row."""

    cells: Sequence[str]  # one per column
    marked: bool = False  # whether the row stands out
    total: bool = False  # whether it sums up the rows above: it stays last where others are sorted


@dataclass(frozen=True)
class PlainTable:
    """One table."""

    caption: str  # heading above it; empty for none
    words: str
    headings: Sequence[str]  # one per column
    rows: Sequence[Row]
    text: Sequence[int] = (0,)  # columns that hold words, not numbers
    note: str = ""  # what the terminal says below it, in the place of `words`
    folded: str = ""  # summary on the page that opens the table; empty shows the table at once

    @property
    def dense(self) -> bool:
        """Whether it has many columns."""
        return len(self.headings) >= COLUMNS_OF_DENSE_TABLE

    @property
    def long_names(self) -> bool:
        """Whether some name of a row takes a line of its own on a phone."""
        return any(len(row.cells[0]) > LETTERS_OF_LONG_NAME for row in self.rows)


def table_of(
    items: Iterable[Item],
    columns: Mapping[str, Callable[[Item], str]],
    *,
    caption: str = "",
    words: str = "",
    text: Sequence[int] = (0,),
    marked: Callable[[Item], bool] = lambda _: False,
    note: str = "",
) -> PlainTable:
    """A table with a row per item: by their headings, columns say what is in an item's cell."""
    rows = [Row(tuple(cell(one) for cell in columns.values()), marked(one)) for one in items]
    return PlainTable(caption, words, list(columns), rows, text, note)


def light_table(
    headings: Sequence[str], left: Sequence[int] = (0,), *, whole: bool = True, **layout: Any
) -> Table:
    """An empty table of the terminal without frame, with some columns aligned to the left.

    In a narrow terminal words are broken and, if `whole`, numbers are not: for short headings.
    """
    table = Table(box=SIMPLE_HEAD, show_edge=False, **({"pad_edge": False} | layout))
    for number, heading in enumerate(headings):
        side: Literal["left", "right"] = "left" if number in left else "right"
        unbroken = whole and number not in left
        overflow: Literal["ellipsis", "fold"] = "ellipsis" if unbroken else "fold"
        table.add_column(Text(heading), justify=side, overflow=overflow, no_wrap=unbroken)
    return table


def text_table(table: PlainTable, title: str) -> Table:
    """The table for the terminal, under its caption, or under `title` if it has none."""
    shown = light_table(table.headings, table.text, whole=False)
    shown.title, shown.title_justify = Text(table.caption or title), "left"
    if table.note:
        shown.caption, shown.caption_justify = Text(table.note), "left"
    return _with_rows(shown, table, range(len(table.headings)))


def narrow_table(table: PlainTable, columns: Sequence[int] | None = None) -> Table:
    """Some columns of a table for the terminal, or all, without lines between them."""
    chosen = range(len(table.headings)) if columns is None else columns
    headings = [table.headings[number] for number in chosen]
    left = [place for place, number in enumerate(chosen) if number in table.text]
    layout = {"pad_edge": True, "padding": (0, 1, 0, 0)}
    return _with_rows(light_table(headings, left, whole=False, **layout), table, chosen)


def _with_rows(shown: Table, table: PlainTable, columns: Sequence[int]) -> Table:
    for row in table.rows:
        style = "bold" if row.marked or row.total else None
        shown.add_row(*(Text(row.cells[number]) for number in columns), style=style)
    return shown
