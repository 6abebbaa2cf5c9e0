"""Logs as text tables: columns divided by comma, semicolon, tab or space; a header with names."""

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.log import PART, Rows, require_columns, require_file

SEPARATORS = ",;\t "
CHUNK = 1 << 22
"""Bytes read at a time."""


@dataclass(frozen=True)
class DelimitedLog:
    """A text table whose first line names the columns.

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
            LogError: Not there, not text, or without a header.
        """
        require_file(path)
        try:
            with path.open("rb") as file:
                skipped, line = 0, file.readline(CHUNK)
                while line and not line.strip():
                    skipped, line = skipped + len(line), file.readline(CHUNK)
                first = file.readline(CHUNK)
        except OSError as error:
            raise _unreadable(path, error) from error
        _require_text(path, line)
        header = line.decode("utf-8-sig", errors="replace").strip().lstrip("#%").strip()
        separator = max(SEPARATORS, key=lambda s: (len(_cells(header, s)), -SEPARATORS.index(s)))
        columns = tuple(cell.strip() for cell in _cells(header, separator))
        _require_header(path, columns)
        return cls(
            path, columns, separator, separator == ";" and b"," in first, skipped + len(line)
        )

    def parts(
        self, columns: Sequence[str], rows: Rows = (0, None), size: int = PART
    ) -> Iterator[Array]:
        """The rows asked for, in parts; see `Log`."""
        require_columns(self.path, self.columns, columns)
        wanted = [self.columns.index(column) for column in columns]
        start, stop = rows
        row = 0
        for chunk in self._chunks():
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
                if rest.strip():
                    yield rest + b"\n"
        except OSError as error:
            raise _unreadable(self.path, error) from error

    def _numbers(self, chunk: bytes, wanted: Sequence[int]) -> Array:
        import polars as pl

        width = len(self.columns)
        names = [f"column_{i}" for i in range(width)]
        # A full first row keeps Polars from judging the table's width by a broken one.
        full = self.separator.join(["0"] * width).encode() + b"\n"
        table = pl.read_csv(
            full + tidied(chunk, self.separator),
            has_header=False,
            columns=list(dict.fromkeys(names[i] for i in wanted)),
            separator=self.separator,
            schema=dict.fromkeys(names, pl.Float64),
            quote_char=None,
            decimal_comma=self.decimal_comma,
            ignore_errors=True,
            truncate_ragged_lines=True,
        )
        return table.select(pl.col(names[i]).fill_null(np.nan) for i in wanted).to_numpy()[1:]


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


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        line = re.sub(r"\s+", " ", line.replace("\t", " "))
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def _require_text(path: Path, line: bytes) -> None:
    if line.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\x00" in line:
        raise LogError(
            "the file is not a text table in UTF-8",
            where=str(path),
            mend="save it as CSV in UTF-8; a Parquet file needs the suffix .parquet",
        )


def _require_header(path: Path, columns: Sequence[str]) -> None:
    if not any(columns):
        raise LogError(
            "the file holds no table", where=str(path), mend="give a header and one row per sample"
        )
    numbers = [cell for cell in columns if _is_number(cell)]
    if 2 * len(numbers) > len(columns):
        raise LogError(
            f"the first line names no columns: it starts with the number {numbers[0]}",
            where=f"{path}, line 1",
            mend="put a header above the rows, such as time_s,q1_rad,...",
        )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _unreadable(path: Path, error: OSError) -> LogError:
    return LogError(
        f"the log cannot be read ({error.strerror or error})",
        where=str(path),
        mend="check the file's permissions and the disk",
    )
