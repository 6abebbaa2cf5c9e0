"""NumPy's `.npz` and `.npy`, streamed; nothing in them is ever unpickled.

`np.load(mmap_mode="r", allow_pickle=False)` is not used for files of strangers: a bare `.npy` of 12
bytes makes it ask for 4 GB, and of an `.npz` it maps nothing but unpacks members whole (a gigabyte
of zeros from a megabyte).
"""

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import IO, Any, Literal
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from steelyard.logs.log import require_file
from steelyard.logs.named_arrays import (
    ArraysLog,
    NamedArray,
    Opener,
    Packed,
    is_real_number,
    packed_log,
    read_errors_as_log_errors,
    record_fields,
    record_labels,
)

MAGIC = b"\x93NUMPY"
LONGEST_HEADER = 1 << 16
Header = tuple[np.dtype[Any], tuple[int, ...], Literal["C", "F"]]
"""Kind of numbers, shape and order of an array."""
PICKLED = "it holds Python objects, which are never unpickled"


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
        header = _header(stream, path.stat().st_size)
        at = stream.tell()
    array = _packed("column", header, lambda offset: opened(at + offset))
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
    with archive.open(info) as stream:
        header = _header(stream, info.file_size)
        at = stream.tell()

    def opened(offset: int) -> IO[bytes]:
        with ZipFile(path) as fresh:
            stream = fresh.open(info.filename)
        stream.seek(at + offset)
        return stream

    return _packed(name, header, opened)


def _packed(name: str, header: Header, opened: Opener) -> Packed | NamedArray:
    dtype, shape, order = header
    fields = record_fields(dtype)
    if dtype.hasobject:
        return NamedArray(name, (), left_out=PICKLED)
    if dtype.names:
        if len(shape) != 1 or not fields:
            return NamedArray(name, (), left_out="it is no list of records of numbers")
        member = NamedArray(name, shape, record_labels(fields))
        return Packed(member, dtype, order, opened, fields)
    if not is_real_number(dtype):
        return NamedArray(name, (), left_out=f"it holds no real numbers but {dtype}")
    if len(shape) > 2:
        return NamedArray(name, (), left_out=f"it has {len(shape)} axes")
    return Packed(NamedArray(name, shape), dtype, order, opened)


def _header(stream: IO[bytes], size: int) -> Header:
    """What is written before an array's numbers, checked against the bytes there are."""
    start = stream.read(8)
    if len(start) != 8 or not start.startswith(MAGIC) or start[6] not in (1, 2, 3):
        raise ValueError("it is not an array of NumPy")
    width = 2 if start[6] == 1 else 4
    length = int.from_bytes(stream.read(width), "little")
    if length > LONGEST_HEADER:
        raise ValueError(f"the header of an array is {length} bytes long")
    text = stream.read(length).decode("utf-8" if start[6] == 3 else "latin-1")
    dtype, shape, order = _parsed(text)
    if prod(shape) * dtype.itemsize > size - 8 - width - length:
        raise ValueError("an array is declared larger than the file")
    return dtype, shape, order


def _parsed(text: str) -> Header:
    try:
        header = ast.literal_eval(text.strip())
        dtype = np.lib.format.descr_to_dtype(header["descr"])
        shape, fortran = header["shape"], header["fortran_order"]
    except (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError,
            SyntaxError, TypeError, ValueError) as error:  # fmt: skip
        raise ValueError(f"the header of an array cannot be read: {text[:60]!r}") from error
    whole = isinstance(shape, tuple) and all(type(k) is int and k >= 0 for k in shape)
    if not whole or dtype.itemsize == 0:
        raise ValueError(f"the header of an array makes no sense: {text[:60]!r}")
    return dtype, shape, "F" if fortran else "C"


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
