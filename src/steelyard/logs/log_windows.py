"""Windows of logs, as named on the command line: `LOG@START:STOP`, `LOG#START:STOP`."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path

from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import RowRange

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
