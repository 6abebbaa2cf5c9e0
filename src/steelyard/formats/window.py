"""A window of a log as it was recorded: rows between two times, or two row numbers."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os.path import commonprefix

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.cut import Cut
from steelyard.formats.log import PART, Log
from steelyard.robot_file.signals import TIME_UNITS
from steelyard.robot_file.template.guess_time import guess_time

SAMPLE = 2000
"""Rows read to find a column of time."""


@dataclass(frozen=True)
class TimeColumn:
    """The column that seems to be a log's time.

    Attributes:
        name: Its name.
        unit: `s`, `ms`, `us` or `ns`.
    """

    name: str
    unit: str

    @property
    def scale(self) -> float:
        """Seconds per unit."""
        return TIME_UNITS[self.unit]


def time_column(log: Log, columns: Sequence[str]) -> TimeColumn | None:
    """The column of time beside others, by names and first values; `None` if none looks like it.

    In a log of messages it is the stamp of the topic that the first of the columns is of.
    """
    stamps = [name for name in log.columns if name.endswith("/stamp")]
    if stamps and hasattr(type(log), "topics"):
        return TimeColumn(max(stamps, key=lambda s: len(commonprefix((s, columns[0])))), "s")
    unique = [name for name, count in Counter(log.columns).items() if count == 1]
    first = next(log.parts(unique, (0, SAMPLE), SAMPLE), np.zeros((0, len(unique))))
    found = guess_time(unique, dict(zip(unique, first.T, strict=True)))
    return None if found is None else TimeColumn(*found)


def windowed(log: Log, columns: Sequence[str], cut: Cut) -> Iterator[Array]:
    """Rows of a window in parts, as they are in the log.

    Seconds count from the log's first finite time; a row whose own time is none has that of the
    row before it.

    Raises:
        LogError: The cut is in seconds, but no column looks like time.
    """
    if cut.seconds == Cut().seconds:
        yield from log.parts(columns, cut.rows)
        return
    time = time_column(log, columns)
    if time is None:
        raise LogError(
            "the log is cut in seconds, but none of its columns looks like time",
            where=f"{log.path}{cut.text}",
            fix="cut it by rows: LOG#START:STOP",
        )
    names = tuple(dict.fromkeys((time.name, *columns)))
    wanted = [names.index(column) for column in columns]
    first = last = np.nan
    for part in log.parts(names, (0, None), PART):
        t = _filled(part[:, 0] * time.scale, last)
        last = t[-1]
        if np.isnan(first):
            first = t[np.argmax(np.isfinite(t))]
        inside = (t - first >= cut.seconds[0]) & (t - first < cut.seconds[1])
        if inside.any():
            yield part[inside][:, wanted]
        elif np.all(t - first >= cut.seconds[1]):
            return


def _filled(t: Array, before: float) -> Array:
    """Times, with those that are not finite replaced by the one before."""
    extended = np.concatenate(([before], t))
    at = np.maximum.accumulate(np.where(np.isfinite(extended), np.arange(len(extended)), 0))
    filled: Array = extended[at][1:]
    return filled
