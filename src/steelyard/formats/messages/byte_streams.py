"""Bytes of strangers' files, packed or not, read in bounded pieces."""

import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

BLOCK = 1 << 16
"""Bytes unpacked at a time."""
WINDOW = 1 << 25
"""Memory that a packed stream may ask its reader to keep [bytes]."""
SPARE, RATIO = 1 << 28, 1000
"""A file may unpack to 256 MiB and 1000 times its packed size; no log of a robot packs so well."""


class EndOfBytes(Exception):
    """The bytes end in the middle of something."""


class Damaged(Exception):
    """The bytes make no sense; says why."""


class Bytes(Protocol):
    """Bytes read from front to back."""

    def take(self, length: int) -> bytes:
        """The next bytes, exactly so many; `EndOfBytes` if there are fewer."""
        ...

    def skip(self, length: int) -> None:
        """Pass over bytes."""
        ...


class FileBytes:
    """A file from front to back.

    Attributes:
        at: Byte that is read next.
        size: Bytes of the file.
    """

    def __init__(self, path: Path, at: int = 0) -> None:
        self._file = path.open("rb", buffering=1 << 18)
        self.size = path.stat().st_size
        self.at = at
        self._file.seek(at)

    def __enter__(self) -> "FileBytes":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def take(self, length: int) -> bytes:
        """The next bytes, exactly so many."""
        if length > self.size - self.at:
            raise EndOfBytes
        data = self._file.read(length)
        if len(data) < length:
            raise EndOfBytes
        self.at += length
        return data

    def skip(self, length: int) -> None:
        """Pass over bytes."""
        if length > self.size - self.at:
            raise EndOfBytes
        self.at += length
        self._file.seek(self.at)

    def upto(self, length: int) -> bytes:
        """The next bytes, fewer at the end of the file."""
        data = self._file.read(length)
        self.at += len(data)
        return data


class GrowingBytes(FileBytes):
    """A file that is still being written: waits for bytes that are not there yet.

    Args:
        path: Where it is.
        waiting: Called while bytes are missing; they count as the end when it returns `False`.
    """

    def __init__(self, path: Path, waiting: Callable[[], bool]) -> None:
        super().__init__(path)
        self._path, self._waiting = path, waiting

    def take(self, length: int) -> bytes:
        """The next bytes, exactly so many, as soon as they are there."""
        self._reach(length)
        return super().take(length)

    def skip(self, length: int) -> None:
        """Pass over bytes, as soon as they are there."""
        self._reach(length)
        super().skip(length)

    def upto(self, length: int) -> bytes:
        """The next bytes, fewer at the end."""
        with suppress(EndOfBytes):
            self._reach(length)
        return super().upto(length)

    def _reach(self, length: int) -> None:
        while length > self.size - self.at:
            self.size = self._path.stat().st_size
            if length > self.size - self.at and not self._waiting():
                raise EndOfBytes


@dataclass
class Budget:
    """Against small files that unpack to gigabytes: sizes of one pass over a file.

    Attributes:
        packed: Bytes unpacked so far, as stored.
        unpacked: Bytes they became.
    """

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
    """The content of a chunk, unpacked while it is read.

    Args:
        file: A file that stands at the start of the chunk's content.
        length: Bytes of the chunk as stored.
        packing: `""`, `none`, `zstd`, `lz4` or `bz2`.
        size: Bytes that it declares to unpack to.
        budget: What the whole file may unpack to.
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


class _Piece:
    """The next so many bytes of a file, as a file of its own."""

    def __init__(self, file: FileBytes, length: int) -> None:
        self._file = file
        self._left = length

    def read(self, length: int = -1) -> bytes:
        """Up to so many bytes."""
        wanted = self._left if length < 0 else min(length, self._left)
        data = self._file.upto(min(wanted, 4 * BLOCK))
        self._left -= len(data)
        return data


def unpacked(packing: str, source: Any) -> Iterator[bytes]:
    """Blocks of at most `BLOCK` bytes of what a source's bytes unpack to.

    Args:
        packing: `""`, `none`, `zstd`, `lz4` or `bz2`.
        source: A file-like object.

    Raises:
        Damaged: Not packed so, or broken.
    """
    if packing in ("", "none"):
        yield from iter(lambda: source.read(BLOCK), b"")
    elif packing == "zstd":
        yield from _of_zstd(source)
    elif packing == "lz4":
        import lz4.frame

        yield from _pulled(lz4.frame.LZ4FrameDecompressor(), source)
    elif packing == "bz2":
        import bz2

        yield from _pulled(bz2.BZ2Decompressor(), source)
    else:
        raise Damaged(f"its compression '{packing[:20]}' is not known")


def unpacked_whole(packing: str, data: bytes, limit: int) -> bytes | None:
    """What some bytes unpack to; `None` if that is more than `limit` bytes."""
    from io import BytesIO

    whole = bytearray()
    for block in unpacked(packing, BytesIO(data)):
        whole += block
        if len(whole) > limit:
            return None
    return bytes(whole)


def _of_zstd(source: Any) -> Iterator[bytes]:
    import zstandard

    reader = zstandard.ZstdDecompressor(max_window_size=WINDOW).stream_reader(
        source, read_across_frames=True
    )
    try:
        yield from iter(lambda: reader.read(BLOCK), b"")
    except zstandard.ZstdError as error:
        raise Damaged(f"it cannot be unpacked ({error})") from error


def _pulled(unpacker: Any, source: Any) -> Iterator[bytes]:
    """Blocks of an unpacker that takes bytes and gives a bounded number back."""
    while not unpacker.eof:
        packed = source.read(BLOCK) if unpacker.needs_input else b""
        if not packed and unpacker.needs_input:
            return
        try:
            block = unpacker.decompress(packed, BLOCK)
        except (OSError, RuntimeError, ValueError, EOFError) as error:
            raise Damaged(f"it cannot be unpacked ({error})") from error
        if block:
            yield block
