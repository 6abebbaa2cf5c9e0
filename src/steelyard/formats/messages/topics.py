"""Which topics a log of messages has, and which numbers their messages hold."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf

from steelyard.errors import LogError
from steelyard.formats.messages.message_fields import MOST_FIELDS, fields_of, is_of_joints, stamp_of
from steelyard.formats.messages.message_types import Unreadable, decoder
from steelyard.formats.messages.messages import LARGEST, Channel, Container, Message, Topic, seconds

STAMP, LOG_TIME = "stamp", "log_time"
LOOKED_AT = 100
"""Messages of each topic that are looked at for its columns."""
ENOUGH = 20_000
"""Messages after which the look ends, if every topic that the file's index names was met."""
MOST_TOPICS = 10_000
MOST_COLUMNS = 50_000


@dataclass(frozen=True)
class Layout:
    """What the messages of a topic hold.

    Attributes:
        name: The topic.
        type: Type of its messages.
        fields: Paths of the numbers in them.
        of_joints: Whether they are joint states.
        stamped: Whether they say when they were measured.
        problem: Why they cannot be read; empty if they can.
    """

    name: str
    type: str
    fields: tuple[str, ...]
    of_joints: bool
    stamped: bool
    problem: str

    @property
    def all_fields(self) -> tuple[str, ...]:
        """The times and the fields; nothing if there are no numbers."""
        return (STAMP, LOG_TIME, *self.fields) if self.fields else ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the topic's columns."""
        return tuple(f"{self.name}/{name}" for name in self.all_fields)


@dataclass
class _Look:
    """What was seen of a topic so far."""

    type: str
    count: int = 0
    fields: dict[str, None] = field(default_factory=dict)
    of_joints: bool = False
    stamped: bool = False
    decoded: int = 0
    problem: str = "its messages hold no numbers"

    def add(self, message: Message) -> None:
        self.count += 1
        if message.data is None:
            self.problem = f"its messages are longer than {LARGEST} bytes"
            return
        try:
            content = decoder(message.channel)(message.data)
        except Unreadable as error:
            self.problem = str(error)
            return
        self.decoded += 1
        self.of_joints |= is_of_joints(content)
        self.stamped |= bool(stamp_of(content))
        if len(self.fields) < MOST_FIELDS:
            self.fields.update(dict.fromkeys(fields_of(content)))

    def layout(self, name: str) -> Layout:
        found = tuple(f for f in self.fields if f not in (STAMP, LOG_TIME))[:MOST_FIELDS]
        if self.of_joints:
            quantities = ("position/", "velocity/", "effort/")
            found = tuple(f for q in quantities for f in found if f.startswith(q))
        problem = "" if found else self.problem
        return Layout(name, self.type, found, self.of_joints, self.stamped, problem)


def scan(container: Container) -> tuple[Layout, ...]:
    """What the topics' first messages hold: joint states first, then by name.

    Columns are the numbers of the first 100 messages of a topic. A topic of which none of these has
    a stamp other than zero is stamped by its log time.

    Raises:
        LogError: The file is damaged, has no messages, or more topics or columns than make sense.
    """
    looks: dict[str, _Look] = {}
    announced = container.announced()
    waiting = None if announced is None else set(announced)
    for total, message in enumerate(container.messages()):
        look = _look(looks, message.channel, container)
        if look.count < LOOKED_AT:
            look.add(message)
        if waiting is not None:
            if total == ENOUGH:
                waiting.difference_update(looks)
            elif total > ENOUGH or look.count == LOOKED_AT:
                waiting.discard(message.channel.topic)
            if not waiting:
                break
    if not looks:
        raise LogError(
            "; ".join(("the log holds no messages", *container.remarks)),
            where=str(container.path),
            fix="record it again",
        )
    layouts = [look.layout(name) for name, look in looks.items()]
    if sum(len(layout.fields) for layout in layouts) > MOST_COLUMNS:
        raise _too_many(container, f"{MOST_COLUMNS} numbers in its messages")
    return tuple(sorted(layouts, key=_rank))


def _rank(layout: Layout) -> tuple[bool, int, str]:
    """Joint states first, those of most joints before others."""
    return not layout.of_joints, -len(layout.fields) if layout.of_joints else 0, layout.name


def _look(looks: dict[str, _Look], channel: Channel, container: Container) -> _Look:
    if channel.topic not in looks:
        if len(looks) == MOST_TOPICS:
            raise _too_many(container, f"{MOST_TOPICS} topics")
        looks[channel.topic] = _Look(channel.type or channel.encoding)
    return looks[channel.topic]


def count_topics(container: Container, layouts: Iterable[Layout]) -> tuple[Topic, ...]:
    """Counts and times of all topics, by a pass over all messages."""
    counts: dict[str, int] = {}
    spans: dict[str, tuple[float, float]] = {}
    for message in container.messages():
        name, time = message.channel.topic, seconds(message.time)
        counts[name] = counts.get(name, 0) + 1
        start, stop = spans.get(name, (inf, -inf))
        spans[name] = min(start, time), max(stop, time)
    return tuple(
        Topic(layout.name, layout.type, counts[layout.name], *spans[layout.name], layout.problem)
        for layout in layouts
        if layout.name in counts
    )


def _too_many(container: Container, what: str) -> LogError:
    return LogError(
        f"the log has more than {what}",
        where=str(container.path),
        fix="copy it again; a log of this kind is damaged or not of a robot",
    )
