"""Logs in Apache Parquet, through Polars: single files and folders of files, in bounded memory.

A column of lists of numbers, all of the length of the first one, is a column for each element.

A page is decoded whole, and a few bytes can stand for a page of any length. Files of ordinary row
groups are known from their end alone; the pages of larger groups are walked through, header by
header. The layout is that of apache/parquet-format, in Thrift's compact protocol.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, require
from steelyard.logs.log_and_errors import (
    ROWS_OF_PART,
    RowRange,
    reading,
    require_columns,
    require_file,
)

if TYPE_CHECKING:
    import polars

ORDINARY_ROWS_OF_GROUP = 1 << 18  # rows of a group up to which its pages are not looked at
LONGEST_FOOTER = 1 << 26
PAGE_HEADER_BYTES = 1 << 16
DEEPEST_THRIFT = 16
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)


@lru_cache(maxsize=1 << 14)
def longest_page(path: Path, changed: int, size: int, lists: bool = False) -> int:
    """Values of the longest page of a file as it was at a time, or a bound on them.

    Where a row may be a list, rows are no bound.
    """
    try:
        with path.open("rb") as file:
            groups = _footer(file, size).get(4, ())
            most = max((_number(group, 3) for group in groups), default=0)
            if most <= ORDINARY_ROWS_OF_GROUP and not lists:
                return most
            chunks = (chunk.get(3, {}) for group in groups for chunk in group.get(1, ()))
            pages = (values for meta in chunks for values in _pages(file, meta, size))
            return max(pages, default=0)
    except (TypeError, AttributeError) as error:
        raise ValueError("its description is not that of a table") from error


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
    at = min((meta[key] for key in (9, 11) if meta.get(key)), default=0)
    while left > 0:
        if not 0 < at < size:
            raise ValueError("a page lies outside of it")
        file.seek(at)
        header = BytesIO(file.read(PAGE_HEADER_BYTES))
        page = _Thrift(header).struct()
        data = page.get(5) or page.get(8)
        values = _number(data or page.get(7, {}), 1)
        yield values
        left -= values if data else 0
        at += header.tell() + _number(page, 3)
        if data and values == 0:
            raise ValueError("a page holds no values")


def _number(struct: dict[int, Any], field: int) -> int:
    if not isinstance(value := struct.get(field, 0), int) or value < 0:
        raise ValueError("a number in its description makes no sense")
    return value


class _Thrift:
    def __init__(self, stream: BytesIO) -> None:
        self._stream = stream

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """The struct that starts here."""
        if depth > DEEPEST_THRIFT:
            raise ValueError("its description is too deep")
        fields: dict[int, Any] = {}
        number = 0
        while head := self._bytes(1)[0]:
            number = number + (head >> 4) if head >> 4 else self._signed()
            kind = head & 15
            fields[number] = kind == TRUE if kind <= FALSE else self._value(kind, depth)
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (I16, I32, I64):
            return self._signed()
        if kind in (TRUE, FALSE, BYTE):
            return self._bytes(1)[0]
        if kind == DOUBLE:
            return self._bytes(8)
        if kind == BINARY:
            return self._bytes(self._unsigned())
        if kind in (LIST, SET):
            head = self._bytes(1)[0]
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
        value = 0
        for shift in range(0, 70, 7):
            byte = self._bytes(1)[0]
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("a number in its description is too long")

    def _bytes(self, count: int) -> bytes:
        return self._stream.read(self._fits(count))


DECODED_VALUES = 1 << 21  # values in pages that are decoded side by side
LONGEST_PAGE = DECODED_VALUES  # values of a page
MOST_PARQUET_COLUMNS = 1 << 16
LONGEST_LIST = 256  # elements of a row's list up to which they are columns
SEARCHED_ROWS = 1000  # rows in which the first list that is not empty is looked for


@dataclass(frozen=True)
class Element:
    """One element of the lists of a common length in a column, or the column where that is zero."""

    column: str
    number: int
    length: int

    @property
    def values(self) -> "polars.Expr":
        """Numbers, missing where a list has another length."""
        import polars as pl

        if not self.length:
            return pl.col(self.column).cast(pl.Float64, strict=False)
        lists = _as_lists(self.column)
        own = lists.list.get(self.number, null_on_oob=True)
        return pl.when(lists.list.len() == self.length).then(own)


@dataclass(frozen=True)
class ParquetLog:
    """A Parquet file, or the files of a folder one after the other; see `of_folder`.

    Only the requested row groups and columns are read.
    """

    path: Path
    columns: tuple[str, ...]
    files: tuple[Path, ...]
    elements: Mapping[str, Element] = field(default_factory=dict)  # columns that are one of a list
    left_out: tuple[tuple[str, str], ...] = ()  # columns that hold no numbers, with the reason

    @classmethod
    def open(cls, path: Path) -> "ParquetLog":
        """Read the names of the columns."""
        require_file(path)
        require_polars(path)
        with _polars_errors_as_log_errors(path, "the file cannot be read as Parquet"):
            _columns_at_once(path)
            lengths, left_out = _lengths_of_lists(path)
            columns: list[str] = []
            elements: dict[str, Element] = {}
            for name in _scan(path).collect_schema().names():
                length = lengths.get(name, 0)
                own = {f"{name}_{k + 1}": Element(name, k, length) for k in range(length)}
                columns += own or ([] if name in left_out else [name])
                elements |= own
            return cls(path, tuple(columns), (path,), elements, tuple(left_out.items()))

    def renamed(self, names: Mapping[str, str]) -> "ParquetLog":
        """The log with other names for some columns, without those named by an empty text."""
        sources = {c: self.elements.get(c, Element(c, 0, 0)) for c in self.columns}
        named = {names.get(c, c): source for c, source in sources.items() if names.get(c, c)}
        return replace(self, columns=tuple(named), elements=named)

    @classmethod
    def of_folder(cls, path: Path) -> "ParquetLog":
        """The files of a folder and of those in it, in the natural order of their names.

        `part-2.parquet` comes before `part-10.parquet`; names that start with `.` or `_` are passed
        over. All must have the same columns.
        """
        with reading(path):
            found = [p for p in path.rglob("*") if p.suffix.lower() == ".parquet" and p.is_file()]
        names = {p: p.relative_to(path).parts for p in found}
        named = [p for p in found if not any(part[0] in "._" for part in names[p])]
        if not named:
            raise LogError(
                "the folder holds no log",
                where=str(path),
                fix="name a log file, a folder of .parquet files, or the folder of a ROS 2 bag, "
                "which holds its metadata.yaml",
            )
        named.sort(key=lambda file: [natural(x) for x in (*names[file][:-1], file.stem)])
        logs = [cls.open(p) for p in named]
        first, *others = [log for log in logs if log.n_rows] or logs[:1]
        for other in others:
            absent = [f"no '{c}'" for c in first.columns if c not in other.columns]
            new = [f"also '{c}'" for c in other.columns if c not in first.columns]
            if absent or new:
                raise LogError(
                    "two files of the log have other columns: the second has "
                    f"{', '.join((*absent[:3], *new[:3]))}",
                    where=f"{first.path} and {other.path}",
                    fix="keep the files of one log in a folder of their own",
                )
        files = tuple(log.path for log in (first, *others))
        return replace(first, path=path, files=files)

    @property
    def n_rows(self) -> int:
        """Number of rows, as the files' ends say it."""
        return sum(map(_height, self.files))

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        require_columns(self.path, self.columns, columns)
        start, stop = rows
        for file in self.files:
            known = len(self.files) > 1 and (start > 0 or stop is not None)
            height = _height(file) if known else 0
            wanted = [self.elements.get(column, Element(column, 0, 0)) for column in columns]
            yield from _parts(file, wanted, start, stop, size)
            start = max(0, start - height)
            stop = None if stop is None else max(0, stop - height)
            if stop == 0:
                return


def _height(file: Path) -> int:
    stat = file.stat()
    return _height_at(file.resolve(), stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=1 << 14)
def _height_at(file: Path, changed: int, size: int) -> int:
    import polars as pl

    with _polars_errors_as_log_errors(file, "the file cannot be read as Parquet"):
        return int(_scan(file).select(pl.len()).collect().item())


def _parts(
    file: Path, columns: Sequence[Element], start: int, stop: int | None, size: int
) -> Iterator[Array]:
    lists = any(column.length for column in columns)
    numbers = [column.values.alias(str(k)) for k, column in enumerate(columns)]
    while stop is None or start < stop:
        length = size if stop is None else min(size, stop - start)
        with _polars_errors_as_log_errors(file, f"rows {start} to {start + length} cannot be read"):
            width = _columns_at_once(file, lists)
            tables = [
                _scan(file).select(numbers[at : at + width]).slice(start, length).collect()
                for at in range(0, len(numbers), width)
            ]
            part = tables[0].to_numpy() if len(tables) == 1 else np.hstack(tables)
        del tables
        height = len(part)
        if height:
            yield part
        del part
        if height < length:
            return
        start += length


def require_polars(path: Path) -> None:
    """Refuse a Parquet file without Polars."""
    require("polars", "polars", "Parquet files", str(path))


def _lengths_of_lists(path: Path) -> tuple[dict[str, int], dict[str, str]]:
    """Length of the lists in every column of lists of numbers, and why other columns are no use.

    It is that of the first list that is not empty.
    """
    import polars as pl

    lists, left_out = [], {}
    for name, kind in _scan(path).collect_schema().items():
        if isinstance(kind, pl.List | pl.Array):
            inner = kind.inner
            if isinstance(inner, pl.DataType) and (inner.is_numeric() or inner == pl.Boolean):
                lists.append(name)
            else:
                left_out[name] = f"its lists hold no numbers but {inner}"
        elif isinstance(kind, pl.Struct | pl.Object | pl.Binary):
            left_out[name] = f"it holds no numbers but {kind.base_type()}"
    if not lists:
        return {}, left_out
    _columns_at_once(path, True)
    longest = [_as_lists(name).list.len().alias(name) for name in lists]
    lengths = _scan(path).head(SEARCHED_ROWS).select(longest).collect()
    found = {name: next((n for n in lengths[name] if n), 0) for name in lists}
    left_out |= {
        name: f"its lists have {n} elements, where {LONGEST_LIST} are as many as are read"
        if n
        else f"its lists are empty in the first {SEARCHED_ROWS} rows"
        for name, n in found.items()
        if not 0 < n <= LONGEST_LIST
    }
    return {name: n for name, n in found.items() if name not in left_out}, left_out


def _as_lists(column: str) -> "polars.Expr":
    """Lists of any numbers, or arrays of a fixed length, as lists of floats."""
    import polars as pl

    return pl.col(column).cast(pl.List(pl.Float64), strict=False)


def _columns_at_once(path: Path, lists: bool = False) -> int:
    """How many columns can be read side by side: their pages are decoded whole."""
    stat = path.stat()
    values = longest_page(path.resolve(), stat.st_mtime_ns, stat.st_size, lists)
    if values > LONGEST_PAGE:
        raise ValueError(
            f"one of its pages holds {values} values, where {LONGEST_PAGE} are as many as are read"
        )
    ordinary = values <= ORDINARY_ROWS_OF_GROUP
    return MOST_PARQUET_COLUMNS if ordinary else DECODED_VALUES // values


@contextmanager
def _polars_errors_as_log_errors(path: Path, wrong: str) -> Iterator[None]:
    """Turn what Polars raises into our errors, its panics at broken files too."""
    from polars.exceptions import PanicException, PolarsError

    try:
        yield
    except (PolarsError, OSError, PanicException, MemoryError, OverflowError, ValueError) as error:
        said = str(error).strip().partition("\n")[0] or type(error).__name__
        raise LogError(
            f"{wrong} ({said})",
            where=str(path),
            fix="copy or convert it again; columns must hold one number a row, and a log in text "
            "form needs the suffix .csv",
        ) from error


def _scan(path: Path) -> "polars.LazyFrame":
    import polars as pl

    return pl.scan_parquet(path, glob=False, cache=False)


def natural(text: str) -> tuple[tuple[int, str], ...]:
    """A key by which "day 9" is before "day 10"."""
    pieces = re.split(r"(\d+)", text)
    return tuple((int(x), x) if k % 2 else (-1, x) for k, x in enumerate(pieces))
