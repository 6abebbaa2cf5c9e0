"""Logs as text tables: their header lines, what divides their columns, and their numbers."""

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import LogError, available
from steelyard.logs.log_and_errors import (
    ROWS_OF_PART,
    RowRange,
    ambiguous,
    reading,
    require_columns,
    require_file,
)

SEPARATORS = ",;\t| "
COMMENT = ("#", "%")
MISSING_CELLS = frozenset(("", "na", "n/a", "null", "none", "-"))
UNITS = frozenset(
    "s sec ms us µs ns min h hz rad deg ° m mm cm rad/s deg/s °/s rpm m/s mm/s rad/s2 rad/s^2 "
    "rad/s² deg/s2 deg/s^2 m/s2 m/s^2 m/s² a ma v nm n*m n·m n.m n knm kn kg k c °c %".split()
)
_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_POINT = re.compile(r"[+-]?\d+\.\d*([eE][+-]?\d+)?")
_BLANK = re.compile(r"\s+")
_CLOCK = re.compile(
    rb"(?<![\w:.+/-])(?:(\d{4})[-/](\d\d)[-/](\d\d)[T ])?(\d\d):(\d\d):(\d\d)(\.\d+)?"
    rb"(?: ?(?:Z|UTC)|([+-]\d\d):?(\d\d))?(?![\w:.])"
)
DAY_1970 = date(1970, 1, 1).toordinal()
_BRACKETED = re.compile(r"\[[^\]]*\]|\([^)]*\)")


@dataclass(frozen=True)
class Header:
    """What the first lines of a text table say; its rows start in the line with number `body`.

    Columns are called `column_1`, ... if no line names them.
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


def _seen(
    lines: Sequence[str], separator: str
) -> tuple[tuple[bool, bool, int, int, int], Header] | None:
    """The header if columns were divided by a separator, and how well that fits."""

    @cache
    def row(number: int) -> list[str]:
        """Cells of a line, divided when it is looked at; of a comment without its sign."""
        line = lines[number]
        bare = line.lstrip("#% \t") if line.startswith(COMMENT) else line
        return cells_of(bare, separator)

    plain = [i for i, line in enumerate(lines) if line.strip() and not line.startswith(COMMENT)]
    pairs = zip(plain, [*plain[1:], -1], strict=False)
    first = next((i for i, after in pairs if _is_row(row(i), row(after))), None)
    width = 0 if first is None else len(row(first))
    above = [i for i in plain if (first is None or i < first) and any(map(_is_word, row(i)))]
    if not above:  # the last comment names the columns, if it is as wide as the rows
        comments = [i for i, line in enumerate(lines[:first]) if line.strip(" \t#%")]
        above = [i for i in comments if first is None or len(row(i)) == width > 1][-1:]
    if not above and first is None:
        return None
    names, body = _names(row, above, first)
    kinds = [] if first is None else [_is_number(c) or _is_missing(c) for c in row(first)]
    fits = (
        len(names) == width > 1,
        bool(kinds) and all(kinds),
        sum(kinds),
        len(names),
        -SEPARATORS.index(separator),
    )
    numbers = () if separator == "," else range(body, len(lines))
    cells = [cell for number in numbers for cell in row(number)]
    comma = any(map(_COMMA.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells))
    return fits, Header(names, separator, comma, body)


def _names(
    row: Callable[[int], list[str]], above: Sequence[int], first: int | None
) -> tuple[tuple[str, ...], int]:
    if first is None:
        return tuple(row(above[0])), above[0] + 1
    if not above:
        return tuple(f"column_{number + 1}" for number in range(len(row(first)))), first
    fitting = [i for i in above if len(row(i)) == len(row(first))]
    line = fitting[-1] if fitting else max(above, key=lambda i: len(row(i)))
    if len(fitting) > 1 and _is_units(row(line)):
        pairs = zip(row(fitting[-2]), row(line), strict=True)
        return tuple(_with_unit(name, unit) for name, unit in pairs), line + 1
    return tuple(row(line)), line + 1


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes and blanks around them; times are whole seconds."""
    if ":" in line:
        line = clocks_in_seconds(line.encode(), b"").decode()
    if separator == " ":
        line = _BLANK.sub(" ", line).strip()
    row = line.split(separator) if line else []
    if '"' in line:
        with suppress(csv.Error):
            row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in row]


def clocks_in_seconds(text: bytes, mark: bytes) -> bytes:
    """Text in which times, `2025-03-04T10:00:00.010+01:00` or `10:00:00.010`, are seconds.

    They count from 1970 or from midnight; without a decimal `mark` their fractions are left out.
    """

    def seconds(found: re.Match[bytes]) -> bytes:
        *day_of, hour, minute, second, fraction, zone, beyond = found.groups()
        try:
            day = date(*map(int, day_of)).toordinal() - DAY_1970 if day_of[0] else 0
        except ValueError:
            return found[0]
        whole = 86400 * day + 3600 * int(hour) + 60 * int(minute) + int(second)
        if zone:
            whole -= 60 * (60 * int(zone) + int(zone[:1] + beyond))
        if not (mark and fraction):
            return b"%d" % whole
        return f"{whole + float(fraction):.9f}".encode().replace(b".", mark)

    return _CLOCK.sub(seconds, text)


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
    return cell.lower() in MISSING_CELLS


def _is_word(cell: str) -> bool:
    return not _is_number(cell) and not _is_missing(cell)


def _is_units(row: Sequence[str]) -> bool:
    filled = [cell for cell in row if not _is_missing(cell)]
    return bool(filled) and all(_BRACKETED.fullmatch(c) or c.lower() in UNITS for c in filled)


def _with_unit(name: str, unit: str) -> str:
    bare = unit.strip("[]() ")
    return name if _is_missing(bare) or bare in name else f"{name} [{bare}]"


CHUNK = 1 << 22  # bytes read at a time
LONGEST_LINE = 1 << 24  # bytes of a line, or of blank lines in a row
HEADER_BYTES = 1 << 20  # bytes in which the first row starts
HEADER_LINES = 500  # lines that are looked at for the header
MOST_TEXT_COLUMNS = 10_000
CELLS = 1 << 19  # cells parsed at a time
SMALL = 1 << 20  # bytes of a file up to which its numbers are kept for the next pass
FILES_KEPT = 16  # small files that are kept


@dataclass(frozen=True)
class DelimitedLog:
    """A text table with a line of names above its rows, or without; see `Header` and `read_header`.

    A cell that is neither a number nor a time is NaN, as are the cells that a short row lacks; what
    a long row has too many is left out. Quotes around cells and blanks beside them are taken off.
    The first row starts at byte `body`.

    Columns whose name and first values are those of an earlier one are its `copies`, by name and
    place in the row, and are left out; rows in which they differ are refused. `texts` are columns
    with the word that all their first cells hold, such as a joint's name.
    """

    path: Path
    columns: tuple[str, ...]
    separator: str
    decimal_comma: bool
    body: int
    places: tuple[int, ...]
    copies: tuple[tuple[str, int], ...] = ()
    texts: tuple[tuple[str, str], ...] = ()

    @property
    def left_out(self) -> tuple[tuple[str, str], ...]:
        """Name and reason of columns that are left out."""
        return tuple((name, "a copy of the column of this name") for name, _ in self.copies)

    @classmethod
    def open(cls, path: Path) -> "DelimitedLog":
        """Read the header and guess the separator."""
        require_file(path)
        with reading(path), path.open("rb") as file:
            head = file.read(HEADER_BYTES)
        lines = head.split(b"\n", HEADER_LINES)[:HEADER_LINES]
        if len(lines) > 1 and len(head) == HEADER_BYTES:
            lines.pop()
        text = [line.decode("utf-8", errors="replace").strip("\ufeff \r") for line in lines]
        _require_text(path, next((line for line in lines if line.strip()), b""))
        header = read_header(text)
        if header is None or not any(header.columns):
            raise LogError(
                "the file holds no table",
                where=str(path),
                fix="give a header and one row per sample",
            )
        _require_text(path, b"".join(lines[: header.body]))
        if len(header.columns) > MOST_TEXT_COLUMNS:
            raise LogError(
                f"the file's first lines name {len(header.columns)} columns; that is no table of "
                "a robot",
                where=str(path),
                fix="check that the file is the log, and that its lines are ended",
            )
        if not is_table(text, header):
            raise LogError(
                "the file does not look like a table: its lines hold no rows of numbers",
                where=str(path),
                fix="give a log: a header, and one row of numbers per sample",
            )
        body = sum(len(line) + 1 for line in lines[: header.body])
        copies = _copies(text, header)
        left_out = {place for _, place in copies}
        places = tuple(k for k in range(len(header.columns)) if k not in left_out)
        names = tuple(header.columns[k] for k in places)
        cells = zip(*_rows_below(text, header), strict=False)
        first = {k: column[0] for k, column in enumerate(cells) if len(set(column)) == 1}
        words = ((header.columns[k], cell) for k, cell in first.items() if k in places)
        texts = tuple((name, cell) for name, cell in words if _is_word(cell))
        mark = header.separator, header.decimal_comma
        return cls(path, names, *mark, body, places, copies, texts)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        require_columns(self.path, self.columns, columns)
        wanted = [self.places[self.columns.index(column)] for column in columns]
        copies = [(place, columns.index(name)) for name, place in self.copies if name in columns]
        for part in self._parts([*wanted, *(place for place, _ in copies)], rows, size):
            for k, (_, first) in enumerate(copies, len(columns)):
                if not np.array_equal(part[:, k], part[:, first], equal_nan=True):
                    raise ambiguous(self.path, columns[first], 2)
            yield part[:, : len(columns)]

    def _parts(self, wanted: Sequence[int], rows: RowRange, size: int) -> Iterator[Array]:
        """The requested rows of the columns at some places."""
        with reading(self.path):
            facts = self.path.stat()
        if facts.st_size <= SMALL:
            stamp = facts.st_size, facts.st_mtime_ns, facts.st_ino, facts.st_dev
            table = _kept(self, tuple(wanted), stamp)[slice(*rows)]
            for i in range(0, len(table), size):
                yield table[i : i + size]
            return
        start, stop = rows
        row = 0
        for chunk in self._pieces(max(wanted, default=0) + 1):
            length = chunk.count(b"\n")
            first = max(start - row, 0)
            last = length if stop is None else min(stop - row, length)
            if first < last:
                table = self._numbers(chunk, wanted)[first:last]
                for i in range(0, len(table), size):
                    yield table[i : i + size]
                del table
            row += length
            if stop is not None and row >= stop:
                return

    def _pieces(self, width: int) -> Iterator[bytes]:
        """The chunks, divided where very short lines would make too many cells."""
        limit = max(1, CELLS // width)
        for chunk in self._chunks():
            if chunk.count(b"\n") <= limit:
                yield chunk
                continue
            ends = np.flatnonzero(np.frombuffer(chunk, np.uint8) == ord("\n")) + 1
            start = 0
            for end in [*ends[limit - 1 : -1 : limit].tolist(), len(chunk)]:
                yield chunk[start:end]
                start = end

    def _chunks(self) -> Iterator[bytes]:
        """Whole lines, about `CHUNK` bytes at a time; the last is ended, blank ones after it go."""
        with reading(self.path), self.path.open("rb") as file:
            file.seek(self.body)
            rest = b""
            while block := file.read(CHUNK):
                rest += block
                end = rest.find(b"\n", len(rest.rstrip())) + 1 or rest.rfind(b"\n") + 1
                if rest[:end].strip():
                    yield rest[:end]
                    rest = rest[end:]
                elif len(rest) > LONGEST_LINE:
                    raise LogError(
                        f"more than {LONGEST_LINE >> 20} MiB of the log hold no ended row",
                        where=str(self.path),
                        fix="check that the file is a text table with one line per sample",
                    )
            if rest.strip():
                yield rest + b"\n"

    def _numbers(self, chunk: bytes, wanted: Sequence[int]) -> Array:
        parsed = by_polars if available("polars") else by_numpy
        lines = tidied(chunk, self.separator, self.decimal_comma)
        return parsed(lines, wanted, self.separator, self.decimal_comma)


@lru_cache(maxsize=FILES_KEPT)
def _kept(log: DelimitedLog, wanted: tuple[int, ...], stamp: tuple[int, ...]) -> Array:
    """Columns of all rows of a small file as it was, shape `(N, len(wanted))`, read-only."""
    pieces = log._pieces(max(wanted, default=0) + 1)
    parts = [np.empty((0, len(wanted))), *(log._numbers(piece, wanted) for piece in pieces)]
    table = np.concatenate(parts)
    table.setflags(write=False)
    return table


def by_polars(chunk: bytes, wanted: Sequence[int], separator: str, decimal_comma: bool) -> Array:
    """Columns of ended lines as floats, shape `(lines, len(wanted))`; other cells are NaN."""
    import polars as pl

    width = max(wanted, default=0) + 1
    names = [f"column_{i}" for i in range(width)]
    # A full first row keeps Polars from judging the table's width by a broken one.
    table = pl.read_csv(
        separator.join(["0"] * width).encode() + b"\n" + chunk,
        has_header=False,
        columns=list(dict.fromkeys(names[i] for i in wanted)),
        separator=separator,
        schema=dict.fromkeys(names, pl.Float64),
        quote_char=None,
        decimal_comma=decimal_comma,
        ignore_errors=True,
        truncate_ragged_lines=True,
    )
    return table.select(pl.col(names[i]).fill_null(np.nan) for i in wanted).to_numpy()[1:]


def by_numpy(chunk: bytes, wanted: Sequence[int], separator: str, decimal_comma: bool) -> Array:
    """The same as `by_polars` without Polars, about a tenth as fast."""
    text = chunk.decode("latin-1")
    lines = (text.replace(",", ".") if decimal_comma else text).split("\n")[:-1]
    if wanted and all(lines):
        with suppress(ValueError):  # some cell may be no number
            return np.loadtxt(lines, delimiter=separator, usecols=wanted, comments=None, ndmin=2)
    rows = [line.split(separator) for line in lines]
    cells = [[_cell_number(row[i]) if i < len(row) else np.nan for i in wanted] for row in rows]
    return np.array(cells, dtype=np.float64).reshape(len(lines), len(wanted))


def _cell_number(cell: str) -> float:
    """The number in a cell; NaN if it holds none."""
    try:
        return np.nan if "_" in cell else float(cell)
    except ValueError:
        return np.nan


def tidied(chunk: bytes, separator: str, decimal_comma: bool) -> bytes:
    """The lines with nothing in them that a number does not have: quotes, blanks, NUL bytes.

    Separators inside quotes become part of the cell, and times seconds.
    """
    if b'"' in chunk:
        quoted = re.compile(rb'"[^"\n]*"')
        mark = separator.encode()
        chunk = quoted.sub(lambda cell: cell[0].replace(mark, b"_"), chunk).replace(b'"', b"")
    chunk = chunk.replace(b"\r", b"")
    if b":" in chunk:
        chunk = clocks_in_seconds(chunk, b"," if decimal_comma else b".")
    if separator == " ":
        chunk = re.sub(rb"(?m)^ | $", b"", re.sub(rb"[ \t]+", b" ", chunk))
    elif b" " in chunk:
        chunk = chunk.replace(b" ", b"")
    return chunk


def _copies(lines: Sequence[str], header: Header) -> tuple[tuple[str, int], ...]:
    """Name and place of columns that have the name, and in some rows the cells, of an earlier one.

    None of a name of which any column differs.
    """
    places = by_key((name, place) for place, name in enumerate(header.columns))
    twice = {name: among for name, among in places.items() if name and len(among) > 1}
    rows = [*_rows_below(lines, header)] if twice else []
    return tuple(
        (name, place)
        for name, (first, *others) in twice.items()
        if rows and all(row[k : k + 1] == row[first : first + 1] for row in rows for k in others)
        for place in others
    )


def _require_text(path: Path, line: bytes) -> None:
    if line.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\x00" in line:
        raise LogError(
            "the file is not a text table in UTF-8",
            where=str(path),
            fix="save it as CSV in UTF-8; a Parquet file needs the suffix .parquet",
        )
