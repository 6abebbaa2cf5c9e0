"""What every log file can do: name its columns and hand out its rows in parts."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.robot_file.column_names import Column
from steelyard.suggest import advice, listing, names_beside, nearest

PART = 50_000
"""Rows of a part. Twice as many need 15 MiB more, half as many take twice the time."""

Rows = tuple[int, int | None]
"""First row and the row after the last one, counted from zero; `None` is the end of the log."""


class Log(Protocol):
    """A table of numbers on disk, read from front to back in constant memory."""

    @property
    def path(self) -> Path:
        """Where it is."""
        ...

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns."""
        ...

    def parts(
        self, columns: Sequence[str], rows: Rows = (0, None), size: int = PART
    ) -> Iterator[Array]:
        """The requested rows, in arrays of shape `(at most size, len(columns))`.

        A cell that is missing or not a number is NaN.

        Raises:
            LogError: A column does not exist, or the file cannot be read.
        """
        ...


MISSING = 4
"""Most missing columns that are named."""


TIME = re.compile("(^|_)(t|time|stamp|timestamp)(_|$)", re.IGNORECASE)
"""Names of columns of time."""


def require_columns(path: Path, known: Sequence[str], wanted: Sequence[str]) -> None:
    """Check that a log has the columns wanted of it, each once.

    Raises:
        LogError: One is missing or ambiguous.
    """
    fix = "name the columns of the log under [signals] of the robot file"
    missing = [column for column in dict.fromkeys(wanted) if column not in known]
    free = [column for column in known if column not in wanted]
    used = "all columns of the log are used: log this one too, or leave its joint out"
    if any(TIME.search(column) for column in missing):
        used = fix = (
            "name the column of time, or state rate = HZ instead of time, if rows are evenly "
            "spaced, under [signals] of the robot file"
        )
    for column in wanted:
        count = list(known).count(column)
        if count == 0:
            raise LogError(
                _lacking(missing, len(wanted)),
                where=str(path),
                fix=f"{_meant(missing, free)}; {fix}" if free else used,
            )
        if count > 1:
            raise LogError(
                f"the log has {count} columns that are called '{column}'",
                where=str(path),
                fix=f"rename them in the log's header, then {fix}",
            )


def require_file(path: Path) -> None:
    """Check that there is something to read.

    Raises:
        LogError: No such file, a folder, or an empty file.
    """
    if path.is_dir():
        raise LogError(
            "the log is a folder, not a file", where=str(path), fix="name one log file in it"
        )
    if not path.exists():
        raise LogError("there is no such log file", where=str(path), fix=_beside(path))
    if path.stat().st_size == 0:
        raise LogError("the log file is empty", where=str(path), fix="record or copy it again")


def _lacking(missing: Sequence[str], needed: int) -> str:
    """Columns that are not in a log, the first ones by name."""
    if len(missing) == 1:
        return f"the log has no column '{missing[0]}'"
    return (
        f"{len(missing)} of the {needed} columns that are needed are not in the log: "
        f"{_some(missing)}"
    )


def _some(columns: Sequence[str]) -> str:
    """The first ones by name."""
    return ", ".join(repr(name) for name in columns[:MISSING]) + ", ..." * (len(columns) > MISSING)


def _meant(missing: Sequence[str], free: Sequence[str]) -> str:
    """Columns that may be meant, none of another quantity or unit: one for each that is missing."""
    alike = {
        column: [name for name in free if Column(name).may_stand_for(Column(column))]
        for column in missing
    }
    found = [name for column in missing for name in nearest(column, alike[column], 1)]
    if len(missing) > 1 and len(set(found)) == len(missing):
        return f"did you mean {_some(found)}?"
    near = nearest(missing[0], alike[missing[0]])
    if near:
        return advice(missing[0], near, "columns")
    return listing(free, "other columns", like=missing[0])


def _beside(path: Path) -> str:
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
