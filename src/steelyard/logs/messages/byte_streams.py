"""Bytes of strangers' files, packed or not, in bounded pieces; files packed with Zstandard."""

import atexit
import shutil
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from steelyard.base.errors import LogError
from steelyard.logs.messages.messages import Container, Message

BLOCK_BYTES = 1 << 16
"""Bytes unpacked at a time."""
MOST_WINDOW_BYTES = 1 << 25
"""Memory that a packed stream may ask its reader to keep [bytes]."""
SPARE, RATIO = 1 << 28, 1000
"""A file may unpack to 256 MiB and 1000 times its packed size; no log of a robot packs so well."""


class EndOfBytes(Exception):
    """The bytes end in the middle of something."""


class Damaged(Exception):
    """The bytes make no sense; says why."""


class FileBytes(AbstractContextManager["FileBytes"]):
    """A file from front to back; one that is still being written is waited for.

    Args:
        path: Where it is.
        at: Byte to start at.
        waiting: Called while bytes are missing; they count as the end when it returns `False`.
    """

    def __init__(self, path: Path, at: int = 0, waiting: Callable[[], bool] | None = None) -> None:
        self._file = path.open("rb", buffering=1 << 18)
        self._path, self._waiting = path, waiting
        self.size = path.stat().st_size
        self.at = self._file.seek(at)

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def take(self, length: int) -> bytes:
        """The next bytes, exactly so many."""
        self._reach(length)
        data = self._file.read(length)
        if len(data) < length:
            raise EndOfBytes
        self.at += length
        return data

    def skip(self, length: int) -> None:
        """Pass over bytes."""
        self._reach(length)
        self.at = self._file.seek(self.at + length)

    def upto(self, length: int) -> bytes:
        """The next bytes, fewer at the end of the file."""
        with suppress(EndOfBytes):
            self._reach(length)
        data = self._file.read(length)
        self.at += len(data)
        return data

    def _reach(self, length: int) -> None:
        while length > self.size - self.at:
            if self._waiting is None:
                raise EndOfBytes
            self.size = self._path.stat().st_size
            if length > self.size - self.at and not self._waiting():
                raise EndOfBytes


@dataclass
class Budget:
    """Against small files that unpack to gigabytes: sizes of one pass over a file."""

    packed: int = 0
    unpacked: int = 0

    def require(self, declared: int) -> None:
        """Check whether so many bytes more may be unpacked."""
        if self.unpacked + declared > SPARE + RATIO * self.packed:
            raise Damaged(
                f"it unpacks to {self.unpacked + declared:,} bytes, more than {RATIO} times its "
                "packed size"
            )


class UnpackedBytes:
    """The next `length` bytes of a file, which are a chunk's content, unpacked while they are read.

    `size` is what it declares to unpack to, `budget` what the whole file may.
    """

    def __init__(
        self, file: FileBytes, length: int, packing: str, size: int, budget: Budget
    ) -> None:
        budget.packed += min(length, file.size - file.at)
        budget.require(size)
        self.checksum = 0
        self.left = size
        self._budget = budget
        self._blocks = unpacked(packing, _Piece(file, length))
        self._block, self._at = b"", 0

    def take(self, length: int) -> bytes:
        """The next bytes, exactly so many."""
        end = self._at + length
        if end > len(self._block):
            self._fill(length)
            end = length
        data = self._block[self._at : end]
        self._at = end
        return data

    def skip(self, length: int) -> None:
        """Pass over bytes."""
        while length > len(self._block) - self._at:
            length -= len(self._block) - self._at
            self._block, self._at = self._next(), 0
        self._at += length

    @property
    def ended(self) -> bool:
        """Whether all that was declared has been read."""
        return self.left == 0 and self._at == len(self._block)

    def _fill(self, length: int) -> None:
        if length > self.left + len(self._block) - self._at:
            raise EndOfBytes
        pieces, missing = [self._block[self._at :]], length - len(self._block) + self._at
        while missing > 0:
            pieces.append(self._next())
            missing -= len(pieces[-1])
        self._block, self._at = b"".join(pieces), 0

    def _next(self) -> bytes:
        block = next(self._blocks, b"")
        if not block:
            raise EndOfBytes
        if len(block) > self.left:
            raise Damaged("it unpacks to more than it declares")
        self.left -= len(block)
        self._budget.unpacked += len(block)
        self.checksum = zlib.crc32(block, self.checksum)
        return block


Bytes = FileBytes | UnpackedBytes


class _Piece:
    """The next so many bytes of a file, as a file of its own."""

    def __init__(self, file: FileBytes, length: int) -> None:
        self._file = file
        self._left = length

    def read(self, length: int = -1) -> bytes:
        """Up to so many bytes."""
        wanted = self._left if length < 0 else min(length, self._left)
        data = self._file.upto(min(wanted, 4 * BLOCK_BYTES))
        self._left -= len(data)
        return data


def unpacked(packing: str, source: Any) -> Iterator[bytes]:
    """Blocks of at most `BLOCK_BYTES` bytes of what a source's bytes unpack to.

    `packing` is `""`, `none`, `zstd`, `lz4` or `bz2`; the source is a file-like object.
    """
    if packing in ("", "none"):
        yield from iter(lambda: source.read(BLOCK_BYTES), b"")
    elif packing == "zstd":
        import zstandard

        unpacker = zstandard.ZstdDecompressor(max_window_size=MOST_WINDOW_BYTES)
        reader = unpacker.stream_reader(source, read_across_frames=True)
        try:
            yield from iter(lambda: reader.read(BLOCK_BYTES), b"")
        except zstandard.ZstdError as error:
            raise Damaged(f"it cannot be unpacked ({error})") from error
    elif packing == "lz4":
        import lz4.frame

        yield from _pulled(lz4.frame.LZ4FrameDecompressor(), source)
    elif packing == "bz2":
        import bz2

        yield from _pulled(bz2.BZ2Decompressor(), source)
    else:
        raise Damaged(f"its compression '{packing[:20]}' is not known")


def _pulled(unpacker: Any, source: Any) -> Iterator[bytes]:
    """Blocks of an unpacker that takes bytes and gives a bounded number back."""
    while not unpacker.eof:
        packed = source.read(BLOCK_BYTES) if unpacker.needs_input else b""
        if not packed and unpacker.needs_input:
            return
        try:
            block = unpacker.decompress(packed, BLOCK_BYTES)
        except (OSError, RuntimeError, ValueError, EOFError) as error:
            raise Damaged(f"it cannot be unpacked ({error})") from error
        if block:
            yield block


ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class ZstdFile:
    """A packed file, read by way of its unpacked copy."""

    path: Path
    copy: Container

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks of the copy."""
        return self.copy.remarks

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages; `None` if the copy does not state them."""
        with self._named():
            return self.copy.announced()

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the copy."""
        with self._named():
            yield from self.copy.messages(topics)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Errors name the file, not the copy that nobody knows of."""
        try:
            yield
        except LogError as error:
            where = error.where.replace(str(self.copy.path), str(self.path))
            raise LogError(error.wrong, where=where, fix=error.fix) from error


def unpacked_copy(path: Path) -> Path:
    """An unpacked copy in the folder for temporary files, kept until the program ends."""
    try:
        stat = path.stat()
        return _copy(path.resolve(), stat.st_mtime_ns, stat.st_size)
    except Damaged as error:
        raise LogError(
            f"the file is damaged: {error}",
            where=str(path),
            fix="copy it again, or unpack what is left of it with `zstd -d` and name that file",
        ) from error
    except OSError as error:
        raise LogError(
            f"the file cannot be unpacked ({error.strerror or error})",
            where=str(path),
            fix="set TMPDIR to a folder on a disk with room for the unpacked file",
        ) from error


@cache
def _copy(path: Path, changed: int, size: int) -> Path:
    """The copy of a file as it was at a time."""
    folder = Path(mkdtemp(prefix="steelyard-bag-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    budget = Budget(packed=size)
    copy = folder / path.stem
    try:
        with path.open("rb") as source, copy.open("wb") as target:
            for block in unpacked("zstd", source):
                budget.require(len(block))
                budget.unpacked += len(block)
                target.write(block)
    except BaseException:
        copy.unlink(missing_ok=True)
        raise
    return copy
