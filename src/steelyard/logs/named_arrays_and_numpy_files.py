"""Files of named arrays as one table; NumPy's `.npz` and `.npy`, of which nothing is unpickled.

`np.load(mmap_mode="r", allow_pickle=False)` is not used for files of strangers: a bare `.npy` of 12
bytes makes it ask for 4 GB, and of an `.npz` it maps nothing but unpacks members whole (a gigabyte
of zeros from a megabyte).
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import chain
from math import prod
from pathlib import Path
from struct import error as StructError
from typing import IO, Any, Literal
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo
from zlib import error as ZlibError

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import ROWS_OF_PART, RowRange, require_columns, require_file

MOST_COLUMNS_OF_ARRAY = 4096  # columns that one array may have
LEAST_ROWS = 2
BYTES_OF_PART = 1 << 23  # bytes of a part, about
BYTES_SKIPPED_AT_ONCE = 1 << 16


@dataclass(frozen=True)
class NamedArray:
    """An array of numbers of one axis or two in a file, with the path to it in its name.

    `labels` name the columns of an array of records; `left_out` says why it is no part of any
    table, if it is none.
    """

    name: str
    shape: tuple[int, ...]
    labels: tuple[str, ...] = ()
    left_out: str = ""

    def width(self, axis: int) -> int:
        """Number of columns if the rows lie along `axis`."""
        if self.labels:
            return len(self.labels)
        return self.shape[1 - axis] if len(self.shape) == 2 else 1

    def columns(self, axis: int) -> tuple[str, ...]:
        """`q` alone, or `q_1` to `q_k`."""
        width = self.width(axis)
        if self.labels or width == 1:
            return self.labels or (self.name,)
        return tuple(f"{self.name}_{number}" for number in range(1, width + 1))


@dataclass(frozen=True)
class ColumnPlace:
    """Where a column is: a component of an array, which goes by its number or its name."""

    member: Any
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
            axis = member.shape.index(n_rows) if n_rows in member.shape else None
            if member.left_out or axis is None or n_rows < LEAST_ROWS:
                size = " x ".join(map(str, member.shape))
                other = f"its size is {size}, where the table has {n_rows} rows"
                why = member.left_out or (other if size else "one number")
                left_out.append((member.name, why))
            elif not 0 < member.width(axis) <= MOST_COLUMNS_OF_ARRAY:
                most = f"more than {MOST_COLUMNS_OF_ARRAY} columns"
                left_out.append((member.name, most if member.width(axis) else "no columns"))
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
        for name, why in self.left_out:
            if name in columns and name not in self.columns:
                raise LogError(
                    f"'{name}' is no column of the table: {why}",
                    where=str(self.path),
                    fix=f"its columns are {', '.join(self.columns[:8])}"
                    f"{', ...' if len(self.columns) > 8 else ''}",
                )
        require_columns(self.path, self.columns, columns)
        wanted = [self.places[self.columns.index(column)] for column in columns]
        start, stop = rows[0], self.n_rows if rows[1] is None else min(rows[1], self.n_rows)
        used = {(place.member, place.axis) for place in wanted}
        row = 8 * (len(wanted) + sum((p.member, p.axis) in used for p in self.places))
        if start < stop and wanted:
            yield from self.read(wanted, (start, stop), max(1, min(size, BYTES_OF_PART // row)))


def _common_length(members: Sequence[NamedArray]) -> int:
    """The length that most numbers share, along the longer axis of each array."""
    votes: Counter[int] = Counter()
    for member in members:
        if member.shape and not member.left_out:
            longest = max(member.shape)
            width = member.width(member.shape.index(longest))
            votes[longest] += longest * min(width, MOST_COLUMNS_OF_ARRAY)
    return max(votes, key=lambda length: (votes[length], length), default=0)


RecordFields = tuple[tuple[str, int | None], ...]
"""Field of a record, and index in it, of each column; empty for plain numbers."""


def record_fields(dtype: np.dtype[Any]) -> RecordFields:
    """Fields of a record that hold real numbers, one entry per number."""
    found: list[tuple[str, int | None]] = []
    for name in dtype.names or ():
        base, shape = dtype[name].base, dtype[name].shape
        if _is_real_number(base) and len(found) + prod(shape) <= MOST_COLUMNS_OF_ARRAY:
            found += [(name, k) for k in range(prod(shape))] if shape else [(name, None)]
    return tuple(found)


def member_of(
    name: str, dtype: np.dtype[Any], shape: tuple[int, ...], prefix: str = ""
) -> NamedArray:
    """An array as a member of a table, labels of records behind a prefix: `t`, `q_1`, `q_2`."""
    fields, why = record_fields(dtype), ""
    if dtype.names:
        why = "" if fields and len(shape) == 1 else "it is no list of records of numbers"
    elif not _is_real_number(dtype):
        why = "it holds no real numbers" + f" but {dtype}" * (not dtype.hasobject)
    elif len(shape) > 2:
        why = f"it has {len(shape)} axes"
    if why:
        return NamedArray(name, (), left_out=why)
    labels = (field if k is None else f"{field}_{k + 1}" for field, k in fields)
    return NamedArray(name, shape, tuple(f"{prefix}{label}" for label in labels))


def _is_real_number(dtype: np.dtype[Any]) -> bool:
    return dtype.kind in "biuf"


def picked(block: NDArray[Any], components: Sequence[int], fields: RecordFields) -> Array:
    """Components of rows `(N, k)`, or of records `(N,)`, as floats `(N, len(components))`."""
    if not fields:
        return block[:, components].astype(np.float64)
    found = np.empty((len(block), len(components)))
    for column, (name, k) in enumerate(fields[component] for component in components):
        found[:, column] = block[name] if k is None else block[name].reshape(len(block), -1)[:, k]
    return found


def joined(
    places: Sequence[ColumnPlace],
    rows: tuple[int, int],
    size: int,
    slabs: Callable[[Any, int, list[int]], Iterator[Array]],
) -> Iterator[Array]:
    """Columns at places, side by side: `slabs` reads components of one member along an axis."""
    members = by_key(((place.member, place.axis), k) for k, place in enumerate(places))
    each = [
        (columns, slabs(member, axis, [places[column].component for column in columns]))
        for (member, axis), columns in members.items()
    ]
    for start in range(*rows, size):
        table = np.empty((min(size, rows[1] - start), len(places)))
        for columns, slab in each:
            table[:, columns] = next(slab)
        yield table


@dataclass(frozen=True, eq=False)
class Packed:
    """Where the numbers of an array are."""

    member: NamedArray  # its name and shape
    dtype: np.dtype[Any]  # of one number, or of one record if the member has labels
    order: Literal["C", "F"]  # `C`: a row's numbers lie together; `F`: a column's
    open: Callable[[int], IO[bytes]]  # opens the array's stream, from a byte of the array on
    fields: RecordFields = ()  # of a record

    def slabs(
        self, axis: int, components: Sequence[int], rows: tuple[int, int], size: int
    ) -> Iterator[Array]:
        """Components of the array, in arrays `(at most size, len(components))`."""
        width = 1 if self.fields else self.member.width(axis)
        starts = [rows[0] * width]
        if width > 1 and (axis == 0) != (self.order == "C"):  # a stream per column
            starts, width = [c * self.member.shape[axis] + rows[0] for c in components], 1
            components = range(len(components))
        with ExitStack() as stack:
            item = self.dtype.itemsize
            streams = [stack.enter_context(self.open(start * item)) for start in starts]
            for start in range(*rows, size):
                count = min(size, rows[1] - start) * width
                found = [np.frombuffer(_exactly(s, count * item), self.dtype) for s in streams]
                if self.fields:
                    yield picked(found[0], components, self.fields)
                else:
                    blocks = [block.reshape(-1, width) for block in found]
                    yield picked(np.concatenate(blocks, axis=1), components, ())


def packed_log(path: Path, arrays: Sequence[Packed | NamedArray]) -> ArraysLog:
    """The table made of packed arrays, and of members that are left out."""

    def read(places: Sequence[ColumnPlace], rows: tuple[int, int], size: int) -> Iterator[Array]:
        def slabs(number: int, axis: int, components: list[int]) -> Iterator[Array]:
            array = arrays[number]
            assert isinstance(array, Packed)
            return array.slabs(axis, components, rows, size)

        with read_errors_as_log_errors(path):
            yield from joined(places, rows, size, slabs)

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


LONGEST_HEADER, LONGEST_REASON = 1 << 16, 100
"""Bytes of a header, and letters of what is wrong with it, which may repeat all of it."""


def open_npz(path: Path) -> ArraysLog:
    """The arrays of an archive as a table."""
    require_file(path)
    arrays: list[Packed | NamedArray] = []
    with read_errors_as_log_errors(path), ZipFile(path) as archive:
        for info in archive.infolist():
            if info.filename.endswith(".npy"):
                arrays.append(_of_archive(path, archive, info))
    return packed_log(path, list(_disambiguated(arrays)))


def open_npy(path: Path) -> ArraysLog:
    """One array as a table: its columns are `column_1` to `column_k`, or its fields."""
    require_file(path)

    def opened(offset: int) -> IO[bytes]:
        stream = path.open("rb")
        stream.seek(offset)
        return stream

    with read_errors_as_log_errors(path), path.open("rb") as stream:
        array = _packed("column", stream, path.stat().st_size, opened)
    if isinstance(array, Packed) and not array.fields:
        single = len(array.member.shape) == 1 or 1 in array.member.shape
        named = replace(array.member, name="column_1" if single else "column")
        array = replace(array, member=named)
    return packed_log(path, [array])


def _of_archive(path: Path, archive: ZipFile, info: ZipInfo) -> Packed | NamedArray:
    name = info.filename.removesuffix(".npy")
    if info.flag_bits & 1:
        return NamedArray(name, (), left_out="it is encrypted")
    if info.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
        return NamedArray(name, (), left_out="its compression is not one that NumPy writes")

    def opened(offset: int) -> IO[bytes]:
        with ZipFile(path) as fresh:
            stream = fresh.open(info.filename)
        stream.seek(offset)
        return stream

    with archive.open(info) as stream:
        return _packed(name, stream, info.file_size, opened)


def _packed(
    name: str, stream: IO[bytes], size: int, opened: Callable[[int], IO[bytes]]
) -> Packed | NamedArray:
    """The array that a stream of so many bytes starts with."""
    at, dtype, shape, order = _header(stream, size)
    if dtype.hasobject:
        return NamedArray(name, (), left_out="it holds Python objects, which are never unpickled")
    member = member_of(name, dtype, shape)
    if member.left_out:
        return member
    return Packed(member, dtype, order, lambda offset: opened(at + offset), record_fields(dtype))


def _header(
    stream: IO[bytes], size: int
) -> tuple[int, np.dtype[np.generic], tuple[int, ...], Literal["C", "F"]]:
    """Its length, and the numbers' kind, shape and order, checked against the bytes there are."""
    try:
        version = npy.read_magic(stream)
        width = {(1, 0): 2, (2, 0): 4, (3, 0): 4}[version]
        length = int.from_bytes(stream.read(width), "little")
        if length > LONGEST_HEADER:
            raise ValueError(f"it is {length} bytes long")
        text = stream.read(length)  # and nothing of the numbers, which may be damaged
        if version == (3, 0):  # version 2.0 with names in UTF-8
            text = text.decode().encode("latin-1", "backslashreplace")
        read = npy.read_array_header_1_0 if width == 2 else npy.read_array_header_2_0
        shape, fortran, dtype = read(BytesIO(len(text).to_bytes(width, "little") + text), size)
    except Exception as error:  # foreign code on foreign text
        why = str(error)[:LONGEST_REASON]
        raise ValueError(f"the header of an array cannot be read: {why}") from error
    at = npy.MAGIC_LEN + width + length
    if min(shape, default=0) < 0 or dtype.itemsize == 0:
        raise ValueError(f"the header of an array makes no sense: {shape} of {dtype}")
    if prod(shape) * dtype.itemsize > size - at:
        raise ValueError("an array is declared larger than the file")
    return at, dtype, shape, "F" if fortran else "C"


def _disambiguated(arrays: list[Packed | NamedArray]) -> Iterator[Packed | NamedArray]:
    """Fields that several arrays have go by the array's name too."""
    labels = Counter(
        label for a in arrays if isinstance(a, Packed) for label in set(a.member.labels)
    )
    for array in arrays:
        if isinstance(array, Packed) and array.member.labels:
            own = tuple(f"{array.member.name}/{n}" if labels[n] > 1 else n
                        for n in array.member.labels)  # fmt: skip
            array = replace(array, member=replace(array.member, labels=own))
        yield array
