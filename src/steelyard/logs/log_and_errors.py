"""What every log can do, windows of logs, and errors for what is missing or unreadable."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Protocol

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, advice, listing, names_beside, nearest
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


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """What the system says of a file or folder that it does not hand out is a `LogError`."""
    try:
        yield
    except OSError as error:
        raise LogError(
            f"the log cannot be read ({error.strerror or error})",
            where=str(path),
            fix="check the file's permissions and the disk",
        ) from error


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
