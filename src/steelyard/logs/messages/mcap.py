"""Messages in MCAP files, with or without chunks, index and end.

The records are read from front to back, as that also works for a file whose recorder lost power.
`mcap.stream_reader` does so too, but unpacks a chunk whole, whatever the limit of a record: 10 kB
that stand for 300 MiB take it 600 MiB, and 73 bytes make it ask for 1.9 GiB.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from steelyard.base.errors import LogError
from steelyard.logs.messages.byte_streams import (
    Budget,
    Bytes,
    Damaged,
    EndOfBytes,
    FileBytes,
    GrowingBytes,
    UnpackedBytes,
)
from steelyard.logs.messages.messages import LARGEST_MESSAGE, Channel, Message

MCAP_MAGIC = b"\x89MCAP0\r\n"
LONGEST_MCAP_DEFINITION = 1 << 20
"""Bytes of the longest definition that is read."""
MCAP_DEFINITION_BYTES = 1 << 24
"""Bytes of all definitions together."""
CHUNK_HEAD = struct.Struct("<QQQII")
MESSAGE_HEAD = struct.Struct("<HIQQ")
FOOTER = 9 + 20 + len(MCAP_MAGIC)
SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS, DATA_END, FOOTER_CODE = 3, 4, 5, 6, 11, 15, 2


@dataclass(frozen=True)
class McapFile:
    """One MCAP file.

    Attributes:
        path: Where it is.
        complete: Whether its end is there.
        waiting: If the file is still being written, called while bytes are missing; see
            `GrowingBytes`.
    """

    path: Path
    complete: bool
    waiting: Callable[[], bool] | None = None

    @classmethod
    def open(cls, path: Path) -> "McapFile":
        """Look at both ends of a file that starts as MCAP files do.

        Raises:
            LogError: It cannot be read.
        """
        try:
            with FileBytes(path) as file:
                file.skip(max(file.size - len(MCAP_MAGIC), 0))
                return cls(path, file.size >= FOOTER and file.upto(len(MCAP_MAGIC)) == MCAP_MAGIC)
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
        walk = _Walk(frozenset())
        try:
            with FileBytes(self.path) as file:
                file.skip(max(file.size - FOOTER, 0))
                code, _, start, _, _ = struct.unpack("<BQQQI", file.take(FOOTER - len(MCAP_MAGIC)))
                end = file.size - FOOTER
            if not self.complete or code != FOOTER_CODE or not 0 < start < end:
                return None
            with FileBytes(self.path, start) as file:
                while file.at < end:
                    for _ in walk.record(file):
                        pass
        except (OSError, EndOfBytes, Damaged):
            return None
        if not walk.counts:
            return None
        return frozenset(
            channel.topic for i, channel in walk.channels.items() if walk.counts.get(i)
        )

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the file."""
        walk = _Walk(topics)
        at = 0
        try:
            with self._bytes() as file:
                file.skip(len(MCAP_MAGIC))
                while not walk.ended:
                    at = file.at
                    yield from walk.record(file)
        except OSError as error:
            raise unreadable(self.path, error) from error
        except EndOfBytes:
            if self.complete:
                raise damaged(self.path, at, "it claims to be longer than it is") from None
        except Damaged as error:
            raise damaged(self.path, at, str(error)) from error

    def _bytes(self) -> FileBytes:
        if self.waiting is None:
            return FileBytes(self.path)
        return GrowingBytes(self.path, self.waiting)


class _Walk:
    """One pass over the records of a file.

    Attributes:
        channels: Channels met so far, by their number.
        counts: Messages per channel, if the file states them.
        ended: Whether the last record of data was met.
    """

    def __init__(self, topics: frozenset[str] | None) -> None:
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}
        self.ended = False
        self._topics = topics
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._definitions = 0
        self._budget = Budget()

    def record(self, file: FileBytes) -> Iterator[Message]:
        """The messages in the next record of a file."""
        code, length = struct.unpack("<BQ", file.take(9))
        if code == CHUNK:
            end = file.at + length
            yield from self._chunk(file, length)
            file.skip(end - file.at)
        elif code in (DATA_END, FOOTER_CODE):
            self.ended = True
        elif code == 0:
            # What a file system leaves of a block that was never written.
            raise EndOfBytes if length == 0 else Damaged("it is of no known kind")
        elif message := self._small(file, code, length):
            yield message

    def _chunk(self, file: FileBytes, length: int) -> Iterator[Message]:
        start = file.at
        if length < CHUNK_HEAD.size + 8:
            raise Damaged("it is too short for a chunk")
        _, _, size, checksum, name = CHUNK_HEAD.unpack(file.take(CHUNK_HEAD.size))
        if name > 20:
            raise Damaged("its compression has no name")
        packing = file.take(name).decode(errors="replace")
        (stored,) = struct.unpack("<Q", file.take(8))
        if file.at - start + stored > length:
            raise Damaged("its content is longer than itself")
        content = UnpackedBytes(file, stored, packing, size, self._budget)
        try:
            while not content.ended:
                code, inner = struct.unpack("<BQ", content.take(9))
                if message := self._small(content, code, inner):
                    yield message
        except EndOfBytes:
            if start + length <= file.size:
                raise Damaged("its content ends early") from None
            raise
        if checksum and content.checksum != checksum:
            raise Damaged("its checksum is not that of its content")

    def _small(self, source: Bytes, code: int, length: int) -> Message | None:
        if code == MESSAGE:
            return self._message(source, length)
        if code not in (SCHEMA, CHANNEL, STATISTICS):
            source.skip(length)
            return None
        self._definitions += length
        if length > LONGEST_MCAP_DEFINITION or self._definitions > MCAP_DEFINITION_BYTES:
            raise Damaged(f"it is a definition of {length:,} bytes")
        self._define(code, source.take(length))
        return None

    def _message(self, source: Bytes, length: int) -> Message | None:
        if length < MESSAGE_HEAD.size:
            raise Damaged("it is too short for a message")
        number, _, time, _ = MESSAGE_HEAD.unpack(source.take(MESSAGE_HEAD.size))
        channel = self.channels.get(number)
        length -= MESSAGE_HEAD.size
        if channel is None:
            raise Damaged(f"it is a message of channel {number}, which was not announced")
        if self._topics is not None and channel.topic not in self._topics:
            source.skip(length)
            return None
        if length > LARGEST_MESSAGE:
            source.skip(length)
            return Message(channel, time, None)
        return Message(channel, time, source.take(length))

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


def damaged(path: Path, at: int, why: str) -> LogError:
    """The error for a record that makes no sense."""
    return LogError(
        f"the file is damaged: the record at byte {at} cannot be read, {why}",
        where=f"{path}, byte {at}",
        fix="copy it again, or save what is left of it: `mcap recover IN.mcap -o OUT.mcap`",
    )


def unreadable(path: Path, error: OSError) -> LogError:
    """The error for a file that the system does not hand out."""
    return LogError(
        f"the log cannot be read ({error.strerror or error})",
        where=str(path),
        fix="check the file's permissions and the disk",
    )
