"""Files packed whole with Zstandard, as ROS 2 bags of `compression_mode: file` have them."""

import atexit
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from steelyard.errors import LogError
from steelyard.formats.messages.byte_streams import Budget, Damaged, unpacked
from steelyard.formats.messages.messages import Container, Message

MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class ZstdFile:
    """A packed file, read by way of its unpacked copy.

    Attributes:
        path: Where it is.
        copy: Its unpacked copy, see `unpacked_copy`.
    """

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
    """An unpacked copy in the folder for temporary files, kept until the program ends.

    Raises:
        LogError: The file is damaged, unpacks to far more than it should, or the disk is full.
    """
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
