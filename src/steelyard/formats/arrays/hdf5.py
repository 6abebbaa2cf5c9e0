"""HDF5, and MATLAB 7.3, which is HDF5: read by a process of its own, see `hdf5_child`."""

import json
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.arrays.arrays_log import ArraysLog, Member, Place
from steelyard.formats.log import require_file
from steelyard.processes import module_command

CHILD = module_command("steelyard.formats.arrays.hdf5_child")


def open_hdf5(path: Path, *, matlab: bool = False) -> ArraysLog:
    """The datasets of all groups as a table; they are called by their paths, such as `run/q`.

    Raises:
        LogError: Not there, not HDF5, or without a table.
    """
    require_file(path)
    stat = path.stat()
    members = _members(path.resolve(), matlab, stat.st_mtime_ns, stat.st_size)
    return ArraysLog.of(path, members, _Reader(path, members, matlab))


@lru_cache(maxsize=64)
def _members(path: Path, matlab: bool, changed: int, size: int) -> tuple[Member, ...]:
    """What is in a file as it was at a time."""
    with _answered(path, {"path": str(path), "matlab": matlab}) as answer:
        text = answer.read()
    return tuple(
        Member(found["name"], tuple(found["shape"]), tuple(found["labels"]), found["left_out"])
        for found in json.loads(text)
    )


@dataclass(frozen=True)
class _Reader:
    path: Path
    members: Sequence[Member]
    matlab: bool

    def __call__(
        self, places: Sequence[Place], rows: tuple[int, int], size: int
    ) -> Iterator[Array]:
        separator = "." if self.matlab else "/"
        names = [self.members[p.member].name.replace(separator, "/") for p in places]
        columns = [[n, p.axis, p.component] for n, p in zip(names, places, strict=True)]
        request = {"path": str(self.path), "rows": rows, "size": size, "columns": columns}
        with _answered(self.path, request) as answer:
            for start in range(*rows, size):
                n = min(size, rows[1] - start)
                data = answer.read(8 * n * len(places))
                if len(data) < 8 * n * len(places):
                    raise EOFError
                yield np.frombuffer(data, np.float64).reshape(n, len(places)).copy()


@contextmanager
def _answered(path: Path, request: dict[str, Any]) -> Iterator[IO[bytes]]:
    """The child's answer to a request.

    Raises:
        LogError: It could not read the file, or crashed.
    """
    pipe = subprocess.PIPE
    child = subprocess.Popen(CHILD, stdin=pipe, stdout=pipe, stderr=pipe)
    try:
        if child.stdin is None or child.stdout is None or child.stderr is None:
            raise RuntimeError("a process without pipes")
        child.stdin.write(json.dumps(request).encode())
        child.stdin.close()
        with suppress(EOFError):
            yield child.stdout
            if child.stdout.read(1) == b"" and child.wait() == 0:
                return
        raise _broken(path, child.stderr.read(), child.wait())
    finally:
        child.kill()
        for stream in (child.stdout, child.stderr):
            if stream is not None:
                stream.close()
        child.wait()


def _broken(path: Path, stderr: bytes, code: int) -> LogError:
    lines = stderr.decode("utf-8", "replace").strip().splitlines()
    why = lines[-1][:300] if lines and code == 1 else "the HDF5 library crashed on it"
    return LogError(
        f"the file cannot be read as HDF5 ({why})",
        where=str(path),
        fix="copy it again, or save it anew with the program that wrote it",
    )
