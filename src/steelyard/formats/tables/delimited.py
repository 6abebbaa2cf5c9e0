"""Logs as text tables: columns divided by comma, semicolon, tab, bar or space."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.extras import available
from steelyard.formats.log import PART, Rows, require_columns, require_file
from steelyard.formats.tables.header import is_table, read_header

CHUNK = 1 << 22
"""Bytes read at a time."""
LONGEST = 1 << 24
"""Bytes of a line, or of blank lines in a row."""
HEAD = 1 << 20
"""Bytes in which the first row starts."""
LINES = 500
"""Lines that are looked at for the header."""
WIDEST = 10_000
CELLS = 1 << 19
"""Cells parsed at a time."""
SMALL = 1 << 20
"""Bytes of a file up to which its numbers are kept for the next pass."""
KEPT = 16
"""Small files that are kept."""


@dataclass(frozen=True)
class DelimitedLog:
    """A text table with a line of names above its rows, or without; see `read_header`.

    A cell that is not a number is NaN, as are the cells that a short row lacks; what a long row
    has too many is left out. Quotes around cells and blanks beside them are taken off.

    Attributes:
        path: Where it is.
        columns: Names of its columns.
        separator: What divides the columns.
        decimal_comma: Whether numbers are written `0,5`.
        body: Byte at which the first row starts.
    """

    path: Path
    columns: tuple[str, ...]
    separator: str
    decimal_comma: bool
    body: int

    @classmethod
    def open(cls, path: Path) -> "DelimitedLog":
        """Read the header and guess the separator.

        Raises:
            LogError: Not there, not text, or without a table.
        """
        require_file(path)
        try:
            with path.open("rb") as file:
                head = file.read(HEAD)
        except OSError as error:
            raise _unreadable(path, error) from error
        lines = head.split(b"\n", LINES)[:LINES]
        if len(lines) > 1 and len(head) == HEAD:
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
        _require_width(path, header.columns)
        if not is_table(text, header):
            raise LogError(
                "the file does not look like a table: its lines hold no rows of numbers",
                where=str(path),
                fix="give a log: a header, and one row of numbers per sample",
            )
        body = sum(len(line) + 1 for line in lines[: header.body])
        return cls(path, header.columns, header.separator, header.decimal_comma, body)

    def parts(
        self, columns: Sequence[str], rows: Rows = (0, None), size: int = PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        require_columns(self.path, self.columns, columns)
        wanted = [self.columns.index(column) for column in columns]
        if (stamp := self._stamp())[0] <= SMALL:
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

    def _stamp(self) -> tuple[int, ...]:
        """Size of the file, when it was changed, and which it is."""
        try:
            facts = self.path.stat()
        except OSError as error:
            raise _unreadable(self.path, error) from error
        return facts.st_size, facts.st_mtime_ns, facts.st_ino, facts.st_dev

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

    def _endless(self) -> LogError:
        return LogError(
            f"more than {LONGEST >> 20} MiB of the log hold no ended row",
            where=str(self.path),
            fix="check that the file is a text table with one line per sample",
        )

    def _chunks(self) -> Iterator[bytes]:
        """Whole lines, about `CHUNK` bytes at a time; the last is ended, blank ones after it go."""
        try:
            with self.path.open("rb") as file:
                file.seek(self.body)
                rest = b""
                while block := file.read(CHUNK):
                    rest += block
                    end = rest.find(b"\n", len(rest.rstrip())) + 1 or rest.rfind(b"\n") + 1
                    if rest[:end].strip():
                        yield rest[:end]
                        rest = rest[end:]
                    elif len(rest) > LONGEST:
                        raise self._endless()
                if rest.strip():
                    yield rest + b"\n"
        except OSError as error:
            raise _unreadable(self.path, error) from error

    def _numbers(self, chunk: bytes, wanted: Sequence[int]) -> Array:
        parsed = by_polars if available("polars") else by_numpy
        return parsed(tidied(chunk, self.separator), wanted, self.separator, self.decimal_comma)


@lru_cache(maxsize=KEPT)
def _kept(log: DelimitedLog, wanted: tuple[int, ...], stamp: tuple[int, ...]) -> Array:
    """Columns of all rows of a small file, shape `(N, len(wanted))`, read-only."""
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
    full = separator.join(["0"] * width).encode() + b"\n"
    table = pl.read_csv(
        full + chunk,
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
        try:
            return np.loadtxt(lines, delimiter=separator, usecols=wanted, comments=None, ndmin=2)
        except ValueError:
            pass  # some cell is not a number
    rows = [line.split(separator) for line in lines]
    cells = [[_number(row[i]) if i < len(row) else np.nan for i in wanted] for row in rows]
    return np.array(cells, dtype=np.float64).reshape(len(lines), len(wanted))


def _number(cell: str) -> float:
    """The number in a cell; NaN if it holds none."""
    try:
        return np.nan if "_" in cell else float(cell)
    except ValueError:
        return np.nan


def tidied(chunk: bytes, separator: str) -> bytes:
    """The lines with nothing in them that a number does not have: quotes, blanks, NUL bytes.

    Separators inside quotes become part of the cell.
    """
    if b'"' in chunk:
        quoted = re.compile(rb'"[^"\n]*"')
        mark = separator.encode()
        chunk = quoted.sub(lambda cell: cell[0].replace(mark, b"_"), chunk).replace(b'"', b"")
    chunk = chunk.replace(b"\r", b"")
    if separator == " ":
        chunk = re.sub(rb"(?m)^ | $", b"", re.sub(rb"[ \t]+", b" ", chunk))
    elif b" " in chunk:
        chunk = chunk.replace(b" ", b"")
    return chunk


def _require_text(path: Path, line: bytes) -> None:
    if line.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\x00" in line:
        raise LogError(
            "the file is not a text table in UTF-8",
            where=str(path),
            fix="save it as CSV in UTF-8; a Parquet file needs the suffix .parquet",
        )


def _require_width(path: Path, columns: Sequence[str]) -> None:
    if len(columns) > WIDEST:
        raise LogError(
            f"the file's first lines name {len(columns)} columns; that is no table of a robot",
            where=str(path),
            fix="check that the file is the log, and that its lines are ended",
        )


def _unreadable(path: Path, error: OSError) -> LogError:
    return LogError(
        f"the log cannot be read ({error.strerror or error})",
        where=str(path),
        fix="check the file's permissions and the disk",
    )
