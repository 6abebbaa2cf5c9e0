"""Rows of a text table, or of JSON objects a line, that arrives in pieces of any size."""

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.log import require_columns
from steelyard.formats.tables.delimited import LINES, by_numpy, tidied
from steelyard.formats.tables.header import Header, read_header, rows_of_numbers

ROWS = 2
"""Rows of numbers below a header, with which it is known."""

LONGEST = 1 << 20
"""Bytes of a line, at most."""


class Lines:
    """Turns pieces of bytes into rows of columns.

    Lines before the header are passed over; it is known once two rows follow it. A table whose
    first line is a JSON object has such objects in all lines, with the columns as their keys. A
    cell that is missing or no number is NaN; a line that is no row, and a last line without its
    end, are rows of NaN.
    """

    def __init__(self, path: Path, wanted: Sequence[str]) -> None:
        """Begin.

        Args:
            path: Where the bytes come from, for messages.
            wanted: Columns of the rows, in their order.
        """
        self._path, self._wanted = path, tuple(wanted)
        self._rest = b""
        self._header: Header | None = None
        self._json = False

    def rows(self, pieces: Iterable[bytes]) -> Iterator[Array]:
        """Rows of every piece, shape `(N, len(wanted))` with N > 0.

        Raises:
            LogError: There is no table, it lacks a column, or a line does not end.
        """
        for piece in pieces:
            self._rest += piece
            end = self._rest.rfind(b"\n") + 1
            if len(self._rest) - end > LONGEST:
                raise LogError(
                    f"a line is longer than {LONGEST >> 20} MiB",
                    where=str(self._path),
                    fix="give one line per sample",
                )
            if not end or not self._begun(self._rest[:end]):
                continue
            end = self._rest.rfind(b"\n") + 1
            whole, self._rest = self._rest[:end], self._rest[end:]
            lines = [line for line in whole.split(b"\n") if line.strip()]
            if lines:
                yield self._objects(lines) if self._json else self._cells(lines)
        if self._header is None and not self._json:
            raise self._no_table()
        if self._rest.strip():
            yield np.full((1, len(self._wanted)), np.nan)

    def _begun(self, whole: bytes) -> bool:
        """Whether the header is known; it is taken off when it becomes so."""
        if self._json or self._header is not None:
            return True
        lines = whole.split(b"\n")[:-1]
        text = [line.decode("utf-8", errors="replace").strip("\ufeff \r") for line in lines]
        first = next((line for line in text if line), "")
        if first.startswith("{"):
            require_columns(self._path, tuple(self._object(first.encode())), self._wanted)
            self._json = True
            return True
        header = read_header(text[:LINES])
        if header is None or rows_of_numbers(text[:LINES], header) < ROWS:
            if len(lines) > LINES:
                raise self._no_table()
            return False
        require_columns(self._path, header.columns, self._wanted)
        self._header = header
        self._rest = self._rest[sum(len(line) + 1 for line in lines[: header.body]) :]
        return True

    def _cells(self, lines: Sequence[bytes]) -> Array:
        header = self._header
        assert header is not None
        places = [header.columns.index(name) for name in self._wanted]
        chunk = tidied(b"\n".join(lines) + b"\n", header.separator)
        return by_numpy(chunk, places, header.separator, header.decimal_comma)

    def _objects(self, lines: Sequence[bytes]) -> Array:
        found = (self._object(line) for line in lines)
        rows = [[_number(one.get(name)) for name in self._wanted] for one in found]
        return np.array(rows, dtype=np.float64)

    def _object(self, line: bytes) -> dict[str, object]:
        try:
            found = json.loads(line)
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}

    def _no_table(self) -> LogError:
        return LogError(
            "there is no table: no header with two rows of numbers below it",
            where=str(self._path),
            fix="send a line of column names, then one line per sample; or one JSON object a line",
        )


def _number(value: object) -> float:
    """A number of JSON; NaN if it is none."""
    known = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if known else np.nan  # type: ignore[arg-type]
