"""Recorded messages (MCAP, ROS 2 and ROS 1 bags) as a table, aligned to the rows of one topic.

The columns are `<topic>/<path of a number in the message>`, for joint states
`<topic>/position/<joint>`, and for every topic `<topic>/stamp` (when the message says that it was
measured) and `<topic>/log_time` (when it was recorded) [s]. The rows are the messages of the topic
of the first requested column, in the order of the file. Columns of other topics are interpolated at
the stamps of these rows (`Track`), or at their log times if the first column is a log time.

Every requested topic is a pass of its own over the file, so that memory does not grow however the
topics are interleaved.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import chain, islice, pairwise
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import (
    ROWS_OF_PART,
    RowRange,
    require_columns,
    require_file,
)
from steelyard.logs.messages.containers_and_decoding import (
    Channel,
    Container,
    Decoder,
    Unreadable,
    decoder,
    seconds,
)
from steelyard.logs.messages.mcap_and_ros1_bag import BAG1_MAGIC, open_bag1
from steelyard.logs.messages.ros2_bag import Bag2, first_bytes, storage
from steelyard.logs.messages.topics_and_message_fields import (
    LOG_TIME,
    STAMP,
    Layout,
    Picker,
    count_topics,
    scan_topics,
    stamp_of,
)

SAMPLES_FOR_USUAL_STEP = 200  # samples from which a topic's usual step is learnt
FARTHEST_NEIGHBOUR = 10.0
"""Usual steps between two samples beyond which nothing is known between them."""
SAMPLES_KEPT_BEHIND = 64  # samples behind the rows that are kept for rows a little out of order

Sample = tuple[float, Array]  # a stamp [s] and values


class Track:
    r"""Values of one topic at the stamps of another, linearly interpolated.

    $v(t) = v_k + (t - t_k)/(t_{k+1} - t_k)\,(v_{k+1} - v_k)$ for $t_k \le t \le t_{k+1}$; NaN
    before the first sample, after the last, and between two that are further apart than ten of the
    topic's usual steps. Samples that are not newer than the one before them, or newer than the one
    after them, are passed over. At most `SAMPLES_KEPT_BEHIND` samples are in memory, however long
    the topic pauses.
    """

    def __init__(self, samples: Iterator[Sample], width: int) -> None:
        forward = _forward(samples)
        head = list(islice(forward, SAMPLES_FOR_USUAL_STEP))
        steps = np.diff([t for t, _ in head])
        self._far = FARTHEST_NEIGHBOUR * float(np.median(steps)) if len(steps) else 0.0
        self._samples = chain(head, forward)
        self._unknown = np.full(width, np.nan)
        self._times: deque[float] = deque(maxlen=SAMPLES_KEPT_BEHIND)
        self._values: deque[Array] = deque(maxlen=SAMPLES_KEPT_BEHIND)

    def at(self, t: float, reach: float) -> Array:
        """Values at a stamp, `(width,)`; samples behind `reach`, where rows are, are forgotten."""
        times = self._times
        while not times or times[-1] < reach:
            sample = next(self._samples, None)
            if sample is None:
                break
            times.append(sample[0])
            self._values.append(sample[1])
        if not times or not times[0] <= t <= times[-1]:
            return self._unknown
        k = bisect_left(times, t)
        if times[k] == t:
            return self._values[k]
        step = times[k] - times[k - 1]
        if step > self._far:
            return self._unknown
        before = self._values[k - 1]
        return before + (t - times[k - 1]) / step * (self._values[k] - before)


def _forward(samples: Iterator[Sample]) -> Iterator[Sample]:
    """Samples whose stamps rise, without those that a later one contradicts."""
    last = -np.inf
    current = next(samples, None)
    while current is not None:
        following = next(samples, None)
        if last < current[0] and (following is None or not current[0] > following[0]):
            last = current[0]
            yield current
        current = following


_NOTHING = np.zeros(0)


@dataclass(frozen=True)
class MessageLog:
    """A log of messages as a table; see the module.

    A value that a message lacks is NaN, as is the row of a message that cannot be decoded. A joint
    state with none of the requested joints, as of a gripper that shares the topic, is no row.
    """

    path: Path
    columns: tuple[str, ...]
    container: Container = field(repr=False)
    layouts: tuple[Layout, ...] = field(repr=False)

    @classmethod
    def open(cls, path: Path) -> "MessageLog":
        """Look at the first messages of every topic of a file, or of a ROS 2 bag's folder."""
        container = _container(path)
        layouts = scan_topics(container)
        columns = tuple(chain.from_iterable(layout.columns for layout in layouts))
        if not columns:
            raise LogError(
                f"no topic of the log holds numbers that can be read: {_listing(layouts)}",
                where=str(path),
                fix="record sensor_msgs/msg/JointState, or another topic with numbers in it",
            )
        return cls(path, columns, container, layouts)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about the file's state, such as that its end is missing."""
        return self.container.remarks

    @cached_property
    def topics(self) -> tuple[dict[str, Any], ...]:
        """Its topics as JSON values, by a pass over the whole file on first use."""
        return count_topics(self.container, self.layouts)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        for column in set(columns).difference(self.columns):
            for layout in self.layouts:
                if layout.problem and column.startswith(f"{layout.name}/"):
                    raise LogError(
                        f"the topic '{layout.name}' cannot be read: {layout.problem}",
                        where=str(self.path),
                        fix="record it with its definition, or name columns of another topic",
                    )
        require_columns(self.path, self.columns, columns)
        found = self._rows(columns, rows)
        while part := list(islice(found, size)):
            yield np.array(part)

    def _rows(self, columns: Sequence[str], rows: RowRange) -> Iterator[Array]:
        """Consecutive rows, each `(len(columns),)`."""
        wanted = enumerate(self._places[column] for column in columns)
        by_topic = by_key((layout, (k, name)) for k, (layout, name) in wanted)
        (base, places), *others = by_topic.items()
        clock = LOG_TIME if places[0][1] == LOG_TIME else STAMP
        read = partial(_samples, self.container, clock=clock)
        samples = islice(read(base, [f for _, f in places]), *rows)
        tracks = [
            ([k for k, _ in wanted], Track(read(layout, [f for _, f in wanted]), len(wanted)))
            for layout, wanted in others
        ]
        own = [k for k, _ in places]
        reach = -np.inf
        for (t, values), (later, _) in pairwise(chain(samples, ((nan, _NOTHING),))):
            row = np.empty(len(columns))
            row[own] = values
            reach = max(reach, min(t, later) if isfinite(later) else t)
            for at, track in tracks:
                row[at] = track.at(t, reach)
            yield row

    @cached_property
    def _places(self) -> dict[str, tuple[Layout, str]]:
        return {
            f"{layout.name}/{name}": (layout, name)
            for layout in self.layouts
            for name in layout.all_fields
        }


def _container(path: Path) -> Container:
    """The messages in a file or folder, by what it is and not by its suffix."""
    if path.is_dir():
        return Bag2.open(path)
    require_file(path)
    return open_bag1(path) if first_bytes(path).startswith(BAG1_MAGIC) else storage(path)


def _samples(
    container: Container, layout: Layout, wanted: Sequence[str], *, clock: str
) -> Iterator[Sample]:
    """Stamp and values of a topic's messages, those of other joints aside."""
    own = [k for k, name in enumerate(wanted) if name not in (STAMP, LOG_TIME)]
    picker = Picker([wanted[k] for k in own])
    decoders: dict[int, tuple[Channel, Decoder]] = {}  # with the channel: no other gets its id
    for message in container.messages(frozenset((layout.name,))):
        times = {LOG_TIME: seconds(message.time), STAMP: nan}
        values = np.full(len(wanted), nan)
        content, channel = None, message.channel
        with suppress(Unreadable):
            if id(channel) not in decoders:
                decoders[id(channel)] = channel, decoder(channel)
            if message.data is not None:
                content = decoders[id(channel)][1](message.data)
        if content is not None:
            picked = picker.pick(content) if own else []
            if picked is None:
                continue
            values[own] = picked
            signature = stamp_of(content) if layout.stamped else times[LOG_TIME]
            times[STAMP] = nan if signature is None else signature
        for k, name in enumerate(wanted):
            if name in times:
                values[k] = times[name]
        yield times[clock], values


def _listing(layouts: Sequence[Layout]) -> str:
    shown = [
        f"{one.name} ({': '.join(filter(None, (one.type or 'no type', one.problem)))})"
        for one in layouts[:12]
    ]
    return "; ".join(shown + [f"and {len(layouts) - 12} more"] * (len(layouts) > 12))
