"""Files of this machine and of object stores: what is there, its bytes, and copies of logs.

Paths are read without any package; URLs such as `s3://bucket/logs` through fsspec, with the
credentials that its back ends find by themselves (environment, profiles, roles).
"""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from itertools import takewhile
from pathlib import Path
from typing import Any

from steelyard.base.errors import LogError, SteelyardError, require
from steelyard.base.files import explained, whole_file
from steelyard.logs.formats import FORMATS
from steelyard.logs.log_and_errors import reading, require_file

COPIED_BYTES = 1 << 22  # bytes that are read at a time
PATTERN = re.compile(r"[*?[]")  # marks of a pattern of paths
VERSIONS = ("ETag", "etag", "mtime", "LastModified")
"""What back ends say of a file's version; without any, its content is read to know it."""


@dataclass(frozen=True)
class StoredFile:
    """A file: its path or URL, its size in bytes, and a stamp that changes with its content."""

    url: str
    size: int
    stamp: str

    @property
    def name(self) -> str:
        """The file's name."""
        return path_of(self.url).rpartition("/")[2]


def is_url(text: str) -> bool:
    """Whether a text names a place of fsspec; drives of Windows are none."""
    return "://" in text


def without_secrets(url: str) -> str:
    """The URL without users, passwords and query, for messages."""
    return re.sub(r"://[^/\s]*@", "://", url).partition("?")[0] if is_url(url) else url


def files_of(argument: str) -> list[StoredFile]:
    """The log files that a file, a folder, a pattern with `*`, or a URL of these names.

    Raises:
        LogError: There is none, or the place cannot be read.
    """
    found = _remote_files(argument) if is_url(argument) else _local_files(argument)
    logs = [file for file in found if Path(file.name).suffix.lower() in FORMATS]
    if not logs:
        named = f", but {len(found)} other files" if found else ""
        raise LogError(
            f"there is no log{named}",
            where=without_secrets(argument),
            fix=f"name a log, a folder or a pattern of logs that end in {', '.join(FORMATS)}",
        )
    return sorted(logs, key=lambda file: file.url)


def path_of(url: str) -> str:
    """The path in a URL, or the path itself, with forward slashes."""
    if not is_url(url):
        return Path(url).as_posix()
    return "/" + re.sub(r"^[^/]*://[^/]*/?", "", url).partition("?")[0]


def _local_files(argument: str) -> list[StoredFile]:
    place = Path(argument)
    if place.is_dir():
        paths, root = [*place.rglob("*")], place
    elif place.exists():
        paths, root = [place], place.parent
    else:
        root = Path(*takewhile(lambda part: not PATTERN.search(part), place.parts))
        if root == place:
            require_file(place)  # says what is there instead
        paths = [*root.glob(str(place.relative_to(root)))]
    hidden = re.compile(r"(?:^|/)\.[^./]")
    shown = (p for p in paths if not hidden.search(p.relative_to(root).as_posix()))
    return [_local(path) for path in shown if path.is_file() or path.is_symlink()]


def _local(path: Path) -> StoredFile:
    """The file, wherever work on it is done; a link to nothing has no bytes."""
    whole = os.path.abspath(path)  # without "..", but links stay what they are called
    try:
        state = path.stat()
    except OSError:
        return StoredFile(whole, 0, "")
    stamp = f"{state.st_mtime_ns} {state.st_ctime_ns} {state.st_ino}"
    return StoredFile(whole, state.st_size, stamp)


def _remote_files(argument: str) -> list[StoredFile]:
    system, path = _file_system(argument)
    with _explained(argument):
        system.invalidate_cache()  # logs may have come since the last look
        if PATTERN.search(path):
            found = system.glob(path, detail=True)
        elif system.isfile(path):
            found = {path: system.info(path)}
        else:
            found = system.find(path, detail=True)
    scheme = argument.partition("://")[0]
    files = []
    for name, info in found.items():
        if info.get("type", "file") == "file":
            url = f"{scheme}://{name.lstrip('/') if scheme != 'file' else name}"
            stamp = next((info[k] for k in VERSIONS if k in info), "")
            files.append(StoredFile(url, int(info.get("size") or 0), str(stamp)))
    return files


def _file_system(url: str) -> tuple[Any, str]:
    require("fsspec", "cluster", "URLs", without_secrets(url))
    from fsspec.core import url_to_fs

    with _explained(url):
        system, path = url_to_fs(url)
    return system, str(path)


@contextmanager
def _explained(url: str) -> Iterator[None]:
    """Whatever a back end raises is a `LogError` that names the URL, and no secret."""
    try:
        yield
    except SteelyardError:
        raise
    except ImportError as error:
        scheme = url.partition("://")[0]
        raise LogError(
            f"URLs that begin with {scheme}:// need a package that is not installed",
            where=without_secrets(url),
            fix=f"install the back end of fsspec for them (pip install {_BACK_ENDS.get(scheme)})"
            if scheme in _BACK_ENDS
            else "use file://, s3:// or gs://",
        ) from error
    except Exception as error:  # back ends have errors of their own, without a common root
        kind, words = type(error).__name__, " ".join(str(error).split())
        expired = any(w in f"{kind} {words}" for w in ("Expired", "Credential", "Forbidden", "403"))
        raise LogError(
            f"the URL cannot be read ({kind})",
            where=without_secrets(url),
            fix="renew the credentials, as for the command line tools of this store"
            if expired
            else "check the URL, the network and the credentials",
        ) from error


_BACK_ENDS = {"s3": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "az": "adlfs", "abfs": "adlfs"}


def digest(file: StoredFile) -> str:
    """SHA-256 of a file's bytes."""
    found = sha256()
    for block in _blocks(file.url):
        found.update(block)
    return found.hexdigest()


def _blocks(url: str) -> Iterator[bytes]:
    with _explained(url):
        if is_url(url):
            system, path = _file_system(url)
            opened = system.open(path, "rb")
        else:
            with reading(Path(url)):
                opened = Path(url).open("rb")
        with opened as stream:
            while block := stream.read(COPIED_BYTES):
                yield block


@contextmanager
def on_disk(url: str) -> Iterator[Path]:
    """The log as a file of this machine: a URL is copied to a temporary file for as long.

    The copy is in a folder that is called as the log's own: runs are named by both.
    """
    if not is_url(url):
        yield Path(url)
        return
    with tempfile.TemporaryDirectory() as folder:
        place = Path(path_of(url))
        copy = Path(folder) / (place.parent.name or "logs") / place.name
        copy.parent.mkdir()
        with copy.open("wb") as stream:
            for block in _blocks(url):
                stream.write(block)
        yield copy


class Folder:
    """Small files by name in a folder or at a URL; each is there whole or not at all."""

    def __init__(self, place: str | Path) -> None:
        self.place = str(place)
        if not is_url(self.place):
            with explained(Path(self.place)):
                Path(self.place).mkdir(parents=True, exist_ok=True)

    def read(self, name: str) -> bytes | None:
        """The bytes of a file; `None` if there is none."""
        if not is_url(self.place):
            try:
                return (Path(self.place) / name).read_bytes()
            except FileNotFoundError:
                return None
        system, path = _file_system(f"{self.place}/{name}")
        with _explained(self.place):
            try:
                return bytes(system.cat_file(path))
            except FileNotFoundError:
                return None

    def write(self, name: str, content: bytes) -> None:
        """Write a file, or replace it."""
        if not is_url(self.place):
            with whole_file(Path(self.place) / name) as part:
                part.write_bytes(content)
            return
        system, path = _file_system(f"{self.place}/{name}")
        with _explained(self.place):
            system.pipe_file(path, content)
