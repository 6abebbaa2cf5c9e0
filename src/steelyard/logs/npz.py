"""NumPy's `.npz` and `.npy`, streamed; nothing in them is ever unpickled.

`np.load(mmap_mode="r", allow_pickle=False)` is not used for files of strangers: a bare `.npy` of 12
bytes makes it ask for 4 GB, and of an `.npz` it maps nothing but unpacks members whole (a gigabyte
of zeros from a megabyte).
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from io import BytesIO
from math import prod
from pathlib import Path
from typing import IO, Literal
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy

from steelyard.logs.log import require_file
from steelyard.logs.named_arrays import (
    ArraysLog,
    NamedArray,
    Packed,
    member_of,
    packed_log,
    read_errors_as_log_errors,
    record_fields,
)

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
