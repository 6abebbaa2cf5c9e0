"""What a file of recorded messages can do, and how messages are decoded by their types."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

LARGEST_MESSAGE = 1 << 20
"""Bytes of the longest message that is read; images and point clouds are longer."""


@dataclass(frozen=True)
class Channel:
    """What the messages of one publisher are: of a type such as `sensor_msgs/msg/JointState`.

    The encoding is `cdr`, `ros1`, `json` or another name; the type's definition is as found in the
    file, in the language `ros1msg`, `ros2msg` or `ros2idl`; both are empty if unknown.
    """

    topic: str
    type: str
    encoding: str
    definition: str = ""
    dialect: str = ""


class Message(NamedTuple):
    """A message, when it was recorded [ns], and its bytes; `None`: more than `LARGEST_MESSAGE`."""

    channel: Channel
    time: int
    data: bytes | None


class Container(Protocol):
    """A file, or a folder of files, of recorded messages."""

    @property
    def path(self) -> Path:
        """Where it is."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about its state, such as that its end is missing."""

    def announced(self) -> frozenset[str] | None:
        """Topics that have messages according to the file's index; `None` without one."""

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Messages of some topics, or of all, in the order of the file; damage is a `LogError`."""


def seconds(nanoseconds: int) -> float:
    """The float nearest to so many nanoseconds [s].

    Integers of any length are divided with a single rounding, so that a decimal time of up to nine
    places comes back bit for bit.
    """
    return nanoseconds / 1_000_000_000


DEEPEST_TYPE, LONGEST_TYPE_DEFINITION, LARGEST_TYPE = 64, 1 << 18, 1 << 16
"""Types inside types, characters of a definition, and values that a type holds at least."""
NO_NUMBER = 64  # values that a text or a type inside counts as: code is made for each of them
SHIFT = re.compile(r"<<(?!\s*\d{1,2}\b)")
"""A shift in IDL by more than two digits can say: the constant would fill the memory."""
LONGEST_SEQUENCE = 1 << 16
Decoder = Callable[[bytes], Any]


class Unreadable(Exception):
    """Bytes or a type that cannot be understood; says why."""


@lru_cache(maxsize=64)
def decoder(channel: Channel) -> Decoder:
    """What turns the bytes of a channel's messages into messages with named fields."""
    if channel.encoding == "json":
        return _guarded(json.loads)
    if channel.encoding not in ("cdr", "ros1"):
        raise Unreadable(f"the encoding '{channel.encoding}' is not read; cdr, ros1 and json are")
    store = _store(channel)
    _require_small(store, channel)
    name = channel.type
    read = store.deserialize_ros1 if channel.encoding == "ros1" else store.deserialize_cdr
    return _guarded(lambda data: read(data, name))


def _guarded(decode: Decoder) -> Decoder:
    def decoded(data: bytes) -> Any:
        try:
            return decode(data)
        except Exception as error:  # foreign code on foreign bytes
            raise Unreadable(_error_text(error)) from error

    return decoded


def _error_text(error: Exception) -> str:
    return str(error).partition("\n")[0][:200] or type(error).__name__


def _store(channel: Channel) -> "Typestore":
    from rosbags.typesys import Stores, get_typestore

    if not channel.definition.strip():
        store = get_typestore(Stores.ROS1_NOETIC if channel.encoding == "ros1" else Stores.LATEST)
        if channel.type not in store.fielddefs:
            raise Unreadable(f"the type '{channel.type}' is not defined in the file")
    else:
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(_parsed(channel))
        except Exception as error:  # foreign code on foreign text
            raise Unreadable(
                f"its definition cannot be understood ({_error_text(error)})"
            ) from error
    store.max_sequence_length = LONGEST_SEQUENCE
    return store


def _parsed(channel: Channel) -> "Typesdict":
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    text = channel.definition.replace("\r\n", "\n")
    if len(text) > LONGEST_TYPE_DEFINITION:
        raise ValueError(f"it has {len(text):,} characters")
    if channel.dialect in ("ros1msg", "ros2msg"):
        return get_types_from_msg(text, channel.type)
    if channel.dialect not in ("ros2idl", "omgidl"):
        raise ValueError(f"its language '{channel.dialect}' is not read")
    if SHIFT.search(text):
        raise ValueError("it shifts a constant by more than 99 bits, or by another constant")
    line = "=" * 80 + "\n"
    if not text.startswith(f"{line}IDL: "):
        return get_types_from_idl(text)
    types: Typesdict = {}
    for part in text.split(line)[1:]:
        types.update(get_types_from_idl(part.partition("\n")[2]))
    return types


def _require_small(store: "Typestore", channel: Channel) -> None:
    """Check a type before code is made for it."""
    from rosbags.interfaces import Nodetype

    known: dict[str, tuple[int, bool]] = {}

    def of_type(name: str, depth: int) -> tuple[int, bool]:
        """How many values a type holds at least, and whether it may need no bytes at all."""
        if depth > DEEPEST_TYPE:
            raise Unreadable(f"the type '{channel.type}' contains itself")
        if name not in store.fielddefs:
            raise Unreadable(f"the definition of '{channel.type}' lacks the type '{name}'")
        if name not in known:
            fields: Any = store.fielddefs[name][1]
            found = {field: of_field(kind, inner, depth) for field, (kind, inner) in fields}
            size = sum(size for size, _ in found.values())
            if size > LARGEST_TYPE:
                raise Unreadable(f"the type '{name}' holds more than {LARGEST_TYPE} values")
            found.pop("structure_needs_at_least_one_member", None)
            known[name] = size, all(empty for _, empty in found.values())
        return known[name]

    def of_field(kind: Any, content: Any, depth: int) -> tuple[int, bool]:
        if kind == Nodetype.BASE:
            return (NO_NUMBER if content[0] in ("string", "wstring") else 1), False
        if kind == Nodetype.NAME:
            size, empty = of_type(content, depth + 1)
            return max(size, NO_NUMBER), empty
        (inner, of), length = content
        size, empty = of_field(inner, of, depth)
        if kind == Nodetype.ARRAY:
            return size * int(length), empty or int(length) == 0
        if empty:
            raise Unreadable(f"the type '{channel.type}' has a sequence of nothing")
        return 1, False

    try:
        of_type(channel.type, 0)
    except RecursionError as error:
        raise Unreadable(f"the type '{channel.type}' contains itself") from error
