"""HDF5, read by a process of its own, and MATLAB's `.mat` files of versions 5 and 7.3.

The layout is that of MathWorks' "MAT-File Format", chapter 1. `scipy.io.loadmat` is not used for
files of strangers: structs within 20 000 structs crash it (and the program with it), 184 bytes that
announce a cell array of 2e8 cells take it 1.5 GiB, and it holds whole matrices in memory.
"""

import io
import json
import subprocess
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from math import prod
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.base.progress import module_command
from steelyard.logs.log_and_errors import require_file
from steelyard.logs.named_arrays_and_numpy_files import (
    ArraysLog,
    ColumnPlace,
    NamedArray,
    Packed,
    packed_log,
    read_errors_as_log_errors,
    skip,
)

CHILD = module_command("steelyard.logs.hdf5_reading_process")


def open_hdf5(path: Path, *, matlab: bool = False) -> ArraysLog:
    """The datasets of all groups as a table; they are called by their paths, such as `run/q`."""
    require_file(path)
    stat = path.stat()
    members = _hdf5_members(path.resolve(), matlab, stat.st_mtime_ns, stat.st_size)

    def read(places: Sequence[ColumnPlace], rows: tuple[int, int], size: int) -> Iterator[Array]:
        separator = "." if matlab else "/"
        columns = [
            [members[p.member].name.replace(separator, "/"), p.axis, p.component] for p in places
        ]
        request = {"path": str(path), "rows": rows, "size": size, "columns": columns}
        with _child_answer(path, request) as answer:
            for start in range(*rows, size):
                count = min(size, rows[1] - start) * len(places)
                data = answer.read(8 * count)
                if len(data) < 8 * count:
                    raise EOFError
                yield np.frombuffer(data, np.float64).reshape(-1, len(places)).copy()

    return ArraysLog.of(path, members, read)


@lru_cache(maxsize=64)
def _hdf5_members(path: Path, matlab: bool, changed: int, size: int) -> tuple[NamedArray, ...]:
    """What is in a file as it was at a time."""
    with _child_answer(path, {"path": str(path), "matlab": matlab}) as answer:
        text = answer.read()
    found = json.loads(text)
    return tuple(
        NamedArray(x["name"], tuple(x["shape"]), tuple(x["labels"]), x["left_out"]) for x in found
    )


@contextmanager
def _child_answer(path: Path, request: dict[str, Any]) -> Iterator[IO[bytes]]:
    pipe = subprocess.PIPE
    child = subprocess.Popen(CHILD, stdin=pipe, stdout=pipe, stderr=pipe)
    try:
        assert child.stdin and child.stdout and child.stderr
        child.stdin.write(json.dumps(request).encode())
        child.stdin.close()
        with suppress(EOFError):
            yield child.stdout
            if child.stdout.read(1) == b"" and child.wait() == 0:
                return
        lines = child.stderr.read().decode("utf-8", "replace").strip().splitlines()
        said = lines and child.wait() == 1
        raise LogError(
            f"the file cannot be read as HDF5 "
            f"({lines[-1][:300] if said else 'the HDF5 library crashed on it'})",
            where=str(path),
            fix="copy it again, or save it anew with the program that wrote it",
        )
    finally:
        child.kill()
        for stream in (child.stdout, child.stderr):
            if stream is not None:
                stream.close()
        child.wait()


MAT5_HEADER = 128
LONGEST_TEXT = 1 << 20
DEEPEST_STRUCT = 16
MOST_STRUCTS_OF_ARRAY = 1000  # structs of one array of structs
MATRIX, COMPRESSED = 14, 15
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
           13: "u8"}  # fmt: skip
INTEGER = np.dtype("i4")
STRUCT, OPAQUE = 2, 17
LEFT_OUT = {
    1: "it is a cell array",
    3: "it is an object of a class",
    4: "it is text",
    5: "it is a sparse matrix",
    16: "it is a function",
    OPAQUE: "it is an object of a class, such as a table or a timeseries",
}
"""By the class of a variable; other classes are of numbers."""

ORDERS: dict[bytes, Literal["little", "big"]] = {b"IM": "little", b"MI": "big"}
"""Order of bytes by what the header ends with."""


def open_mat(path: Path) -> ArraysLog:
    """The matrices of a file as a table; a struct's field is called `data.q`."""
    require_file(path)
    with path.open("rb") as file:
        header = file.read(MAT5_HEADER)
    if header[124:] in (b"\x00\x02IM", b"\x02\x00MI"):
        return open_hdf5(path, matlab=True)
    if header[126:] not in ORDERS:
        raise LogError(
            "the file is no MATLAB file of version 5 or later",
            where=str(path),
            fix="save it in MATLAB with save(..., '-v7') or '-v7.3'",
        )
    with read_errors_as_log_errors(path):
        arrays = list(_mat5_arrays(path, ORDERS[header[126:]]))
    return packed_log(path, arrays)


def _mat5_arrays(path: Path, order: Literal["little", "big"]) -> Iterator[Packed | NamedArray]:
    """The numeric matrices of a file, those in structs too, and what else is in it."""
    at, size = MAT5_HEADER, path.stat().st_size
    while at + 8 <= size:
        with path.open("rb") as file:
            file.seek(at)
            kind, length = (int.from_bytes(file.read(4), order) for _ in range(2))
        if kind not in (MATRIX, COMPRESSED) or at + 8 + length > size:
            raise ValueError(f"byte {at} starts no variable, or the file ends before it does")
        opened = partial(_opened, path, at, None if kind == MATRIX else length)
        with opened(0) as stream:
            yield from _Scanner(stream, order, opened).matrix("", 0)
        at += 8 + length


def _opened(path: Path, at: int, packed: int | None, offset: int) -> IO[bytes]:
    """The variable that starts at a byte, of so many packed bytes, from an offset on."""
    file = path.open("rb")
    if packed is None:
        file.seek(at + offset)
        return file
    file.seek(at + 8)
    stream = io.BufferedReader(Inflated(file, packed), 1 << 16)
    skip(stream, offset)
    return stream


class Inflated(io.RawIOBase):
    """The bytes that a compressed stretch of a file stands for."""

    def __init__(self, file: IO[bytes], length: int) -> None:
        self._file, self._left = file, length
        self._inflate = zlib.decompressobj()

    def readable(self) -> bool:  # noqa: D102
        return True

    def readinto(self, buffer: "memoryview | bytearray") -> int:  # type: ignore[override]
        """Fill the buffer as far as the next bytes reach; 0 at the end."""
        given, data = b"-", b""
        while given and not data and not self._inflate.eof:
            given = self._inflate.unconsumed_tail
            if not given:
                given = self._file.read(min(1 << 14, self._left))
                self._left -= len(given)
            data = self._inflate.decompress(given, len(buffer))
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        """Close the file below too."""
        self._file.close()
        super().close()


@dataclass
class _Scanner:
    """Reads the headers of one variable, and passes over its numbers."""

    stream: IO[bytes]
    order: Literal["little", "big"]
    opened: Callable[[int], IO[bytes]]
    at: int = 0

    def matrix(self, name: str, depth: int) -> Iterator[Packed | NamedArray]:
        """The arrays in the matrix that starts here; it has a name of its own at depth 0."""
        kind, length, inline = self._tag()
        if kind != MATRIX or inline:
            raise ValueError(f"byte {self.at} of a variable starts no matrix")
        end = self.at + length
        if length > 0:
            flags = self._integers()
            if not flags:
                raise ValueError("a variable has no class")
            klass = flags[0] & 0xFF
            shape = () if klass == OPAQUE else tuple(self._integers())
            own = self._short().split(b"\0")[0].decode("latin-1")
            name = own if own and depth == 0 else name
            if name:
                yield from self._content(name, klass, bool(flags[0] & 0x800), shape, depth)
        if end < self.at:
            raise ValueError("a variable is longer than declared")
        self._pass_over(end - self.at)

    def _content(
        self, name: str, klass: int, is_complex: bool, shape: tuple[int, ...], depth: int
    ) -> Iterator[Packed | NamedArray]:
        why = LEFT_OUT.get(klass, "")
        if klass == STRUCT and depth == DEEPEST_STRUCT:
            why = f"it lies more than {DEEPEST_STRUCT} structs deep"
        elif klass == STRUCT and not 0 <= prod(shape) <= MOST_STRUCTS_OF_ARRAY:
            why = f"it is one of more than {MOST_STRUCTS_OF_ARRAY} structs"
        elif klass != STRUCT and is_complex:
            why = why or "it holds complex numbers"
        if why:
            yield NamedArray(name, (), left_out=why)
        elif klass == STRUCT:
            yield from self._structs(name, prod(shape), depth)
        else:
            yield self._numbers(name, shape)

    def _structs(self, name: str, count: int, depth: int) -> Iterator[Packed | NamedArray]:
        width = (self._integers() or [0])[0]
        text = self._short()
        if width <= 0 or len(text) % width:
            raise ValueError(f"the names of the fields of '{name}' cannot be read")
        cells = [text[at : at + width] for at in range(0, len(text), width)]
        fields = [cell.split(b"\0")[0].decode("latin-1") for cell in cells]
        for number in range(1, count + 1):
            element = name if count == 1 else f"{name}({number})"
            for field in fields:
                yield from self.matrix(f"{element}.{field}", depth + 1)

    def _numbers(self, name: str, shape: tuple[int, ...]) -> Packed | NamedArray:
        kind, length, inline = self._tag()
        at = self.at - (4 if inline else 0)
        if kind not in NUMBERS or min(shape, default=-1) < 0:
            raise ValueError(f"'{name}' holds numbers of no known kind")
        dtype = np.dtype(NUMBERS[kind]).newbyteorder(self.order)
        if prod(shape) * dtype.itemsize != length:
            raise ValueError(f"'{name}' has a wrong declared size")
        if len(shape) != 2:
            return NamedArray(name, (), left_out=f"it has {len(shape)} axes")
        one = NamedArray(name, () if shape == (1, 1) else shape)
        return Packed(one, dtype, "F", lambda offset: self.opened(at + offset))

    def _tag(self) -> tuple[int, int, bytes]:
        """Kind and length of an element, and its content if that is in the tag."""
        word = int.from_bytes(self._taken(4), self.order)
        more = self._taken(4)
        length = word >> 16
        if length > 4:
            raise ValueError(f"byte {self.at} of a variable starts no element")
        if length:
            return word & 0xFFFF, length, more[:length]
        return word, int.from_bytes(more, self.order), b""

    def _short(self) -> bytes:
        _, length, inline = self._tag()
        if inline or length == 0:
            return inline
        if length > LONGEST_TEXT:
            raise ValueError(f"a name or a size is declared to be {length} bytes long")
        content = self._taken(length)
        self._pass_over(-length % 8)
        return content

    def _integers(self) -> list[int]:
        found: list[int] = np.frombuffer(self._short(), INTEGER.newbyteorder(self.order)).tolist()
        return found

    def _taken(self, count: int) -> bytes:
        data = self.stream.read(count)
        if len(data) != count:
            raise EOFError("a variable ends too early")
        self.at += count
        return data

    def _pass_over(self, count: int) -> None:
        skip(self.stream, count)
        self.at += count
