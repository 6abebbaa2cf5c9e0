"""Messages in files of records, MCAP and ROS 1 bags, with or without chunks, index and end.

The records are read from front to back, as that also works for a file whose recorder lost power or
was killed (`.bag.active`): every chunk says itself what its messages are. `mcap.stream_reader` does
so too, but believes what a chunk declares: 10 kB that stand for 300 MiB take it 600 MiB, and 73
bytes make it ask for 1.9 GiB. `rosbags.rosbag1.Reader` needs an index.
"""

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from math import inf
from pathlib import Path
from typing import Any, ClassVar
from zlib import crc32

from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import reading
from steelyard.logs.messages.containers_and_decoding import LARGEST_MESSAGE, Channel, Message
from steelyard.logs.messages.decompression import (
    LARGEST_CHUNK,
    ByteSource,
    Damaged,
    EndOfBytes,
    require_plausible,
    unpacked,
)

LONGEST_DEFINITION = 1 << 20  # bytes of the longest header or definition that is read
DEFINITION_BYTES = 1 << 24  # bytes of all definitions together


class Walk:
    """One pass over the records of a file.

    It knows the channels met so far by their number, the messages per channel as far as the file
    states them or they were met, and whether the last record of data was met.
    """

    sender: ClassVar[str]
    file: ClassVar[str]
    cut: ClassVar[str]
    rescue: ClassVar[str]
    may_end_damaged: ClassVar[bool] = False

    def __init__(self, topics: frozenset[str] | None) -> None:
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}
        self.ended = False
        self._topics = topics
        self._definitions = self._unpacked = 0

    def record(self, file: ByteSource) -> Iterator[Message]:
        """The messages in the next record of a file."""
        raise NotImplementedError

    def _head(self, source: ByteSource) -> tuple[Any, int]:
        """What the next record says of itself, and the length of its content."""
        raise NotImplementedError

    def _plain(self, source: ByteSource, head: Any, length: int) -> Message | None:
        """The message in a record that is no chunk, if there is one."""
        raise NotImplementedError

    @classmethod
    def damaged(cls, path: Path, at: int, why: str) -> LogError:
        """The error for a record that makes no sense."""
        return LogError(
            f"the {cls.file} is damaged: the record at byte {at} cannot be read, {why}",
            where=f"{path}, byte {at}",
            fix=f"copy it again, or save what is left of it{cls.rescue}",
        )

    def _chunk(
        self, file: ByteSource, length: int, packing: str, size: int, end: int, checksum: int = 0
    ) -> Iterator[Message]:
        """The messages in `length` bytes that unpack to `size`, in a record that ends at `end`."""
        if max(length, size) > LARGEST_CHUNK:
            raise Damaged(f"it is a chunk of {max(length, size):,} bytes, above {LARGEST_CHUNK:,}")
        packed = file.upto(length)
        self._unpacked += size
        require_plausible(self._unpacked, file.at)
        content = unpacked(packing, packed, size + 1)
        if len(content) > size:
            raise Damaged("it unpacks to more than it declares")
        if checksum and len(content) == size and crc32(content) != checksum:
            raise Damaged("its checksum is not that of its content")
        source = ByteSource(BytesIO(content))
        try:
            while source.at < size:
                if message := self._plain(source, *self._head(source)):
                    yield message
        except EndOfBytes:
            if end <= file.size:
                raise Damaged("its content ends early") from None
            raise
        file.skip(end - file.at)

    def _message(self, source: ByteSource, number: int, time: int, length: int) -> Message | None:
        channel = self.channels.get(number)
        if channel is None:
            raise Damaged(f"it is a message of {self.sender} {number}, which was not announced")
        wanted = self._topics is None or channel.topic in self._topics
        if wanted and length <= LARGEST_MESSAGE:
            return Message(channel, time, source.take(length))
        source.skip(length)
        return Message(channel, time, None) if wanted else None

    def _definition(self, source: ByteSource, length: int) -> bytes:
        self._definitions += length
        if length > LONGEST_DEFINITION or self._definitions > DEFINITION_BYTES:
            raise Damaged(f"it is a definition of {length:,} bytes")
        return source.take(length)


@dataclass(frozen=True)
class RecordFile:
    """One file of records."""

    path: Path
    content: Path  # the file itself, or its unpacked copy
    walk: "type[Walk]"
    start: int  # byte at which its messages start; they end at `end`, if not where they say so
    # first byte of its index and the one after its last; `None` if it has none
    index: tuple[int, int] | None
    whole: bool  # whether its end is there, so that nothing of it may be missing
    end: float = inf
    waiting: Callable[[], bool] | None = None  # see `ByteSource`

    @property
    def remarks(self) -> tuple[str, ...]:
        """Whether its end is missing."""
        return () if self.whole else (f"{self.walk.cut}; it is read up to where it ends",)

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages according to the index; `None` without one."""
        if self.index is None:
            return None
        walk = self.walk(frozenset())
        try:
            with ByteSource.of_file(self.content, self.index[0]) as file:
                while file.at < self.index[1]:
                    for _ in walk.record(file):
                        pass
        except (OSError, EndOfBytes, Damaged):
            return None
        met = {channel.topic for i, channel in walk.channels.items() if walk.counts.get(i)}
        return frozenset(met) if walk.counts else None

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the file."""
        walk, at = self.walk(topics), self.start
        try:
            with reading(self.path), ByteSource.of_file(self.content, at, self.waiting) as file:
                while not walk.ended and file.at < self.end:
                    at = file.at
                    yield from walk.record(file)
        except EndOfBytes:
            if self.whole:
                raise walk.damaged(self.path, at, "it claims to be longer than it is") from None
        except Damaged as error:
            if self.whole or not (walk.may_end_damaged and walk.counts):
                raise walk.damaged(self.path, at, str(error)) from error


MCAP_MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")
CHUNK_HEAD = struct.Struct("<QQQII")
MESSAGE_HEAD = struct.Struct("<HIQQ")
FOOTER_BYTES = 9 + 20 + len(MCAP_MAGIC)
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 11, 15


def open_mcap(path: Path, content: Path) -> RecordFile:
    """Look at both ends of a file that starts as MCAP files do; `content`: see `RecordFile`."""
    start, index, whole = len(MCAP_MAGIC), None, False
    with reading(path), ByteSource.of_file(content) as file:
        end = file.size - FOOTER_BYTES
        if end >= 0:
            file.skip(end)
            code, _, first, _, _, magic = struct.unpack("<BQQQI8s", file.take(FOOTER_BYTES))
            whole = magic == MCAP_MAGIC
            if whole and code == FOOTER and 0 < first < end:
                index = first, end
    return RecordFile(path, content, _McapWalk, start, index, whole)


class _McapWalk(Walk):
    sender, file, cut = "channel", "file", "the recording was cut off"
    rescue = ": `mcap recover IN.mcap -o OUT.mcap`"

    def __init__(self, topics: frozenset[str] | None) -> None:
        super().__init__(topics)
        self._schemas: dict[int, tuple[str, str, str]] = {}

    def _head(self, source: ByteSource) -> tuple[int, int]:
        code, length = RECORD_HEAD.unpack(source.take(RECORD_HEAD.size))
        return code, length

    def record(self, file: ByteSource) -> Iterator[Message]:
        code, length = self._head(file)
        if code == CHUNK:
            yield from self._packed(file, length, file.at + length)
        elif code in (DATA_END, FOOTER):
            self.ended = True
        elif code == 0:
            # What a file system leaves of a block that was never written.
            raise EndOfBytes if length == 0 else Damaged("it is of no known kind")
        elif message := self._plain(file, code, length):
            yield message

    def _packed(self, file: ByteSource, length: int, end: int) -> Iterator[Message]:
        if length < CHUNK_HEAD.size + 8:
            raise Damaged("it is too short for a chunk")
        _, _, size, checksum, name = CHUNK_HEAD.unpack(file.take(CHUNK_HEAD.size))
        if name > 20:
            raise Damaged("its compression has no name")
        packing = file.take(name).decode(errors="replace")
        (stored,) = struct.unpack("<Q", file.take(8))
        if file.at + stored > end:
            raise Damaged("its content is longer than itself")
        return self._chunk(file, stored, packing, size, end, checksum)

    def _plain(self, source: ByteSource, head: int, length: int) -> Message | None:
        if head == MESSAGE:
            if length < MESSAGE_HEAD.size:
                raise Damaged("it is too short for a message")
            number, _, time, _ = MESSAGE_HEAD.unpack(source.take(MESSAGE_HEAD.size))
            return self._message(source, number, time, length - MESSAGE_HEAD.size)
        if head in (SCHEMA, CHANNEL, STATISTICS):
            self._define(head, self._definition(source, length))
        else:
            source.skip(length)
        return None

    def _define(self, code: int, body: bytes) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.exceptions import McapError
        from mcap.records import Channel as ChannelRecord
        from mcap.records import Schema, Statistics

        stream = ReadDataStream(BytesIO(body))
        try:
            if code == SCHEMA:
                schema = Schema.read(stream)
                text = schema.data.decode(errors="replace")
                self._schemas[schema.id] = schema.name, schema.encoding, text
            elif code == CHANNEL:
                own = ChannelRecord.read(stream)
                name, dialect, text = self._schemas.get(own.schema_id, ("", "", ""))
                channel = Channel(own.topic, name, own.message_encoding, text, dialect)
                self.channels[own.id] = channel
            else:
                self.counts = Statistics.read(stream).channel_message_counts
        except (McapError, struct.error, ValueError) as error:
            raise Damaged(f"it is a definition that cannot be read ({error})") from error


BAG1_MAGIC = b"#ROSBAG V"
VERSION = b"#ROSBAG V2.0\n"
BAG_MESSAGE, BAG_HEADER, BAG_INDEX, BAG_CHUNK, BAG_CHUNK_INFO, BAG_CONNECTION = 2, 3, 4, 5, 6, 7
_U32 = struct.Struct("<I")
Fields = dict[bytes, bytes]


def open_bag1(path: Path) -> RecordFile:
    """Read the header of a file that starts as ROS 1 bags do."""
    try:
        with reading(path), ByteSource.of_file(path) as file:
            version, size = file.upto(len(VERSION)), file.size
            if version != VERSION:
                found = version[len(BAG1_MAGIC) - 1 :].decode(errors="replace").strip()
                raise LogError(
                    f"the bag is of version {found}; version V2.0 is read",
                    where=str(path),
                    fix="bring it up to date with ROS 1's `rosbag fix OLD.bag NEW.bag`",
                )
            fields = _fields(file)
    except (EndOfBytes, Damaged) as error:
        raise _BagWalk.damaged(path, len(VERSION), str(error) or "the file ends in it") from error
    if name := fields.get(b"encryptor"):
        raise LogError(
            f"the bag is encrypted by {name.decode(errors='replace')}",
            where=str(path),
            fix="decrypt it with `rosbag decrypt` first",
        )
    at = int.from_bytes(fields.get(b"index_pos", b""), "little")
    if not 0 < at <= size:
        return RecordFile(path, path, _BagWalk, len(VERSION), None, False)
    return RecordFile(path, path, _BagWalk, len(VERSION), (at, size), True, at)


class _BagWalk(Walk):
    sender, file, cut = "connection", "bag", "the bag has no index: it was not closed"
    rescue = " with ROS 1's `rosbag reindex` on a copy"
    may_end_damaged = True

    def _head(self, source: ByteSource) -> tuple[Fields, int]:
        return _fields(source), _U32.unpack(source.take(4))[0]

    def record(self, file: ByteSource) -> Iterator[Message]:
        fields, length = self._head(file)
        if fields.get(b"op") == bytes([BAG_CHUNK]):
            packing = fields.get(b"compression", b"").decode(errors="replace")
            size = _number(fields, b"size")
            yield from self._chunk(file, length, packing, size, file.at + length)
        elif message := self._plain(file, fields, length):
            yield message

    def _plain(self, source: ByteSource, head: Fields, length: int) -> Message | None:
        code = head.get(b"op", b"\0")[0]
        if code == BAG_MESSAGE:
            number = _number(head, b"conn")
            whole, part = struct.unpack("<II", head.get(b"time", b"").rjust(8, b"\0")[:8])
            if number in self.channels:
                self.counts[number] = self.counts.get(number, 0) + 1
            return self._message(source, number, whole * 1_000_000_000 + part, length)
        if code == BAG_CONNECTION:
            self._connect(_number(head, b"conn"), head, self._definition(source, length))
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
        topic = re.sub("/+", "/", fields.get(b"topic", b"").decode(errors="replace")) or "/"
        package, _, name = text.get(b"type", "").rpartition("/")
        kind = f"{package}/msg/{name}" if package else name
        definition = text.get(b"message_definition", "")
        self.channels[number] = Channel(topic, kind, "ros1", definition, "ros1msg")


def _fields(source: ByteSource) -> Fields:
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
