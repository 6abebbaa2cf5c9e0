"""Logs without a clock, with clocks in two columns, and side by side."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import ROWS_OF_PART, Log, RowRange, require_columns
from steelyard.robot.file.signals import ROW


class Numbered:
    """A log with the numbers of its rows, from zero, as one more column."""

    def __init__(self, log: Log) -> None:
        self.log, self.path, self.columns = log, log.path, (*log.columns, ROW)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows; see `Log.parts`."""
        logged = [column for column in columns if column != ROW]
        start = rows[0]
        for part in self.log.parts(logged or self.log.columns[:1], rows, size):
            numbers = np.arange(start, start + len(part), dtype=np.float64)
            start += len(part)
            named = dict(zip(logged, part.T, strict=False)) | {ROW: numbers}
            yield np.column_stack([named[column] for column in columns])


_PART_OF_SECOND = re.compile(
    r"(?P<stem>.*?)(?P<part>n|nano|u|micro)(?P<second>sec(?:ond)?)s?", re.IGNORECASE
)

Clocks = Mapping[str, tuple[str, str, float]]
"""Clocks in two columns: name in seconds to both columns and seconds per unit of the second one."""


def split_clocks(columns: Sequence[str]) -> Clocks:
    """Clocks that are in two columns of a log, such as `stamp.sec` and `stamp.nanosec`."""
    clocks = {}
    for name in columns:
        if found := _PART_OF_SECOND.fullmatch(name):
            whole = f"{found['stem']}{found['second']}".lower()
            seconds = next((c for c in columns if c.lower() in (whole, f"{whole}s")), "")
            unit = 1e-9 if found["part"][0].lower() == "n" else 1e-6
            joined = f"{found['stem']}{'_' * found['stem'][-1:].isalnum()}time_s"
            if seconds and joined not in columns:
                clocks[joined] = seconds, name, unit
    return clocks


def logged_columns(columns: Sequence[str], clocks: Clocks) -> list[str]:
    """Columns of a log that hold some columns, of which clocks are in two."""
    return list(dict.fromkeys(one for name in columns for one in clocks.get(name, (name,))[:2]))


def with_clocks(part: Array, columns: Sequence[str], clocks: Clocks) -> Array:
    """Some columns of rows of the `logged_columns` of these."""
    values = dict(zip(logged_columns(columns, clocks), part.T, strict=True))
    for name in clocks.keys() & set(columns):
        seconds, rest, unit = clocks[name]
        values[name] = values[seconds] + unit * values[rest]
    return np.column_stack([values[name] for name in columns])


class WholeClocks:
    """A log whose clocks in two columns are in one, in seconds, which stands where theirs stood."""

    def __init__(self, log: Log, clocks: Clocks) -> None:
        self.log, self.clocks, self.path = log, clocks, log.path
        joined = {seconds: name for name, (seconds, _, _) in clocks.items()}
        parts = {part for _, part, _ in clocks.values()}
        self.columns = tuple(joined.get(name, name) for name in log.columns if name not in parts)

    @classmethod
    def of(cls, log: Log) -> Log:
        """The log itself if it has no such clocks."""
        clocks = split_clocks(log.columns)
        return cls(log, clocks) if clocks else log

    def __getattr__(self, name: str) -> Any:
        """What else its log says of itself, such as `left_out`."""
        if name == "log":  # not there yet
            raise AttributeError(name)
        return getattr(self.log, name)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows; see `Log.parts`."""
        require_columns(self.path, self.columns, columns)
        for part in self.log.parts(logged_columns(columns, self.clocks), rows, size):
            yield with_clocks(part, columns, self.clocks) if columns else part


class SideBySide:
    """Logs with equally many rows; columns that are `shared`, such as time, must agree."""

    def __init__(self, logs: tuple[Log, ...]) -> None:
        self.logs, self.path = logs, logs[0].path
        counts = Counter(name for log in logs for name in dict.fromkeys(log.columns))
        self.columns = tuple(counts)
        self.shared = tuple(name for name, count in counts.items() if count > 1)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows; see `Log.parts`."""
        require_columns(self.path, self.columns, columns)
        wanted = dict.fromkeys((*columns, *self.shared))
        names = [[c for c in wanted if c in log.columns] or log.columns[:1] for log in self.logs]
        streams = [log.parts(mine, rows, size) for log, mine in zip(self.logs, names, strict=True)]
        rest, row = [np.zeros((0, len(mine))) for mine in names], rows[0]
        while True:
            for k, stream in enumerate(streams):
                while not len(rest[k]) and (part := next(stream, None)) is not None:
                    rest[k] = part
            count = min(map(len, rest))
            if not count:
                break
            found: dict[str, Array] = {}
            for log, mine, part in zip(self.logs, names, rest, strict=True):
                for name, values in zip(mine, part[:count].T, strict=True):
                    first = found.setdefault(name, values)
                    if not np.array_equal(first, values, equal_nan=True):
                        at = row + int(np.argmax((first != values) & ~np.isnan(first + values)))
                        self._refuse(f"column '{name}' of {log.path.name} differs from row {at} on")
            yield np.column_stack([found[name] for name in columns])
            rest, row = [part[count:] for part in rest], row + count
        if any(map(len, rest)):
            shorter = next(log for log, part in zip(self.logs, rest, strict=True) if not len(part))
            self._refuse(f"{shorter.path.name} ends after row {row - 1}, another goes on")

    def _refuse(self, wrong: str) -> None:
        raise LogError(
            f"the logs have no common clock: {wrong}",
            where=", ".join(str(log.path) for log in self.logs),
            fix="give files with the same samples, row by row; bring others to one clock first",
        )
