"""How much of a Parquet file is decoded at a time, before Polars decodes it.

A page is decoded whole, and a few bytes can stand for a page of any length. Files of ordinary row
groups are known from their end alone; the pages of larger groups are walked through, header by
header. The layout is that of apache/parquet-format, in Thrift's compact protocol.
"""

from collections.abc import Iterator
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import IO, Any

ORDINARY = 1 << 18
"""Rows of a group up to which its pages are not looked at."""
LONGEST_FOOTER = 1 << 26
HEADER = 1 << 16
DEEPEST = 16

TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)


@lru_cache(maxsize=64)
def longest_page(path: Path, changed: int, size: int) -> int:
    """Values of the longest page of a file as it was at a time, or a bound on them.

    Raises:
        ValueError: The end of the file, or the header of a page, is broken.
    """
    try:
        with path.open("rb") as file:
            return _longest(file, size)
    except (TypeError, AttributeError) as error:
        raise ValueError("its description is not that of a table") from error


def _longest(file: IO[bytes], size: int) -> int:
    groups = _footer(file, size).get(4, ())
    most = max((_number(group, 3) for group in groups), default=0)
    if most <= ORDINARY:
        return most
    chunks = (chunk.get(3, {}) for group in groups for chunk in group.get(1, ()))
    return max((values for meta in chunks for values in _pages(file, meta, size)), default=0)


def _footer(file: IO[bytes], size: int) -> dict[int, Any]:
    file.seek(max(0, size - 8))
    end = file.read(8)
    length = int.from_bytes(end[:4], "little")
    if end[4:] != b"PAR1" or not 0 < length <= min(size - 12, LONGEST_FOOTER):
        raise ValueError("it does not end as Parquet does")
    file.seek(size - 8 - length)
    return _Thrift(BytesIO(file.read(length))).struct()


def _pages(file: IO[bytes], meta: dict[int, Any], size: int) -> Iterator[int]:
    """Values of each page of a column in a row group."""
    left = _number(meta, 5)
    offsets = [meta[key] for key in (9, 11) if meta.get(key)]
    at = min(offsets, default=0)
    while left > 0:
        if not 0 < at < size:
            raise ValueError("a page lies outside of it")
        file.seek(at)
        header = BytesIO(file.read(HEADER))
        page = _Thrift(header).struct()
        data = page.get(5) or page.get(8)
        values = _number(data or page.get(7, {}), 1)
        yield values
        left -= values if data else 0
        at += header.tell() + _number(page, 3)
        if data and values == 0:
            raise ValueError("a page holds no values")


def _number(struct: dict[int, Any], field: int) -> int:
    value = struct.get(field, 0)
    if not isinstance(value, int) or value < 0:
        raise ValueError("a number in its description makes no sense")
    return value


class _Thrift:
    """Reads structs as dictionaries from field number to value."""

    def __init__(self, stream: BytesIO) -> None:
        self._stream = stream

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """The struct that starts here."""
        if depth > DEEPEST:
            raise ValueError("its description is too deep")
        fields: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._signed()
            kind = head & 15
            fields[number] = kind == TRUE if kind <= FALSE else self._value(kind, depth)
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (I16, I32, I64):
            return self._signed()
        if kind in (TRUE, FALSE, BYTE):
            return self._byte()
        if kind == DOUBLE:
            return self._bytes(8)
        if kind == BINARY:
            return self._bytes(self._unsigned())
        if kind in (LIST, SET):
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._unsigned()
            return [self._value(head & 15, depth + 1) for _ in range(self._fits(count))]
        if kind == STRUCT:
            return self.struct(depth + 1)
        raise ValueError("its description cannot be read")

    def _fits(self, count: int) -> int:
        """A count of things of a byte at least."""
        if count > self._stream.getbuffer().nbytes - self._stream.tell():
            raise ValueError("its description is longer than declared")
        return count

    def _signed(self) -> int:
        value = self._unsigned()
        return (value >> 1) ^ -(value & 1)

    def _unsigned(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
            if shift > 63:
                raise ValueError("a number in its description is too long")

    def _byte(self) -> int:
        return self._bytes(1)[0]

    def _bytes(self, count: int) -> bytes:
        return self._stream.read(self._fits(count))
