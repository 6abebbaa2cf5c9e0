"""Arrays that lie in a file without gaps, perhaps compressed, read from front to back."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import prod
from pathlib import Path
from struct import error as StructError
from typing import IO, Any, Literal
from zipfile import BadZipFile
from zlib import error as ZlibError

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.arrays.arrays_log import WIDEST, ArraysLog, Member, Place

Opener = Callable[[int], IO[bytes]]
"""The array's stream, from a byte of the array on."""

SKIP = 1 << 16


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

    member: Member
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
        if real(base) and len(found) + prod(shape) <= WIDEST:
            found += [(name, k) for k in range(prod(shape))] if shape else [(name, None)]
    return tuple(found)


def record_labels(fields: Sequence[tuple[str, int | None]]) -> tuple[str, ...]:
    """Names of a record's numbers: `t`, `q_1`, `q_2`."""
    return tuple(name if k is None else f"{name}_{k + 1}" for name, k in fields)


def real(dtype: np.dtype[Any]) -> bool:
    """Whether a kind of number is real."""
    return dtype.kind in "biuf"


def packed_log(path: Path, arrays: Sequence[Packed | Member]) -> ArraysLog:
    """The table made of packed arrays, and of members that are left out."""

    def read(places: Sequence[Place], rows: tuple[int, int], size: int) -> Iterator[Array]:
        members: dict[tuple[int, int], list[int]] = {}
        for column, place in enumerate(places):
            members.setdefault((place.member, place.axis), []).append(column)
        slabs = []
        for (number, axis), columns in members.items():
            packed = arrays[number]
            if isinstance(packed, Packed):
                wanted = [places[column].component for column in columns]
                slabs.append((columns, packed.slabs(axis, wanted, rows, size)))
        with explained(path):
            for n in _steps(rows, size):
                table = np.empty((n, len(places)))
                for columns, slab in slabs:
                    table[:, columns] = next(slab)
                yield table

    members = [a.member if isinstance(a, Packed) else a for a in arrays]
    return ArraysLog.of(path, members, read)


@contextmanager
def explained(path: Path) -> Iterator[None]:
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
        count -= len(_exactly(stream, min(count, SKIP)))


def _exactly(stream: IO[bytes], count: int) -> bytes:
    data = stream.read(count)
    if len(data) != count:
        raise EOFError("it ends before its arrays do")
    return data


def _steps(rows: tuple[int, int], size: int) -> Iterator[int]:
    for start in range(*rows, size):
        yield min(size, rows[1] - start)
