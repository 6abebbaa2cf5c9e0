"""The topics of a log of messages, and the paths of the numbers in their messages."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import lru_cache
from itertools import islice
from math import inf, nan
from typing import Any

import numpy as np

from steelyard.base.errors import LogError
from steelyard.logs.messages.containers_and_decoding import (
    LARGEST_MESSAGE,
    Container,
    Message,
    Unreadable,
    decoder,
    seconds,
)

LONGEST_ARRAY = 256  # numbers of the longest array that becomes columns; images and maps have more
MOST_FIELDS = 4096  # numbers of a message that become columns
DEEPEST_FIELD = 16
JOINT_QUANTITIES = ("position", "velocity", "effort")
_TIMES = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"))
_SCALARS = (bool, int, float, np.bool_, np.integer, np.floating)


def fields_of(message: Any) -> tuple[str, ...]:
    """Paths of the numbers in a message; its header and its stamp are left out."""
    names = _joints(message)
    if names is None:
        return tuple(path for path, _ in islice(_flat(message, "", 0), MOST_FIELDS))
    found = []
    for quantity in JOINT_QUANTITIES:
        values = _child(message, quantity)
        count = 0 if values is None else len(values)
        labels = names or [str(i) for i in range(count)]
        found += [f"{quantity}/{name}" for name in dict.fromkeys(labels[:count])]
    return tuple(found[:MOST_FIELDS])


def stamp_of(message: Any) -> float | None:
    """When a message says that it was measured [s]; `None` if it does not."""
    for node in (_child(message, "header"), message):
        for name in ("stamp", "timestamp"):
            if node is not None and (time := _seconds(_child(node, name))) is not None:
                return time
    return None


class Picker:
    """Takes the same fields out of every message."""

    def __init__(self, wanted: Sequence[str]) -> None:
        self._count = len(wanted)
        self._joints = [name.partition("/")[::2] for name in wanted]
        self._names: Any = None
        self._places: dict[str, list[tuple[int, int]]] = {}
        self._groups: dict[tuple[str, ...], list[tuple[int, str]]] = {}
        for k, name in enumerate(wanted):
            *parents, leaf = name.split("/")
            self._groups.setdefault(tuple(parents), []).append((k, leaf))

    def pick(self, message: Any) -> list[float] | None:
        """The fields' values, NaN for those that are not there.

        `None` for a message that is of other joints, as when an arm and its gripper publish on one
        topic.
        """
        names = _joints(message)
        if names is not None:
            return self._of_joints(message, names)
        values = [nan] * self._count
        for parents, leaves in self._groups.items():
            node = message
            for part in parents:
                node = _child(node, part)
            if node is not None:
                for k, leaf in leaves:
                    values[k] = _field_number(_child(node, leaf))
        return values

    def _of_joints(self, message: Any, names: list[str]) -> list[float] | None:
        if names != self._names:
            self._names = list(names)
            at = {name: i for i, name in reversed(list(enumerate(names)))}
            self._places = {}
            for k, (quantity, name) in enumerate(self._joints):
                i = at.get(name) if names else int(name) if name.isdecimal() else None
                if i is not None and quantity in JOINT_QUANTITIES:
                    self._places.setdefault(quantity, []).append((k, i))
        if not self._places:
            return None
        values = [nan] * self._count
        for quantity, places in self._places.items():
            array = _child(message, quantity)
            logged = array.tolist() if isinstance(array, np.ndarray) else array or ()
            for k, i in places:
                if i < len(logged):
                    values[k] = _field_number(logged[i])
        return values


def _joints(message: Any) -> list[str] | None:
    """Names of the joints a message is about, in its order; `None` if it is no joint state."""
    names = _child(message, "name")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return None
    arrays = [_child(message, quantity) for quantity in JOINT_QUANTITIES]
    given = [array for array in arrays if array is not None]
    if not given or not all(isinstance(array, (list, np.ndarray)) for array in given):
        return None
    return names


def _flat(node: Any, path: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Paths and values of the numbers in a message."""
    for name, child in _children(node):
        if depth == 0 and (name == "header" or (name == "stamp" and _seconds(child) is not None)):
            continue
        if isinstance(child, _SCALARS) or _seconds(child) is not None:
            yield path + name, child
        elif isinstance(child, (list, tuple, np.ndarray)):
            inner = list(islice(_flat(child, f"{path}{name}/", depth + 1), LONGEST_ARRAY + 1))
            if len(inner) <= LONGEST_ARRAY:
                yield from inner
        elif depth < DEEPEST_FIELD:
            yield from _flat(child, f"{path}{name}/", depth + 1)


def _children(node: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(node, dict):
        yield from ((name, child) for name, child in node.items() if name and "/" not in name)
    elif is_dataclass(node):
        kind: Any = type(node)
        yield from ((name, getattr(node, name)) for name in _names_of_slots(kind))
    elif isinstance(node, (list, tuple, np.ndarray)) and len(node) <= LONGEST_ARRAY:
        yield from ((str(i), child) for i, child in enumerate(node))


@lru_cache(maxsize=1024)
def _names_of_slots(kind: Any) -> tuple[str, ...]:
    """Names of a message's fields; those with a default are the type's constants."""
    return tuple(field.name for field in fields(kind) if field.default is MISSING)


def _child(node: Any, name: str) -> Any:
    if isinstance(node, dict):
        return node.get(name)
    if isinstance(node, (list, tuple, np.ndarray)):
        return node[int(name)] if name.isdecimal() and int(name) < len(node) else None
    return getattr(node, name, None)


def _field_number(value: Any) -> float:
    """A number as float, a time in seconds; NaN for what is neither."""
    if isinstance(value, float):
        return value
    if isinstance(value, _SCALARS):
        try:
            return float(value)
        except OverflowError:
            return nan
    time = _seconds(value)
    return nan if time is None else time


def _seconds(value: Any) -> float | None:
    if value is None or isinstance(value, (*_SCALARS, str, list, np.ndarray)):
        return None
    for whole, part in _TIMES:
        sec, nsec = _child(value, whole), _child(value, part)
        if isinstance(sec, int) and isinstance(nsec, int):
            if abs(sec) < 1 << 63 and abs(nsec) < 1 << 63:
                return seconds(sec * 1_000_000_000 + nsec)
    return None


STAMP, LOG_TIME = "stamp", "log_time"
MESSAGES_READ_OF_TOPIC = 100  # messages of each topic that are looked at for its columns
MESSAGES_SCANNED = 20_000
"""Messages after which the look ends, if every topic that the file's index names was met."""
MOST_TOPICS = 10_000
MOST_COLUMNS = 50_000


@dataclass(eq=False)
class Layout:
    """What the messages of a topic hold, as far as they were looked at.

    `problem` says why no columns are read from it; it is empty if some are.
    """

    name: str
    type: str
    count: int = 0
    of_joints: bool = False
    stamped: bool = False
    problem: str = "its messages hold no numbers"
    fields: tuple[str, ...] = ()
    _met: dict[str, None] = field(default_factory=dict)

    @property
    def all_fields(self) -> tuple[str, ...]:
        """The times and the fields; nothing if there are no numbers."""
        return (STAMP, LOG_TIME, *self.fields) if self.fields else ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the topic's columns."""
        return tuple(f"{self.name}/{name}" for name in self.all_fields)

    def look_at(self, message: Message) -> None:
        """Take in one of the first messages."""
        self.count += 1
        if message.data is None:
            self.problem = f"its messages are longer than {LARGEST_MESSAGE} bytes"
            return
        try:
            content = decoder(message.channel)(message.data)
        except Unreadable as error:
            self.problem = str(error)
            return
        self.of_joints |= _joints(content) is not None
        self.stamped |= bool(stamp_of(content))
        if len(self._met) < MOST_FIELDS:
            self._met.update(dict.fromkeys(fields_of(content)))

    def settle(self) -> None:
        """Make columns of what was met."""
        found = [f for f in self._met if f not in (STAMP, LOG_TIME)][:MOST_FIELDS]
        if self.of_joints:
            found = [f for q in JOINT_QUANTITIES for f in found if f.startswith(f"{q}/")]
        self.fields = tuple(found)
        self.problem = "" if found else self.problem


def scan_topics(container: Container) -> tuple[Layout, ...]:
    """What the topics' first messages hold: joint states first, of most joints, then by name.

    Columns are the numbers of the first 100 messages of a topic. A topic of which none of these has
    a stamp other than zero is stamped by its log time.
    """
    layouts: dict[str, Layout] = {}
    announced = container.announced()
    waiting = None if announced is None else set(announced)
    for total, message in enumerate(container.messages()):
        channel = message.channel
        if channel.topic not in layouts:
            if len(layouts) == MOST_TOPICS:
                raise _too_many(container, f"{MOST_TOPICS} topics")
            layouts[channel.topic] = Layout(channel.topic, channel.type or channel.encoding)
        layout = layouts[channel.topic]
        if layout.count < MESSAGES_READ_OF_TOPIC:
            layout.look_at(message)
        if waiting is not None:
            if total == MESSAGES_SCANNED:
                waiting.difference_update(layouts)
            elif total > MESSAGES_SCANNED or layout.count == MESSAGES_READ_OF_TOPIC:
                waiting.discard(channel.topic)
            if not waiting:
                break
    if not layouts:
        raise LogError(
            "; ".join(("the log holds no messages", *container.remarks)),
            where=str(container.path),
            fix="record it again",
        )
    for layout in layouts.values():
        layout.settle()
    if sum(len(layout.fields) for layout in layouts.values()) > MOST_COLUMNS:
        raise _too_many(container, f"{MOST_COLUMNS} numbers in its messages")
    joints = {x: len(x.fields) * x.of_joints for x in layouts.values()}
    return tuple(sorted(joints, key=lambda x: (not x.of_joints, -joints[x], x.name)))


def count_topics(container: Container, layouts: Iterable[Layout]) -> tuple[dict[str, Any], ...]:
    """Counts and mean rates [Hz] of all topics, by a pass over all messages, as JSON values."""
    found: dict[str, tuple[int, float, float]] = {}
    for message in container.messages():
        name, time = message.channel.topic, seconds(message.time)
        count, start, stop = found.get(name, (0, inf, -inf))
        found[name] = count + 1, min(start, time), max(stop, time)
    topics = []
    for layout in (one for one in layouts if one.name in found):
        count, start, stop = found[layout.name]
        rate = (count - 1) / (stop - start) if stop > start else 0.0
        topics.append({"name": layout.name, "type": layout.type, "count": count, "rate": rate})
        topics[-1]["problem"] = layout.problem
    return tuple(topics)


def _too_many(container: Container, what: str) -> LogError:
    return LogError(
        f"the log has more than {what}",
        where=str(container.path),
        fix="copy it again; a log of this kind is damaged or not of a robot",
    )
