"""Which part of a log is meant: `run.csv@0.6:9.5` in seconds, `run.csv#921:4442` in rows."""

from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path

from steelyard.errors import LogError
from steelyard.formats.log import Rows

SYNTAX = (
    "write LOG@START:STOP with seconds from the log's start, or LOG#START:STOP with rows counted "
    "from 0; either end may be left out"
)


@dataclass(frozen=True)
class Cut:
    """A window of a log; the default is all of it. Both ends apply, stops are exclusive.

    Attributes:
        seconds: Start and stop, counted from the log's first good row [s].
        rows: Start and stop row, counted from zero.
    """

    seconds: tuple[float, float] = (-inf, inf)
    rows: Rows = (0, None)

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

    Raises:
        LogError: The window makes no sense.
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
    if mark == "@":
        seconds = _seconds(argument, start, 0.0), _seconds(argument, stop, inf)
        _require_order(argument, seconds[0], seconds[1])
        return Path(name), Cut(seconds=(-inf if seconds[0] == 0.0 else seconds[0], seconds[1]))
    first, last = _row(argument, start), _row(argument, stop)
    rows = (0 if first is None else first, last)
    _require_order(argument, rows[0], inf if last is None else last)
    return Path(name), Cut(rows=rows)


def _seconds(argument: str, text: str, default: float) -> float:
    try:
        value = float(text) if text.strip() else default
    except ValueError:
        value = -1.0
    if not value >= 0.0:
        raise LogError(f"'{text}' is not a time from the log's start", where=argument, fix=SYNTAX)
    return value


def _row(argument: str, text: str) -> int | None:
    try:
        value = int(text) if text.strip() else None
    except ValueError:
        value = -1
    if value is not None and value < 0:
        raise LogError(f"'{text}' is not a row", where=argument, fix=SYNTAX)
    return value


def _require_order(argument: str, start: float, stop: float) -> None:
    if start >= stop:
        raise LogError(
            f"the window ends ({stop:g}) before it starts ({start:g})"
            if start > stop
            else f"the window is empty: it starts and ends at {start:g}",
            where=argument,
            fix=SYNTAX,
        )
