"""Bytes of strangers' files, packed or not: no more is unpacked than the bytes may stand for."""

import atexit
import os
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import IO

from steelyard.base.errors import LogError

BLOCK_BYTES = 1 << 16  # bytes of a packed file that are unpacked at a time
LARGEST_CHUNK = 1 << 26  # bytes of a chunk, which is unpacked whole, packed or unpacked
MOST_WINDOW_BYTES = 1 << 25  # memory that a packed stream may ask its reader to keep [bytes]
SPARE, RATIO = 1 << 28, 1000
"""A file may unpack to 256 MiB and 1000 times its packed size; no log of a robot packs so well."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class EndOfBytes(Exception):
    """The bytes end in the middle of something."""


class Damaged(Exception):
    """The bytes make no sense; says why."""


class ByteSource(AbstractContextManager["ByteSource"]):
    """A stream from front to back; a file that is still being written is waited for.

    Args:
        stream: Bytes in memory, or an open file.
        at: Byte to start at.
        waiting: Called while bytes are missing; they count as the end when it returns `False`.
    """

    def __init__(
        self, stream: IO[bytes], at: int = 0, waiting: Callable[[], bool] | None = None
    ) -> None:
        self._stream, self._waiting = stream, waiting
        self.size = stream.seek(0, os.SEEK_END)
        self.at = stream.seek(at)

    @classmethod
    def of_file(
        cls, path: Path, at: int = 0, waiting: Callable[[], bool] | None = None
    ) -> "ByteSource":
        """The bytes of a file."""
        return cls(path.open("rb", buffering=1 << 18), at, waiting)

    def __exit__(self, *error: object) -> None:
        self._stream.close()

    def take(self, length: int) -> bytes:
        """The next bytes, exactly so many."""
        self._reach(length)
        data = self._stream.read(length)
        if len(data) < length:
            raise EndOfBytes
        self.at += length
        return data

    def skip(self, length: int) -> None:
        """Pass over bytes."""
        self._reach(length)
        self.at = self._stream.seek(self.at + length)

    def upto(self, length: int) -> bytes:
        """The next bytes, fewer at the end of the file."""
        with suppress(EndOfBytes):
            self._reach(length)
        data = self._stream.read(length)
        self.at += len(data)
        return data

    def _reach(self, length: int) -> None:
        while length > self.size - self.at:
            if self._waiting is None:
                raise EndOfBytes
            self.size = os.fstat(self._stream.fileno()).st_size
            if length > self.size - self.at and not self._waiting():
                raise EndOfBytes


def require_plausible(unpacked: int, packed: int) -> None:
    """Check that a file may unpack to so many bytes: small ones do not stand for gigabytes."""
    if unpacked > SPARE + RATIO * packed:
        raise Damaged(f"it unpacks to {unpacked:,} bytes, more than {RATIO} times its packed size")


def unpacked(packing: str, packed: bytes, most: int) -> bytes:
    """What bytes unpack to, no more than `most` of it; less if they end too early.

    `packing` is `""`, `none`, `zstd`, `lz4` or `bz2`.
    """
    if packing in ("", "none"):
        return packed[:most]
    import zstandard

    try:
        if packing == "zstd":
            return _zstd(packed).read(most)
        if packing == "lz4":
            import lz4.frame

            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, most))
        if packing == "bz2":
            import bz2

            return bz2.BZ2Decompressor().decompress(packed, most)
    except (zstandard.ZstdError, OSError, RuntimeError, ValueError, EOFError) as error:
        raise Damaged(f"it cannot be unpacked ({error})") from error
    raise Damaged(f"its compression '{packing[:20]}' is not known")


def _zstd(source: bytes | IO[bytes]) -> IO[bytes]:
    import zstandard

    unpacker = zstandard.ZstdDecompressor(max_window_size=MOST_WINDOW_BYTES)
    return unpacker.stream_reader(source, read_across_frames=True)


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
    from zstandard import ZstdError

    folder = Path(mkdtemp(prefix="steelyard-bag-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    copy = folder / path.stem
    try:
        with path.open("rb") as source, copy.open("wb") as target:
            reader = _zstd(source)
            while block := reader.read(BLOCK_BYTES):
                require_plausible(target.tell() + len(block), size)
                target.write(block)
    except BaseException as error:
        copy.unlink(missing_ok=True)
        if isinstance(error, ZstdError):
            raise Damaged(f"it cannot be unpacked ({error})") from error
        raise
    return copy
