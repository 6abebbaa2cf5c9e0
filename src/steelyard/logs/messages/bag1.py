"""Messages in ROS 1 bags, indexed or not.

The records are read from front to back, as that also works for a bag whose recorder was killed
(`.bag.active`): every chunk says itself what its messages are.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from steelyard.base.errors import LogError
from steelyard.logs.messages.byte_streams import (
    Budget,
    Bytes,
    Damaged,
    EndOfBytes,
    FileBytes,
    UnpackedBytes,
)
from steelyard.logs.messages.mcap import unreadable
from steelyard.logs.messages.messages import LARGEST_MESSAGE, Channel, Message

BAG1_MAGIC = b"#ROSBAG V"
VERSION = b"#ROSBAG V2.0\n"
LONGEST_HEADER = 1 << 20
"""Bytes of the longest header or definition that is read."""
BAG1_DEFINITION_BYTES = 1 << 24
"""Bytes of all definitions together."""
MESSAGE, HEADER, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 5, 6, 7
_U32 = struct.Struct("<I")
Fields = dict[bytes, bytes]


@dataclass(frozen=True)
class Bag1:
    """One ROS 1 bag.

    Attributes:
        path: Where it is.
        index: Byte at which its index starts; zero if it has none.
    """

    path: Path
    index: int

    @classmethod
    def open(cls, path: Path) -> "Bag1":
        """Read the header of a file that starts as bags do.

        Raises:
            LogError: It is of an older version, encrypted, or cannot be read.
        """
        try:
            with FileBytes(path) as file:
                version = file.upto(len(VERSION))
                if version != VERSION:
                    raise _old_version(path, version)
                fields = _fields(file)
                size = file.size
        except OSError as error:
            raise unreadable(path, error) from error
        except (EndOfBytes, Damaged) as error:
            raise _damaged(path, len(VERSION), str(error) or "the file ends in it") from error
        if name := fields.get(b"encryptor"):
            raise LogError(
                f"the bag is encrypted by {name.decode(errors='replace')}",
                where=str(path),
                fix="decrypt it with `rosbag decrypt` first",
            )
        index = int.from_bytes(fields.get(b"index_pos", b""), "little")
        return cls(path, index if index <= size else 0)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Whether its index, and with it perhaps its end, is missing."""
        if self.index:
            return ()
        return ("the bag has no index: it was not closed; it is read up to where it ends",)

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages according to the index; `None` without one."""
        if not self.index:
            return None
        walk = _Walk(frozenset())
        try:
            with FileBytes(self.path, self.index) as file:
                while file.at < file.size:
                    for _ in walk.record(file):
                        pass
        except (OSError, EndOfBytes, Damaged):
            return None
        return frozenset(
            channel.topic for i, channel in walk.channels.items() if walk.counts.get(i)
        )

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the file."""
        walk = _Walk(topics)
        at = len(VERSION)
        try:
            with FileBytes(self.path, at) as file:
                end = self.index or file.size
                while file.at < end:
                    at = file.at
                    yield from walk.record(file)
        except OSError as error:
            raise unreadable(self.path, error) from error
        except EndOfBytes:
            if self.index:
                raise _damaged(self.path, at, "it claims to be longer than it is") from None
        except Damaged as error:
            if self.index or not walk.counts:
                raise _damaged(self.path, at, str(error)) from error


class _Walk:
    """One pass over the records of a bag.

    Attributes:
        channels: Channels met so far, by the number of their connection.
        counts: Messages per connection, as far as they were met or the index states.
    """

    def __init__(self, topics: frozenset[str] | None) -> None:
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}
        self._topics = topics
        self._definitions = 0
        self._budget = Budget()

    def record(self, file: FileBytes) -> Iterator[Message]:
        """The messages in the next record of a bag."""
        fields = _fields(file)
        (length,) = _U32.unpack(file.take(4))
        if fields.get(b"op") == bytes([CHUNK]):
            end = file.at + length
            yield from self._chunk(file, fields, length)
            file.skip(end - file.at)
        elif message := self._small(file, fields, length):
            yield message

    def _chunk(self, file: FileBytes, fields: Fields, length: int) -> Iterator[Message]:
        packing = fields.get(b"compression", b"").decode(errors="replace")
        size = _number(fields, b"size")
        whole = file.at + length <= file.size
        content = UnpackedBytes(file, length, packing, size, self._budget)
        try:
            while not content.ended:
                inner = _fields(content)
                (stored,) = _U32.unpack(content.take(4))
                if message := self._small(content, inner, stored):
                    yield message
        except EndOfBytes:
            if whole:
                raise Damaged("its content ends early") from None
            raise

    def _small(self, source: Bytes, fields: Fields, length: int) -> Message | None:
        code = fields.get(b"op", b"\0")[0]
        if code == MESSAGE:
            return self._message(source, fields, length)
        if code == CONNECTION:
            self._connect(source, fields, length)
        elif code == CHUNK_INFO and length <= LONGEST_HEADER:
            pairs = source.take(length)
            for number, count in struct.iter_unpack("<II", pairs[: len(pairs) // 8 * 8]):
                self.counts[number] = self.counts.get(number, 0) + count
        elif code in (HEADER, 4, CHUNK_INFO):
            source.skip(length)
        else:
            raise Damaged(f"it is of no known kind ({code})")
        return None

    def _message(self, source: Bytes, fields: Fields, length: int) -> Message | None:
        number = _number(fields, b"conn")
        channel = self.channels.get(number)
        if channel is None:
            raise Damaged(f"it is a message of connection {number}, which was not announced")
        whole, part = struct.unpack("<II", fields.get(b"time", b"").rjust(8, b"\0")[:8])
        time = whole * 1_000_000_000 + part
        self.counts[number] = self.counts.get(number, 0) + 1
        wanted = self._topics is None or channel.topic in self._topics
        if wanted and length <= LARGEST_MESSAGE:
            return Message(channel, time, source.take(length))
        source.skip(length)
        return Message(channel, time, None) if wanted else None

    def _connect(self, source: Bytes, fields: Fields, length: int) -> None:
        self._definitions += length
        if length > LONGEST_HEADER or self._definitions > BAG1_DEFINITION_BYTES:
            raise Damaged(f"it is a definition of {length:,} bytes")
        about = _split(source.take(length))
        text = {name: value.decode(errors="replace") for name, value in about.items()}
        topic = fields.get(b"topic", b"").decode(errors="replace")
        package, _, name = text.get(b"type", "").rpartition("/")
        self.channels[_number(fields, b"conn")] = Channel(
            re.sub("/+", "/", topic) or "/",
            f"{package}/msg/{name}" if package else name,
            "ros1",
            text.get(b"message_definition", ""),
            "ros1msg",
        )


def _fields(source: Bytes) -> Fields:
    """The header of the next record."""
    (length,) = _U32.unpack(source.take(4))
    if length > LONGEST_HEADER:
        raise Damaged(f"its header is {length:,} bytes long")
    return _split(source.take(length))


def _split(header: bytes) -> Fields:
    """Fields `name=value`, each after its length."""
    fields, at = {}, 0
    while at < len(header):
        if at + 4 > len(header):
            raise Damaged("its header is cut")
        (length,) = _U32.unpack_from(header, at)
        name, equals, value = header[at + 4 : at + 4 + length].partition(b"=")
        at += 4 + length
        if not equals or at > len(header):
            raise Damaged("its header is not made of fields")
        fields[name] = value
    return fields


def _number(fields: Fields, name: bytes) -> int:
    value = fields.get(name, b"")
    if len(value) != 4:
        raise Damaged(f"its header lacks '{name.decode()}'")
    return int.from_bytes(value, "little")


def _old_version(path: Path, version: bytes) -> LogError:
    found = version[len(BAG1_MAGIC) - 1 :].decode(errors="replace").strip()
    return LogError(
        f"the bag is of version {found}; version V2.0 is read",
        where=str(path),
        fix="bring it up to date with ROS 1's `rosbag fix OLD.bag NEW.bag`",
    )


def _damaged(path: Path, at: int, why: str) -> LogError:
    return LogError(
        f"the bag is damaged: the record at byte {at} cannot be read, {why}",
        where=f"{path}, byte {at}",
        fix="copy it again, or save what is left of it with ROS 1's `rosbag reindex` on a copy",
    )
