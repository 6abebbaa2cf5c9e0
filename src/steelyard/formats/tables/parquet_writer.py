"""Parquet written part by part in constant memory, which Polars does from tables in memory only.

One row group a part, one page of plain, uncompressed 64-bit floats a column, as in the format's
specification (apache/parquet-format); its headers are in Thrift's compact protocol.
"""

from collections.abc import Sequence
from struct import pack
from typing import IO

import numpy as np

from steelyard.arrays import Array

I32, I64, BINARY, LIST, STRUCT = 5, 6, 8, 9, 12
DOUBLE, REQUIRED, PLAIN, RLE, UNCOMPRESSED, DATA_PAGE = 5, 0, 0, 3, 0, 0

Field = tuple[int, int, bytes]
"""Number, kind and content of a field of a struct, in rising order of numbers."""


class ParquetWriter:
    """Writes a table of floats to a file.

    Args:
        file: Where to; at its start.
        columns: Names of the columns.
    """

    def __init__(self, file: IO[bytes], columns: Sequence[str]) -> None:
        self._file, self._columns = file, tuple(columns)
        self._rows = 0
        self._groups: list[bytes] = []
        file.write(b"PAR1")

    def write(self, part: Array) -> None:
        """Append rows, shape `(N, number of columns)`."""
        chunks = []
        size = 8 * len(part)
        for name, values in zip(self._columns, part.T, strict=True):
            at = self._file.tell()
            values = np.ascontiguousarray(values, dtype="<f8")
            self._file.write(_page_header(len(part), size))
            self._file.write(values.data)
            chunks.append(_chunk(name, len(part), at, self._file.tell() - at))
        total = size * len(self._columns)
        self._groups.append(
            _struct(
                (1, LIST, _list(STRUCT, chunks)), (2, I64, _int(total)), (3, I64, _int(len(part)))
            )  # fmt: skip
        )
        self._rows += len(part)

    def close(self) -> None:
        """Write the end, without which nothing can be read."""
        root = _struct((4, BINARY, _text("schema")), (5, I32, _int(len(self._columns))))
        leaves = [
            _struct((1, I32, _int(DOUBLE)), (3, I32, _int(REQUIRED)), (4, BINARY, _text(name)))
            for name in self._columns
        ]
        footer = _struct(
            (1, I32, _int(1)),
            (2, LIST, _list(STRUCT, [root, *leaves])),
            (3, I64, _int(self._rows)),
            (4, LIST, _list(STRUCT, self._groups)),
            (6, BINARY, _text("steelyard")),
        )
        self._file.write(footer + pack("<I", len(footer)) + b"PAR1")


def _page_header(rows: int, size: int) -> bytes:
    values = _struct(
        (1, I32, _int(rows)), (2, I32, _int(PLAIN)), (3, I32, _int(RLE)), (4, I32, _int(RLE))
    )
    return _struct(
        (1, I32, _int(DATA_PAGE)), (2, I32, _int(size)), (3, I32, _int(size)), (5, STRUCT, values)
    )


def _chunk(name: str, rows: int, at: int, size: int) -> bytes:
    meta = _struct(
        (1, I32, _int(DOUBLE)),
        (2, LIST, _list(I32, [_int(PLAIN)])),
        (3, LIST, _list(BINARY, [_text(name)])),
        (4, I32, _int(UNCOMPRESSED)),
        (5, I64, _int(rows)),
        (6, I64, _int(size)),
        (7, I64, _int(size)),
        (9, I64, _int(at)),
    )
    return _struct((2, I64, _int(at)), (3, STRUCT, meta))


def _struct(*fields: Field) -> bytes:
    content, before = b"", 0
    for number, kind, value in fields:
        content += bytes([(number - before) << 4 | kind]) + value
        before = number
    return content + b"\0"


def _list(kind: int, items: Sequence[bytes]) -> bytes:
    short = len(items) < 15
    head = bytes([len(items) << 4 | kind]) if short else bytes([0xF0 | kind]) + _size(len(items))
    return head + b"".join(items)


def _text(text: str) -> bytes:
    content = text.encode("utf-8", errors="replace")
    return _size(len(content)) + content


def _int(number: int) -> bytes:
    """A number that is not negative, zigzag-coded."""
    return _size(2 * number)


def _size(number: int) -> bytes:
    """Seven bits a byte, the last one first."""
    coded = []
    while number > 127:
        coded.append(number & 127 | 128)
        number >>= 7
    return bytes([*coded, number])
