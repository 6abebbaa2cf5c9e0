"""Messages in ROS 2 bags: a folder with `metadata.yaml`, or one of its files alone.

`rosbags.rosbag2.Reader` is not used for files of strangers: it unpacks whatever a file stands for
(a bag of 16 kB to 500 MB on the disk, one of 0.4 MB to 0.9 GiB of memory), and refuses a bag that
was cut off and a file whose folder has no `metadata.yaml`.
"""

import re
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import reading, require_file
from steelyard.logs.messages.containers_and_decoding import (
    LARGEST_MESSAGE,
    Channel,
    Container,
    Message,
)
from steelyard.logs.messages.decompression import ZSTD_MAGIC, Damaged, unpacked, unpacked_copy
from steelyard.logs.messages.mcap_and_ros1_bag import MCAP_MAGIC, open_mcap

METADATA = "metadata.yaml"
SQLITE_MAGIC = b"SQLite format 3\0"
LONGEST_METADATA = 1 << 20  # bytes of the longest metadata, text or definition that is read
MOST_TOPICS = 10_000


@dataclass(frozen=True)
class SqliteFile:
    """The storage file `.db3` of a ROS 2 bag, opened read-only; nothing is left beside it.

    `content` is the file itself, or its unpacked copy.
    """

    path: Path
    content: Path

    @property
    def remarks(self) -> tuple[str, ...]:
        """Whether a journal beside it holds messages that are not yet in it."""
        journal = self.content.with_name(f"{self.content.name}-wal")
        if not journal.exists() or journal.stat().st_size == 0:
            return ()
        return (
            f"the bag was not closed: {journal.name} holds messages that are not read (open a copy "
            "of both files once with `sqlite3 COPY.db3 .tables` to take them in)",
        )

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages."""
        with self._connected() as base:
            found = base.execute("SELECT DISTINCT topic_id FROM messages").fetchall()
            channels = _channels(base)
        return frozenset(channels[i].topic for (i,) in found if i in channels)

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order in which they were received."""
        with self._connected() as base:
            channels = {
                i: channel
                for i, channel in _channels(base).items()
                if topics is None or channel.topic in topics
            }
            wanted = ", ".join(str(i) for i in channels) or "NULL"
            query = (
                "SELECT rowid, topic_id, timestamp, CASE WHEN length(data) <= ? THEN data END "
                f"FROM messages NOT INDEXED WHERE topic_id IN ({wanted}) ORDER BY rowid"
            )
            last = None
            for row, topic, time, data in base.execute(query, (LARGEST_MESSAGE,)):
                if last is not None and row <= last:
                    raise sqlite3.DatabaseError("rows occur twice")
                last = row
                if isinstance(time, int) and topic in channels:
                    whole = data if isinstance(data, bytes) else None
                    yield Message(channels[topic], time, whole)

    @contextmanager
    def _connected(self) -> Iterator[sqlite3.Connection]:
        """The open database; what SQLite says of a damaged one is a `LogError`."""
        try:
            with reading(self.path):
                _require_whole(self.content)
            address = f"{self.content.absolute().as_uri()}?mode=ro&immutable=1"
            with closing(sqlite3.connect(address, uri=True)) as base:
                base.text_factory = lambda text: text.decode(errors="replace")
                if sys.version_info >= (3, 11):  # Python 3.10 keeps SQLite's own limit of 1 GB
                    base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 4 * LARGEST_MESSAGE)
                base.execute("PRAGMA trusted_schema = OFF")
                tables = base.execute(
                    "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0 "
                    "AND name IN ('messages', 'topics')"
                ).fetchall()
                if len(tables) != 2:
                    raise LogError(
                        "the database is not a ROS 2 bag: it has no tables of topics and messages",
                        where=str(self.path),
                        fix="name the .db3 file of a bag; if it was not closed, copy its -wal file "
                        "too",
                    )
                yield base
        except (sqlite3.Error, OverflowError, ValueError) as error:
            raise LogError(
                f"the bag is damaged: its database cannot be read ({error})",
                where=str(self.path),
                fix="copy it again, or save what is left of it: "
                "`sqlite3 BAD.db3 .recover | sqlite3 GOOD.db3`",
            ) from error


def _require_whole(path: Path) -> None:
    """Check the size of a database, as SQLite takes what is missing of its last page for zeros."""
    with path.open("rb") as file:
        head = file.read(100)
    page = int.from_bytes(head[16:18], "big")
    size = (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")
    if len(head) < 100 or path.stat().st_size < size:
        raise ValueError(f"it has {path.stat().st_size:,} of {size:,} bytes")


def _channels(base: sqlite3.Connection) -> dict[int, Channel]:
    definitions: dict[str, tuple[str, str]] = {}
    if base.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchall():
        definitions = {
            name: (dialect, text)
            for name, dialect, text in base.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions "
                f"WHERE length(encoded_message_definition) <= {LONGEST_METADATA} LIMIT 1000"
            )
        }
    channels = {}
    query = f"SELECT id, name, type, serialization_format FROM topics LIMIT {MOST_TOPICS}"
    for number, topic, kind, encoding in base.execute(query):
        if isinstance(number, int):
            dialect, text = definitions.get(kind, ("", ""))
            channels[number] = Channel(*map(str, (topic, kind, encoding, text, dialect)))
    return channels


@dataclass(frozen=True)
class Bag2:
    """A ROS 2 bag: a folder whose `metadata.yaml` names its files, read one after the other."""

    path: Path
    files: tuple[Container, ...]
    packed: bool

    @classmethod
    def open(cls, path: Path) -> "Bag2":
        """Read which files the bag has."""
        metadata = path / METADATA
        try:
            with metadata.open(encoding="utf-8", errors="replace") as file:
                text = file.read(LONGEST_METADATA)
        except OSError as error:
            raise _bad_metadata(metadata, error.strerror or str(error)) from error
        names = _yaml_list(text, "relative_file_paths")
        if not names:
            raise _bad_metadata(metadata, "it lists no 'relative_file_paths'")
        mode, form = (_yaml_value(text, f"compression_{key}").lower() for key in ("mode", "format"))
        packed = mode == "message"
        if mode in ("file", "message") and form != "zstd":
            raise LogError(
                f"the bag's files are compressed ({form}), where zstd is read",
                where=str(path / names[0]),
                fix="convert it with `ros2 bag convert` to one that is not compressed",
            )
        return cls(path, tuple(storage(path / Path(name).name) for name in names), packed)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks of its files."""
        return tuple(f"{f.path.name}: {remark}" for f in self.files for remark in f.remarks)

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages; `None` if a file does not state them."""
        found = [file.announced() for file in self.files]
        if any(topics is None for topics in found):
            return None
        return frozenset[str]().union(*(topics or () for topics in found))

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the files."""
        for file in self.files:
            for message in file.messages(topics):
                yield message._replace(data=_unpacked(message.data)) if self.packed else message


def _unpacked(data: bytes | None) -> bytes | None:
    """A packed message: `None` if it is too long, nothing if it is damaged."""
    if data is None:
        return None
    try:
        whole = unpacked("zstd", data, LARGEST_MESSAGE + 1)
    except Damaged:
        return b""
    return whole if len(whole) <= LARGEST_MESSAGE else None


def storage(path: Path) -> Container:
    """A file of a ROS 2 bag, whatever its suffix, packed or not."""
    require_file(path)
    content = unpacked_copy(path) if first_bytes(path).startswith(ZSTD_MAGIC) else path
    start = first_bytes(content)
    if start.startswith(MCAP_MAGIC):
        return open_mcap(path, content)
    if start == SQLITE_MAGIC:
        return SqliteFile(path, content)
    raise LogError(
        "the file is neither an MCAP file nor the database of a ROS 2 bag",
        where=str(path),
        fix="copy it again; a text table needs the suffix .csv",
    )


def first_bytes(path: Path) -> bytes:
    """As many bytes of a file as its kind is known by."""
    with reading(path), path.open("rb") as file:
        return file.read(len(SQLITE_MAGIC))


def _yaml_value(text: str, key: str) -> str:
    """The value of a key in the plain YAML that ROS 2 writes; empty without one."""
    found = re.search(rf"(?m)^[ \t]*{key}:[ \t]*(.*?)[ \t\r]*$", text)
    return found[1].strip("\"'") if found else ""


def _yaml_list(text: str, key: str) -> tuple[str, ...]:
    inline = _yaml_value(text, key)
    if inline.startswith("["):
        entries = inline.strip("[]").split(",")
    else:
        found = re.search(rf"(?m)^[ \t]*{key}:[ \t\r]*\n((?:[ \t]*-[ \t]+[^\n]*\n?)*)", text)
        entries = re.findall(r"(?m)^[ \t]*-[ \t]+(.*)$", found[1]) if found else []
    return tuple(name for entry in entries if (name := entry.strip().strip("\"'")))


def _bad_metadata(path: Path, why: str) -> LogError:
    return LogError(
        f"the bag's {METADATA} cannot be understood: {why}",
        where=str(path),
        fix="name the bag's .db3 or .mcap file itself, or run `ros2 bag reindex` on a copy",
    )
