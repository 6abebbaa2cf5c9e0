"""Messages in files of records, MCAP and ROS 1 bags, with or without chunks, index and end.

The records are read from front to back, as that also works for a file whose recorder lost power or
was killed (`.bag.active`): every chunk says itself what its messages are. `mcap.stream_reader` does
so too, but unpacks a chunk whole, whatever the limit of a record: 10 kB that stand for 300 MiB take
it 600 MiB, and 73 bytes make it ask for 1.9 GiB. `rosbags.rosbag1.Reader` needs an index.
"""

import re
import struct
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from io import BytesIO
from math import inf
from pathlib import Path
from typing import Any, ClassVar

from steelyard.base.errors import LogError
from steelyard.logs.log import unreadable
from steelyard.logs.messages.byte_streams import (
    Budget,
    Bytes,
    Damaged,
    EndOfBytes,
    FileBytes,
    UnpackedBytes,
)
from steelyard.logs.messages.messages import LARGEST_MESSAGE, Channel, Message

LONGEST_DEFINITION = 1 << 20
"""Bytes of the longest header or definition that is read."""
DEFINITION_BYTES = 1 << 24
"""Bytes of all definitions together."""


class Walk:
    """One pass over the records of a file.

    Attributes:
        channels: Channels met so far, by their number.
        counts: Messages per channel, as far as the file states them or they were met.
        ended: Whether the last record of data was met.
    """

    sender: ClassVar[str]
    file: ClassVar[str]
    rescue: ClassVar[str]
    may_end_damaged: ClassVar[bool] = False

    def __init__(self, topics: frozenset[str] | None) -> None:
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}
        self.ended = False
        self._topics = topics
        self._definitions = 0
        self._budget = Budget()

    def record(self, file: FileBytes) -> Iterator[Message]:
        """The messages in the next record of a file."""
        raise NotImplementedError

    def messages(
        self,
        path: Path,
        at: int,
        whole: bool,
        end: float = inf,
        waiting: Callable[[], bool] | None = None,
    ) -> Iterator[Message]:
        """Messages from a byte on; where the file is `whole`, nothing of it may be missing."""
        try:
            with FileBytes(path, at, waiting) as file:
                while not self.ended and file.at < end:
                    at = file.at
                    yield from self.record(file)
        except OSError as error:
            raise unreadable(path, error) from error
        except EndOfBytes:
            if whole:
                raise self.damaged(path, at, "it claims to be longer than it is") from None
        except Damaged as error:
            if whole or not (self.may_end_damaged and self.counts):
                raise self.damaged(path, at, str(error)) from error

    @classmethod
    def damaged(cls, path: Path, at: int, why: str) -> LogError:
        """The error for a record that makes no sense."""
        return LogError(
            f"the {cls.file} is damaged: the record at byte {at} cannot be read, {why}",
            where=f"{path}, byte {at}",
            fix=f"copy it again, or save what is left of it{cls.rescue}",
        )

    def _inner(self, source: Bytes) -> Message | None:
        """The message in the next record of a chunk, if there is one."""
        raise NotImplementedError

    def _chunk(
        self, file: FileBytes, length: int, packing: str, size: int, end: int
    ) -> Generator[Message, None, int]:
        """The messages in a chunk's content, then its checksum; its record ends at `end`."""
        content = UnpackedBytes(file, length, packing, size, self._budget)
        try:
            while not content.ended:
                if message := self._inner(content):
                    yield message
        except EndOfBytes:
            if end <= file.size:
                raise Damaged("its content ends early") from None
            raise
        return content.checksum

    def _message(self, source: Bytes, number: int, time: int, length: int) -> Message | None:
        channel = self.channels.get(number)
        if channel is None:
            raise Damaged(f"it is a message of {self.sender} {number}, which was not announced")
        wanted = self._topics is None or channel.topic in self._topics
        if wanted and length <= LARGEST_MESSAGE:
            return Message(channel, time, source.take(length))
        source.skip(length)
        return Message(channel, time, None) if wanted else None

    def _definition(self, source: Bytes, length: int) -> bytes:
        self._definitions += length
        if length > LONGEST_DEFINITION or self._definitions > DEFINITION_BYTES:
            raise Damaged(f"it is a definition of {length:,} bytes")
        return source.take(length)


def topics_in_index(walk: Walk, path: Path, start: int, end: float = inf) -> frozenset[str] | None:
    """Topics that have messages according to the records of an index; `None` if it is damaged."""
    try:
        with FileBytes(path, start) as file:
            while file.at < min(end, file.size):
                for _ in walk.record(file):
                    pass
    except (OSError, EndOfBytes, Damaged):
        return None
    return frozenset(channel.topic for i, channel in walk.channels.items() if walk.counts.get(i))


MCAP_MAGIC = b"\x89MCAP0\r\n"
CHUNK_HEAD = struct.Struct("<QQQII")
MESSAGE_HEAD = struct.Struct("<HIQQ")
FOOTER_BYTES = 9 + 20 + len(MCAP_MAGIC)
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 11, 15


@dataclass(frozen=True)
class McapFile:
    """One MCAP file; `complete`: whether its end is there; `waiting`: see `FileBytes`."""

    path: Path
    complete: bool
    waiting: Callable[[], bool] | None = None

    @classmethod
    def open(cls, path: Path) -> "McapFile":
        """Look at both ends of a file that starts as MCAP files do."""
        try:
            with FileBytes(path) as file:
                file.skip(max(file.size - len(MCAP_MAGIC), 0))
                end = file.upto(len(MCAP_MAGIC))
                return cls(path, file.size >= FOOTER_BYTES and end == MCAP_MAGIC)
        except OSError as error:
            raise unreadable(path, error) from error

    @property
    def remarks(self) -> tuple[str, ...]:
        """Whether its end is missing."""
        if self.complete:
            return ()
        return ("the recording was cut off; it is read up to where it ends",)

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages according to the summary; `None` without one."""
        walk = _McapWalk(frozenset())
        try:
            with FileBytes(self.path) as file:
                end = max(file.size - FOOTER_BYTES, 0)
                file.skip(end)
                head = file.take(FOOTER_BYTES - len(MCAP_MAGIC))
                code, _, start, _, _ = struct.unpack("<BQQQI", head)
        except (OSError, EndOfBytes):
            return None
        if not self.complete or code != FOOTER or not 0 < start < end:
            return None
        found = topics_in_index(walk, self.path, start, end)
        return found if walk.counts else None

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the file."""
        start = len(MCAP_MAGIC)
        return _McapWalk(topics).messages(self.path, start, self.complete, waiting=self.waiting)


class _McapWalk(Walk):
    """One pass over the records of an MCAP file."""

    sender, file = "channel", "file"
    rescue = ": `mcap recover IN.mcap -o OUT.mcap`"

    def __init__(self, topics: frozenset[str] | None) -> None:
        super().__init__(topics)
        self._schemas: dict[int, tuple[str, str, str]] = {}

    def record(self, file: FileBytes) -> Iterator[Message]:
        code, length = struct.unpack("<BQ", file.take(9))
        if code == CHUNK:
            end = file.at + length
            yield from self._packed(file, length, end)
            file.skip(end - file.at)
        elif code in (DATA_END, FOOTER):
            self.ended = True
        elif code == 0:
            # What a file system leaves of a block that was never written.
            raise EndOfBytes if length == 0 else Damaged("it is of no known kind")
        elif message := self._plain(file, code, length):
            yield message

    def _packed(self, file: FileBytes, length: int, end: int) -> Iterator[Message]:
        if length < CHUNK_HEAD.size + 8:
            raise Damaged("it is too short for a chunk")
        _, _, size, checksum, name = CHUNK_HEAD.unpack(file.take(CHUNK_HEAD.size))
        if name > 20:
            raise Damaged("its compression has no name")
        packing = file.take(name).decode(errors="replace")
        (stored,) = struct.unpack("<Q", file.take(8))
        if file.at + stored > end:
            raise Damaged("its content is longer than itself")
        found = yield from self._chunk(file, stored, packing, size, end)
        if checksum and found != checksum:
            raise Damaged("its checksum is not that of its content")

    def _inner(self, source: Bytes) -> Message | None:
        code, length = struct.unpack("<BQ", source.take(9))
        return self._plain(source, code, length)

    def _plain(self, source: Bytes, code: int, length: int) -> Message | None:
        if code == MESSAGE:
            if length < MESSAGE_HEAD.size:
                raise Damaged("it is too short for a message")
            number, _, time, _ = MESSAGE_HEAD.unpack(source.take(MESSAGE_HEAD.size))
            return self._message(source, number, time, length - MESSAGE_HEAD.size)
        if code in (SCHEMA, CHANNEL, STATISTICS):
            self._define(code, self._definition(source, length))
        else:
            source.skip(length)
        return None

    def _define(self, code: int, body: bytes) -> None:
        from mcap import records

        if code == SCHEMA:
            schema = _parsed(records.Schema.read, body)
            text = schema.data.decode(errors="replace")
            self._schemas[schema.id] = schema.name, schema.encoding, text
        elif code == CHANNEL:
            channel = _parsed(records.Channel.read, body)
            name, dialect, text = self._schemas.get(channel.schema_id, ("", "", ""))
            encoding = channel.message_encoding
            self.channels[channel.id] = Channel(channel.topic, name, encoding, text, dialect)
        else:
            self.counts = _parsed(records.Statistics.read, body).channel_message_counts


def _parsed(read: Callable[[Any], Any], body: bytes) -> Any:
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError

    try:
        return read(ReadDataStream(BytesIO(body)))
    except (McapError, struct.error, ValueError) as error:
        raise Damaged(f"it is a definition that cannot be read ({error})") from error


BAG1_MAGIC = b"#ROSBAG V"
VERSION = b"#ROSBAG V2.0\n"
BAG_MESSAGE, BAG_HEADER, BAG_INDEX, BAG_CHUNK, BAG_CHUNK_INFO, BAG_CONNECTION = 2, 3, 4, 5, 6, 7
_U32 = struct.Struct("<I")
Fields = dict[bytes, bytes]


@dataclass(frozen=True)
class Bag1:
    """One ROS 1 bag; `index` is the byte at which its index starts, zero if it has none."""

    path: Path
    index: int

    @classmethod
    def open(cls, path: Path) -> "Bag1":
        """Read the header of a file that starts as bags do."""
        try:
            with FileBytes(path) as file:
                version, size = file.upto(len(VERSION)), file.size
                if version != VERSION:
                    found = version[len(BAG1_MAGIC) - 1 :].decode(errors="replace").strip()
                    raise LogError(
                        f"the bag is of version {found}; version V2.0 is read",
                        where=str(path),
                        fix="bring it up to date with ROS 1's `rosbag fix OLD.bag NEW.bag`",
                    )
                fields = _fields(file)
        except OSError as error:
            raise unreadable(path, error) from error
        except (EndOfBytes, Damaged) as error:
            why = str(error) or "the file ends in it"
            raise _BagWalk.damaged(path, len(VERSION), why) from error
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
        return topics_in_index(_BagWalk(frozenset()), self.path, self.index)

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the file."""
        end = self.index or inf
        return _BagWalk(topics).messages(self.path, len(VERSION), bool(self.index), end)


class _BagWalk(Walk):
    """One pass over the records of a ROS 1 bag."""

    sender, file = "connection", "bag"
    rescue = " with ROS 1's `rosbag reindex` on a copy"
    may_end_damaged = True

    def record(self, file: FileBytes) -> Iterator[Message]:
        fields = _fields(file)
        (length,) = _U32.unpack(file.take(4))
        if fields.get(b"op") == bytes([BAG_CHUNK]):
            end = file.at + length
            packing = fields.get(b"compression", b"").decode(errors="replace")
            yield from self._chunk(file, length, packing, _number(fields, b"size"), end)
            file.skip(end - file.at)
        elif message := self._plain(file, fields, length):
            yield message

    def _inner(self, source: Bytes) -> Message | None:
        fields = _fields(source)
        (length,) = _U32.unpack(source.take(4))
        return self._plain(source, fields, length)

    def _plain(self, source: Bytes, fields: Fields, length: int) -> Message | None:
        code = fields.get(b"op", b"\0")[0]
        if code == BAG_MESSAGE:
            number = _number(fields, b"conn")
            whole, part = struct.unpack("<II", fields.get(b"time", b"").rjust(8, b"\0")[:8])
            if number in self.channels:
                self.counts[number] = self.counts.get(number, 0) + 1
            return self._message(source, number, whole * 1_000_000_000 + part, length)
        if code == BAG_CONNECTION:
            self._connect(_number(fields, b"conn"), fields, self._definition(source, length))
        elif code == BAG_CHUNK_INFO and length <= LONGEST_DEFINITION:
            pairs = source.take(length)
            for number, count in struct.iter_unpack("<II", pairs[: len(pairs) // 8 * 8]):
                self.counts[number] = self.counts.get(number, 0) + count
        elif code in (BAG_HEADER, BAG_INDEX, BAG_CHUNK_INFO):
            source.skip(length)
        else:
            raise Damaged(f"it is of no known kind ({code})")
        return None

    def _connect(self, number: int, fields: Fields, about: bytes) -> None:
        text = {name: value.decode(errors="replace") for name, value in _split(about).items()}
        topic = fields.get(b"topic", b"").decode(errors="replace")
        package, _, name = text.get(b"type", "").rpartition("/")
        self.channels[number] = Channel(
            re.sub("/+", "/", topic) or "/",
            f"{package}/msg/{name}" if package else name,
            "ros1",
            text.get(b"message_definition", ""),
            "ros1msg",
        )


def _fields(source: Bytes) -> Fields:
    """The header of the next record."""
    (length,) = _U32.unpack(source.take(4))
    if length > LONGEST_DEFINITION:
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
