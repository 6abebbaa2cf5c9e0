"""The lines above a text table's rows: comments, titles, names, units; and what divides columns."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

SEPARATORS = ",;\t| "

COMMENT = ("#", "%")
MISSING = frozenset(("", "na", "n/a", "null", "none", "-"))
UNITS = frozenset(
    "s sec ms us µs ns min h hz rad deg ° m mm cm rad/s deg/s °/s rpm m/s mm/s rad/s2 rad/s^2 "
    "rad/s² deg/s2 deg/s^2 m/s2 m/s^2 m/s² a ma v nm n*m n·m n.m n knm kn kg k c °c %".split()
)
_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_POINT = re.compile(r"[+-]?\d+\.\d*([eE][+-]?\d+)?")
_BLANK = re.compile(r"\s+")
_BRACKETED = re.compile(r"\[[^\]]*\]|\([^)]*\)")


@dataclass(frozen=True)
class Header:
    """What the first lines of a text table say.

    Attributes:
        columns: Names of its columns: `column_1`, ... if no line names them.
        separator: What divides the columns.
        decimal_comma: Whether numbers are written `0,5`.
        body: Number of the line that the rows start in.
    """

    columns: tuple[str, ...]
    separator: str
    decimal_comma: bool
    body: int


def read_header(lines: Sequence[str]) -> Header | None:
    """The header in a table's first lines; `None` if they are blank or comments only.

    The rows start at the first line that is mostly numbers, or rather behind the line of names
    above it: the last one as wide as the rows, be it behind a comment sign. If that holds units
    only, the names are in the line above it, and become `q1 [rad]`.
    """
    text = "".join(lines)
    there = [s for s in SEPARATORS if (_BLANK.search(text) if s == " " else s in text)]
    found = [view for view in (_seen(lines, s) for s in there) if view is not None]
    if not any(divided for (divided, *_), _ in found):
        # all that the lines do not contain divide nothing: one stands for them
        absent = [s for s in SEPARATORS if s not in there][:1]
        found += [view for s in absent if (view := _seen(lines, s)) is not None]
    return max(found, key=lambda view: view[0])[1] if found else None


def is_table(lines: Sequence[str], header: Header) -> bool:
    """Whether some row below a header has numbers; without, whether the header is one of a table.

    Words divided by blanks, with other words below them, are no names of columns; nor are names
    that repeat.
    """
    names, below = header.columns, False
    for row in _rows_below(lines, header):
        if _is_row(row, ()) or (len(row) == len(names) and not all(map(_is_word, row))):
            return True
        below = True
    return len(set(names)) == len(names) and not (below and header.separator == " ")


def rows_of_numbers(lines: Sequence[str], header: Header) -> int:
    """How many lines below a header are mostly numbers."""
    return sum(_is_row(row, ()) for row in _rows_below(lines, header))


def _rows_below(lines: Sequence[str], header: Header) -> Iterator[list[str]]:
    return (
        cells_of(line, header.separator)
        for line in lines[header.body :]
        if line.strip() and not line.startswith(COMMENT)
    )


class _Rows(dict[int, list[str]]):
    """Cells of the lines, by number, each divided when it is looked at; comments without a sign."""

    def __init__(self, lines: Sequence[str], separator: str) -> None:
        super().__init__()
        self._lines, self._separator = lines, separator

    def __missing__(self, number: int) -> list[str]:
        line = self._lines[number]
        bare = line.lstrip("#% \t") if line.startswith(COMMENT) else line
        self[number] = cells_of(bare, self._separator)
        return self[number]


def _seen(
    lines: Sequence[str], separator: str
) -> tuple[tuple[bool, bool, int, int, int], Header] | None:
    """The header if columns were divided by a separator, and how well that fits."""
    rows = _Rows(lines, separator)
    plain = [i for i, line in enumerate(lines) if line.strip() and not line.startswith(COMMENT)]
    pairs = zip(plain, [*plain[1:], -1], strict=False)
    first = next((i for i, after in pairs if _is_row(rows[i], rows[after])), None)
    width = 0 if first is None else len(rows[first])
    above = [i for i in plain if (first is None or i < first) and any(map(_is_word, rows[i]))]
    if not above:
        above = _of_comments(lines, rows, first)
    if not above and first is None:
        return None
    names, body = _names(rows, above, first)
    kinds = [] if first is None else [_is_number(c) or _is_missing(c) for c in rows[first]]
    fits = (
        len(names) == width > 1,
        bool(kinds) and all(kinds),
        sum(kinds),
        len(names),
        -SEPARATORS.index(separator),
    )
    numbers = () if separator == "," else range(body, len(lines))
    cells = [cell for number in numbers for cell in rows[number]]
    comma = any(map(_COMMA.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells))
    return fits, Header(names, separator, comma, body)


def _of_comments(
    lines: Sequence[str], rows: Mapping[int, Sequence[str]], first: int | None
) -> list[int]:
    """The comment line that names the columns, if one does."""
    comments = [i for i in range(len(lines) if first is None else first) if lines[i].strip(" \t#%")]
    if first is not None:
        comments = [i for i in comments if len(rows[i]) == len(rows[first]) > 1]
    return comments[-1:]


def _names(
    rows: Mapping[int, Sequence[str]], above: Sequence[int], first: int | None
) -> tuple[tuple[str, ...], int]:
    """Names of the columns, and the line behind them."""
    if first is None:
        return tuple(rows[above[0]]), above[0] + 1
    if not above:
        return tuple(f"column_{number + 1}" for number in range(len(rows[first]))), first
    fitting = [i for i in above if len(rows[i]) == len(rows[first])]
    if not fitting:
        widest = max(above, key=lambda i: len(rows[i]))
        return tuple(rows[widest]), widest + 1
    line = fitting[-1]
    if len(fitting) > 1 and _is_units(rows[line]):
        pairs = zip(rows[fitting[-2]], rows[line], strict=True)
        return tuple(_with_unit(name, unit) for name, unit in pairs), line + 1
    return tuple(rows[line]), line + 1


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes and blanks around them."""
    if separator == " ":
        line = _BLANK.sub(" ", line).strip()
    row = line.split(separator) if line else []
    if '"' in line:
        with suppress(csv.Error):
            row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in row]


def _is_row(row: Sequence[str], after: Sequence[str]) -> bool:
    """Whether a line is mostly numbers, and not `time,0,1,2` above a line of more of them."""
    numbers, words = [c for c in row if _is_number(c)], [c for c in row if _is_word(c)]
    if words and all(map(str.isdecimal, numbers)) and sum(map(_is_number, after)) > len(numbers):
        return False
    return len(numbers) > len(words)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return _COMMA.fullmatch(cell) is not None
    return "_" not in cell


def _is_missing(cell: str) -> bool:
    return cell.lower() in MISSING


def _is_word(cell: str) -> bool:
    return not _is_number(cell) and not _is_missing(cell)


def _is_units(row: Sequence[str]) -> bool:
    """Whether a line below the names holds units only."""
    filled = [cell for cell in row if not _is_missing(cell)]
    return bool(filled) and all(_BRACKETED.fullmatch(c) or c.lower() in UNITS for c in filled)


def _with_unit(name: str, unit: str) -> str:
    bare = unit.strip("[]() ")
    return name if _is_missing(bare) or bare in name else f"{name} [{bare}]"
