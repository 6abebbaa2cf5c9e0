"""Files of named arrays as one table: which arrays are its columns, and how they are read."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain
from math import prod
from pathlib import Path
from struct import error as StructError
from typing import IO, Any, Literal
from zipfile import BadZipFile
from zlib import error as ZlibError

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.logs.log import ROWS_OF_PART, RowRange, require_columns

MOST_COLUMNS_OF_ARRAY = 4096
"""Columns that one array may have."""

LEAST_ROWS = 2

BYTES_OF_PART = 1 << 23
"""Bytes of a part, about."""


@dataclass(frozen=True)
class NamedArray:
    """An array of numbers of one axis or two in a file, with the path to it in its name.

    Attributes:
        labels: Names of its columns, if it knows them; it has one axis then.
        left_out: Why it is no part of any table; empty if it may be.
    """

    name: str
    shape: tuple[int, ...]
    labels: tuple[str, ...] = ()
    left_out: str = ""

    def axis(self, rows: int) -> int | None:
        """Which axis has that many rows; `None` if none has."""
        return next((axis for axis, length in enumerate(self.shape) if length == rows), None)

    def width(self, axis: int) -> int:
        """Number of columns if the rows lie along `axis`."""
        if self.labels:
            return len(self.labels)
        return self.shape[1 - axis] if len(self.shape) == 2 else 1

    def columns(self, axis: int) -> tuple[str, ...]:
        """`q` alone, or `q_1` to `q_k`."""
        if self.labels:
            return self.labels
        width = self.width(axis)
        if width == 1:
            return (self.name,)
        return tuple(f"{self.name}_{number}" for number in range(1, width + 1))


@dataclass(frozen=True)
class ColumnPlace:
    """Where a column is: a component of an array."""

    member: int
    axis: int
    component: int


Reader = Callable[[Sequence[ColumnPlace], tuple[int, int], int], Iterator[Array]]
"""Reads components of a file's arrays side by side: rows from the first to before the second, in
arrays `(at most size, len(places))`."""


@dataclass(frozen=True)
class ArraysLog:
    """Arrays of one length as a table.

    A vector `t` is the column `t`; a matrix `q` of k columns, or of k rows, is `q_1` to `q_k`. The
    length that most numbers have in common is that of the table. Arrays of other lengths, and what
    is not made of real numbers, are left out.
    """

    path: Path
    columns: tuple[str, ...]
    places: tuple[ColumnPlace, ...]
    n_rows: int
    left_out: tuple[tuple[str, str], ...]
    read: Reader

    @classmethod
    def of(cls, path: Path, members: Sequence[NamedArray], read: Reader) -> "ArraysLog":
        """The table in a file."""
        n_rows = _common_length(members)
        columns: list[tuple[str, ...]] = []
        places: list[tuple[ColumnPlace, ...]] = []
        left_out = []
        for number, member in enumerate(members):
            axis = None if member.left_out else member.axis(n_rows)
            if axis is None or n_rows < LEAST_ROWS:
                size = " x ".join(map(str, member.shape))
                other = f"its size is {size}, where the table has {n_rows} rows"
                why = member.left_out or (other if size else "one number")
                left_out.append((member.name, why))
            elif member.width(axis) > MOST_COLUMNS_OF_ARRAY:
                left_out.append((member.name, f"more than {MOST_COLUMNS_OF_ARRAY} columns"))
            else:
                columns.append(member.columns(axis))
                width = range(len(columns[-1]))
                places.append(tuple(ColumnPlace(number, axis, component) for component in width))
        if not columns:
            found = "; ".join(f"'{name}': {why}" for name, why in left_out[:4])
            raise LogError(
                f"the file holds no table of numbers{f' ({found})' if found else ''}",
                where=str(path),
                fix="store time and the joints' signals as arrays with one row per sample, such "
                "as t (N), q (N x joints), tau (N x joints)",
            )
        names, where = tuple(chain(*columns)), tuple(chain(*places))
        return cls(path, names, where, n_rows, tuple(left_out), read)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        for column in columns:
            self._require(column)
        require_columns(self.path, self.columns, columns)
        wanted = [self.places[self.columns.index(column)] for column in columns]
        start, stop = rows[0], self.n_rows if rows[1] is None else min(rows[1], self.n_rows)
        widths = Counter((place.member, place.axis) for place in self.places)
        used = {(place.member, place.axis) for place in wanted}
        row = 8 * (len(wanted) + sum(widths[key] for key in used))
        if start < stop:
            yield from self.read(wanted, (start, stop), max(1, min(size, BYTES_OF_PART // row)))

    def _require(self, column: str) -> None:
        for name, why in self.left_out:
            if column == name and column not in self.columns:
                raise LogError(
                    f"'{name}' is no column of the table: {why}",
                    where=str(self.path),
                    fix=f"its columns are {', '.join(self.columns[:8])}"
                    f"{', ...' if len(self.columns) > 8 else ''}",
                )


def _common_length(members: Sequence[NamedArray]) -> int:
    """The length that most numbers share, along the longer axis of each array."""
    votes: Counter[int] = Counter()
    for member in members:
        if member.shape and not member.left_out:
            axis = max(range(len(member.shape)), key=lambda a: member.shape[a])
            votes[member.shape[axis]] += member.shape[axis] * min(
                member.width(axis), MOST_COLUMNS_OF_ARRAY
            )
    return max(votes, key=lambda length: (votes[length], length), default=0)


Opener = Callable[[int], IO[bytes]]
"""The array's stream, from a byte of the array on."""

BYTES_SKIPPED_AT_ONCE = 1 << 16


@dataclass(frozen=True, eq=False)
class Packed:
    """Where the numbers of an array are.

    Attributes:
        member: Its name and shape.
        dtype: Of one number, or of one record if the member has labels.
        order: `C`: a row's numbers lie together; `F`: a column's.
        open: Opens its stream.
        fields: Field and index in it of each label.
    """

    member: NamedArray
    dtype: np.dtype[Any]
    order: Literal["C", "F"]
    open: Opener
    fields: tuple[tuple[str, int | None], ...] = ()

    def slabs(
        self, axis: int, components: Sequence[int], rows: tuple[int, int], size: int
    ) -> Iterator[Array]:
        """Components of the array, in arrays `(at most size, len(components))`."""
        shape, item = self.member.shape, self.dtype.itemsize
        length, width = shape[axis], 1 if self.fields else self.member.width(axis)
        together = width == 1 or (axis == 0) == (self.order == "C")
        with ExitStack() as stack:
            if together:
                starts = [rows[0] * width]
            else:
                starts, width = [c * length + rows[0] for c in components], 1
            streams = [stack.enter_context(self.open(start * item)) for start in starts]
            for n in _steps(rows, size):
                blocks = [
                    np.frombuffer(_exactly(s, n * width * item), self.dtype).reshape(n, width)
                    for s in streams
                ]
                if together:
                    yield self._picked(blocks[0], components)
                else:
                    yield np.concatenate(blocks, axis=1).astype(np.float64)

    def _picked(self, block: NDArray[Any], components: Sequence[int]) -> Array:
        if not self.fields:
            return block[:, components].astype(np.float64)
        records = block[:, 0]
        fields = [self.fields[component] for component in components]
        picked = [records[f] if k is None else records[f].reshape(len(block), -1)[:, k]
                  for f, k in fields]  # fmt: skip
        return np.stack([column.astype(np.float64) for column in picked], axis=1)


def record_fields(dtype: np.dtype[Any]) -> tuple[tuple[str, int | None], ...]:
    """Fields of a record that hold real numbers, one entry per number."""
    found: list[tuple[str, int | None]] = []
    for name in dtype.names or ():
        base, shape = dtype[name].base, dtype[name].shape
        if is_real_number(base) and len(found) + prod(shape) <= MOST_COLUMNS_OF_ARRAY:
            found += [(name, k) for k in range(prod(shape))] if shape else [(name, None)]
    return tuple(found)


def record_labels(fields: Sequence[tuple[str, int | None]]) -> tuple[str, ...]:
    """Names of a record's numbers: `t`, `q_1`, `q_2`."""
    return tuple(name if k is None else f"{name}_{k + 1}" for name, k in fields)


def is_real_number(dtype: np.dtype[Any]) -> bool:
    """Whether a kind of number is real."""
    return dtype.kind in "biuf"


def packed_log(path: Path, arrays: Sequence[Packed | NamedArray]) -> ArraysLog:
    """The table made of packed arrays, and of members that are left out."""

    def read(places: Sequence[ColumnPlace], rows: tuple[int, int], size: int) -> Iterator[Array]:
        members: dict[tuple[int, int], list[int]] = {}
        for column, place in enumerate(places):
            members.setdefault((place.member, place.axis), []).append(column)
        slabs = []
        for (number, axis), columns in members.items():
            packed = arrays[number]
            if isinstance(packed, Packed):
                wanted = [places[column].component for column in columns]
                slabs.append((columns, packed.slabs(axis, wanted, rows, size)))
        with read_errors_as_log_errors(path):
            for n in _steps(rows, size):
                table = np.empty((n, len(places)))
                for columns, slab in slabs:
                    table[:, columns] = next(slab)
                yield table

    members = [a.member if isinstance(a, Packed) else a for a in arrays]
    return ArraysLog.of(path, members, read)


@contextmanager
def read_errors_as_log_errors(path: Path) -> Iterator[None]:
    """Turn what a broken file can raise into one clear error."""
    broken = (OSError, EOFError, ValueError, KeyError, RuntimeError, OverflowError)
    try:
        yield
    except (*broken, BadZipFile, ZlibError, StructError, RecursionError, MemoryError) as error:
        text = str(error).strip().splitlines()
        raise LogError(
            f"the file is broken or cut off ({text[0] if text else type(error).__name__})",
            where=str(path),
            fix="copy it again, or save it anew with the program that wrote it",
        ) from error


def skip(stream: IO[bytes], count: int) -> None:
    """Read `count` bytes and forget them."""
    while count > 0:
        count -= len(_exactly(stream, min(count, BYTES_SKIPPED_AT_ONCE)))


def _exactly(stream: IO[bytes], count: int) -> bytes:
    data = stream.read(count)
    if len(data) != count:
        raise EOFError("it ends before its arrays do")
    return data


def _steps(rows: tuple[int, int], size: int) -> Iterator[int]:
    for start in range(*rows, size):
        yield min(size, rows[1] - start)
