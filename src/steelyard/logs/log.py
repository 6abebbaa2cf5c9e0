"""What every log can do, logs without a clock, logs side by side, and which part is meant."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, advice, listing, names_beside, nearest
from steelyard.robot.file.signals import ROW
from steelyard.robot.init.column_names import Column

ROWS_OF_PART = 50_000
"""Rows of a part. Twice as many need 15 MiB more, half as many take twice the time."""

RowRange = tuple[int, int | None]
"""First row and the row after the last one, counted from zero; `None` is the end of the log."""


class Log(Protocol):
    """A table of numbers on disk, read from front to back in constant memory."""

    @property
    def path(self) -> Path:
        """Where it is."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns."""

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows, in arrays of shape `(at most size, len(columns))`.

        A cell that is missing or not a number is NaN.

        Raises:
            LogError: A column does not exist, or the file cannot be read.
        """


MOST_NAMED_COLUMNS = 4  # most missing columns that are named
TIME_COLUMN = re.compile("(^|_)(t|time|stamp|timestamp)(_|$)", re.IGNORECASE)
"""Names of columns of time."""


def require_columns(path: Path, known: Sequence[str], wanted: Sequence[str]) -> None:
    """Check that a log has the columns wanted of it, each once."""
    fix = "name the columns of the log under [signals] of the robot file"
    twice = next((c for c in wanted if list(known).count(c) > 1), None)
    missing = [column for column in dict.fromkeys(wanted) if column not in known]
    if twice is not None and (not missing or wanted.index(twice) < wanted.index(missing[0])):
        raise ambiguous(path, twice, list(known).count(twice))
    if not missing:
        return
    wrong = f"the log has no column '{missing[0]}'"
    if len(missing) > 1:
        wrong = (
            f"{len(missing)} of the {len(wanted)} columns that are needed are not in the log: "
            f"{_first_names(missing)}"
        )
    used = "all columns of the log are used: log this one too, or leave its joint out"
    if any(TIME_COLUMN.search(column) for column in missing):
        used = fix = (
            "name the column of time, or state rate = HZ instead of time, if rows are evenly "
            "spaced, under [signals] of the robot file"
        )
    free = [column for column in known if column not in wanted]
    found = f"{_similar_columns(missing, free)}; {fix}" if free else used
    raise LogError(wrong, where=str(path), fix=found)


def ambiguous(path: Path, name: str, count: int) -> LogError:
    """The error for a wanted name that several columns have."""
    return LogError(
        f"the log has {count} columns that are called '{name}'",
        where=str(path),
        fix="rename them in the log's header, then name the columns of the log under [signals] of "
        "the robot file",
    )


def require_file(path: Path) -> None:
    """Check that there is something to read."""
    if path.is_dir():
        raise LogError(
            "the log is a folder, not a file", where=str(path), fix="name one log file in it"
        )
    if not path.exists():
        raise LogError("there is no such log file", where=str(path), fix=_similar_files(path))
    if path.stat().st_size == 0:
        raise LogError("the log file is empty", where=str(path), fix="record or copy it again")


def unreadable(path: Path, error: OSError) -> LogError:
    """The error for a file that the system does not hand out."""
    return LogError(
        f"the log cannot be read ({error.strerror or error})",
        where=str(path),
        fix="check the file's permissions and the disk",
    )


def _first_names(columns: Sequence[str]) -> str:
    more = ", ..." * (len(columns) > MOST_NAMED_COLUMNS)
    return ", ".join(map(repr, columns[:MOST_NAMED_COLUMNS])) + more


def _similar_columns(missing: Sequence[str], free: Sequence[str]) -> str:
    """Columns that may be meant, none of another quantity or unit: one for each that is missing."""
    alike = {
        column: [name for name in free if Column(name).may_stand_for(Column(column))]
        for column in missing
    }
    found = [name for column in missing for name in nearest(column, alike[column], 1)]
    if len(missing) > 1 and len(set(found)) == len(missing):
        return f"did you mean {_first_names(found)}?"
    near = nearest(missing[0], alike[missing[0]])
    if near:
        return advice(missing[0], near, "columns")
    return listing(free, "other columns", like=missing[0])


def _similar_files(path: Path) -> str:
    """Files beside a missing one that may be meant: of a similar name, or of the same kind."""
    if not path.parent.is_dir():
        return f"check the path: there is no folder '{path.parent}'"
    if "[" in path.name:
        return "cut a log with LOG@START:STOP (seconds from its start) or LOG#START:STOP (rows)"
    near, alike = names_beside(path)
    if near or alike:
        return advice(path.name, near or alike, "logs there")
    if "*" in path.name or "?" in path.name:
        return f"check the pattern: no file in '{path.parent}' matches it"
    ending = f"ends in {path.suffix}" if path.suffix else "has no suffix either"
    return f"check the path: no file in '{path.parent}' has a similar name or {ending}"


@dataclass(frozen=True, eq=False)
class Numbered:
    """A log with the numbers of its rows, from zero, as one more column."""

    log: Log

    @property
    def path(self) -> Path:
        """Where it is."""
        return self.log.path

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns, and `ROW`."""
        return (*self.log.columns, ROW)

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


@dataclass(frozen=True, eq=False)
class WholeClocks:
    """A log whose clocks in two columns are in one, in seconds, which replaces both."""

    log: Log
    clocks: Clocks

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

    @property
    def path(self) -> Path:
        """Where it is."""
        return self.log.path

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns; clocks stand where their seconds stood."""
        joined = {seconds: name for name, (seconds, _, _) in self.clocks.items()}
        parts = {part for _, part, _ in self.clocks.values()}
        return tuple(joined.get(name, name) for name in self.log.columns if name not in parts)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows; see `Log.parts`."""
        require_columns(self.path, self.columns, columns)
        for part in self.log.parts(logged_columns(columns, self.clocks), rows, size):
            yield with_clocks(part, columns, self.clocks) if columns else part


SYNTAX = (
    "write LOG@START:STOP with seconds from the log's start, or LOG#START:STOP with rows counted "
    "from 0; either end may be left out"
)


@dataclass(frozen=True)
class Cut:
    """A window of a log; the default is all of it. Both ends apply, stops are exclusive.

    Seconds are counted from the log's first good row, rows from zero.
    """

    seconds: tuple[float, float] = (-inf, inf)
    rows: RowRange = (0, None)

    @property
    def text(self) -> str:
        """As written behind a log's name; empty for the whole log."""
        if self.seconds != (-inf, inf):
            ends = [f"{s:g}" if isfinite(s) else "" for s in self.seconds]
            return f"@{ends[0]}:{ends[1]}"
        if self.rows != (0, None):
            return f"#{self.rows[0]}:{'' if self.rows[1] is None else self.rows[1]}"
        return ""


def parse_log_argument(argument: str) -> tuple[Path, Cut]:
    """File and window of a log as named on the command line.

    A file that really has `@` or `#` in its name is taken as it is.
    """
    if Path(argument).exists():
        return Path(argument), Cut()
    place = max(argument.rfind("@"), argument.rfind("#"))
    name, mark, window = argument[:place], argument[place : place + 1], argument[place + 1 :]
    if place < 0 or (":" not in window and not Path(name).exists()):
        return Path(argument), Cut()
    start, colon, stop = window.partition(":")
    if not name or not colon:
        raise LogError(f"'{mark}{window}' is not a window", where=argument, fix=SYNTAX)
    number, what = (float, "a time from the log's start") if mark == "@" else (int, "a row")
    first = _parsed_number(argument, start, number, 0, what)
    last = _parsed_number(argument, stop, number, inf, what)
    if first >= last:
        raise LogError(
            f"the window ends ({last:g}) before it starts ({first:g})"
            if first > last
            else f"the window is empty: it starts and ends at {first:g}",
            where=argument,
            fix=SYNTAX,
        )
    if mark == "@":
        return Path(name), Cut(seconds=(-inf if first == 0.0 else first, last))
    return Path(name), Cut(rows=(int(first), None if last == inf else int(last)))


def _parsed_number(
    argument: str, text: str, number: Callable[[str], float], default: float, what: str
) -> float:
    try:
        value = number(text) if text.strip() else default
    except ValueError:
        value = -1
    if not value >= 0:
        raise LogError(f"'{text}' is not {what}", where=argument, fix=SYNTAX)
    return value


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Logs with equally many rows; columns that several have, such as time, must agree."""

    logs: tuple[Log, ...]

    @property
    def path(self) -> Path:
        """Where the first one is."""
        return self.logs[0].path

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns, each once."""
        return tuple(dict.fromkeys(name for log in self.logs for name in log.columns))

    @property
    def shared(self) -> tuple[str, ...]:
        """Columns of more than one log."""
        counts = Counter(name for log in self.logs for name in set(log.columns))
        return tuple(name for name in self.columns if counts[name] > 1)

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
