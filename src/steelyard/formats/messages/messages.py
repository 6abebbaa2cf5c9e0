"""What every file of recorded messages can do: hand out its messages, topic by topic."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

LARGEST = 1 << 20
"""Bytes of the longest message that is read; images and point clouds are longer."""


@dataclass(frozen=True)
class Channel:
    """What the messages of one publisher are.

    Attributes:
        topic: Where they were published.
        type: Name of their type, `sensor_msgs/msg/JointState`.
        encoding: How they were put into bytes: `cdr`, `ros1`, `json` or another name.
        definition: The type's definition as found in the file; empty if it has none.
        dialect: Language of the definition: `ros1msg`, `ros2msg`, `ros2idl`; empty if unknown.
    """

    topic: str
    type: str
    encoding: str
    definition: str = ""
    dialect: str = ""


class Message(NamedTuple):
    """One message as recorded.

    Attributes:
        channel: What it is.
        time: When it was recorded [ns].
        data: Its bytes; `None` if it is longer than `LARGEST`.
    """

    channel: Channel
    time: int
    data: bytes | None


class Container(Protocol):
    """A file, or a folder of files, of recorded messages."""

    @property
    def path(self) -> Path:
        """Where it is."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about its state, such as that its end is missing."""
        ...

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages according to the file's index; `None` without one."""
        ...

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the file.

        Raises:
            LogError: The file is damaged.
        """
        ...


@dataclass(frozen=True)
class Topic:
    """One topic of a log of messages, for the user.

    Attributes:
        name: Its name.
        type: Type of its messages.
        count: Number of messages.
        start: When the first was recorded [s].
        stop: When the last was recorded [s].
        problem: Why no columns are read from it; empty if some are.
    """

    name: str
    type: str
    count: int
    start: float
    stop: float
    problem: str

    @property
    def rate(self) -> float:
        """Mean rate of its messages [Hz]; zero for fewer than two."""
        span = self.stop - self.start
        return (self.count - 1) / span if span > 0.0 else 0.0


def seconds(nanoseconds: int) -> float:
    """The float nearest to so many nanoseconds [s].

    Integers of any length are divided with a single rounding, so that a decimal time of up to nine
    places comes back bit for bit.
    """
    return nanoseconds / 1_000_000_000
