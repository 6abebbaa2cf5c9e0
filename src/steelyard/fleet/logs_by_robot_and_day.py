"""Logs of a fleet in parts: which robot and day each is of, and which rows.

Robot and day come from a table, from a pattern such as `{robot}/{day}`, or by themselves: the day
is the date in a path, or the number behind "day", the robot is what is left of the path.
"""

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

from steelyard.base.errors import LogError, SteelyardError
from steelyard.fleet.files_and_urls import StoredFile, files_of, is_url, without_secrets
from steelyard.logs.parquet import ParquetLog

ROWS_OF_PART = 500_000
"""Rows of a part of a Parquet file; other files are one part, as their rows are not known."""

LEAST_BYTES_OF_ROW = 16  # of a Parquet file; smaller ones are not looked into

DATE = re.compile(r"(?<!\d)(\d{4})[-_]?(0[1-9]|1[0-2])[-_]?(0[1-9]|[12]\d|3[01])(?!\d)")
DAY = re.compile(r"(?<![a-zA-Z])[dD]ay[-_]?(\d+)(?!\d)")
SEPARATORS = " -_./"


@dataclass(frozen=True)
class LogPart:
    """Rows of one log of a robot's day; all if `rows` is `None`."""

    file: StoredFile
    robot: str
    day: str
    rows: tuple[int, int] | None = None
    temperature: float | None = None  # of the table of logs [K or °C]; `None` if it has none

    @property
    def where(self) -> str:
        """The file and the rows, for messages."""
        cut = "" if self.rows is None else f"#{self.rows[0]}:{self.rows[1]}"
        return f"{without_secrets(self.file.url)}{cut}"

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self.file.size

    @property
    def place(self) -> tuple[str, str, str, int]:
        """By which parts are put in order: robot, day, file, rows."""
        return self.robot, self.day, self.file.url, 0 if self.rows is None else self.rows[0]


def parts_of(logs: Sequence[str], names: str | None = None) -> tuple[LogPart, ...]:
    """The parts of all logs, by robot, day and file.

    Args:
        logs: Files, folders, patterns with `*`, URLs; or tables of logs: CSV with the columns log,
            robot, day and, if known, temperature, which names logs relative to itself.
        names: How robot and day stand in the paths: `{robot}/{day}` or `{robot}_{day}_*`.

    Raises:
        LogError: There is no log, one has no day, or a table is not as it should be.
    """
    pattern = None if names is None else _pattern(names)
    whole = list[LogPart]()
    for argument in logs:
        table = _table(argument)
        whole += _of_paths(argument, pattern, names) if table is None else _of_table(*table)
    twice = [url for url, n in Counter(part.file.url for part in whole).items() if n > 1]
    if twice:
        raise LogError(
            "a log is named twice", where=without_secrets(twice[0]), fix="name every log once"
        )
    found = [piece for part in whole for piece in _pieces(part)]
    return tuple(sorted(found, key=lambda part: part.place))


def _of_paths(argument: str, pattern: "re.Pattern[str] | None", names: str | None) -> list[LogPart]:
    return [
        LogPart(file, *_named(file.url, argument, pattern, names)) for file in files_of(argument)
    ]


def _pattern(names: str) -> "re.Pattern[str]":
    """A pattern of paths as a regular expression over the end of a path without suffix."""
    if names.count("{robot}") != 1 or names.count("{day}") != 1:
        raise LogError(
            "the pattern does not name robot and day once each",
            where=f"names (--names) {names}",
            fix='give one such as "{robot}/{day}" or "{day}/{robot}_*"',
        )
    text = re.escape(names.removesuffix("/*").removesuffix("*"))
    for escaped, expression in (
        (r"\{robot\}", r"(?P<robot>[^/]+?)"),
        (r"\{day\}", r"(?P<day>[^/]+?)"),
        (r"\*", "[^/]*"),
    ):
        text = text.replace(escaped, expression)
    ends = "(?:/[^/]*)?" if names.endswith("/*") else "[^/]*" if names.endswith("*") else ""
    return re.compile(f"(?:^|/){text}{ends}$")


def _named(
    url: str, argument: str, pattern: "re.Pattern[str] | None", names: str | None
) -> tuple[str, str]:
    path = PurePosixPath(urlsplit(url).path if is_url(url) else Path(url).as_posix())
    text = str(path.with_suffix(""))
    if pattern is not None:
        match = pattern.search(text)
        if match is None:
            raise LogError(
                f"the path does not fit the pattern {names}",
                where=without_secrets(url),
                fix="change --names, or give a table of logs: CSV with the columns log, robot, day",
            )
        return match["robot"], match["day"]
    begin = argument if is_url(argument) else Path(argument).as_posix()
    begin = (urlsplit(begin).path if is_url(begin) else begin).split("*")[0].rstrip("/")
    inside = text.removeprefix(begin).strip("/") if text.startswith(begin + "/") else path.stem
    for own in (inside, text):
        dates = [*DATE.finditer(own)] or [*DAY.finditer(own)]
        if dates:
            last = dates[-1]
            day = "-".join(last.groups()) if len(last.groups()) == 3 else f"{int(last[1]):04d}"
            return _robot(own[: last.start()], own[last.end() :], path), day
    raise LogError(
        "the path of the log has no date, and no number behind 'day'",
        where=without_secrets(url),
        fix='say where robot and day stand, as with --names "{robot}/{day}", or give a table of '
        "logs (--table) with the columns log, robot, day",
    )


def _robot(before: str, behind: str, path: PurePosixPath) -> str:
    """What is left of a path beside the day: the folders before it, or the rest of the name."""
    left = [word.strip(SEPARATORS) for word in before.split("/") if word.strip(SEPARATORS)]
    if left:
        return "/".join(left)
    rest = behind.split("/")[0].strip(SEPARATORS)
    return rest or behind.strip(SEPARATORS).split("/")[0] or path.parent.name or "robot"


COLUMNS = ("log", "robot", "day")


def _table(argument: str) -> tuple[Path, list[dict[str, str | None]]] | None:
    """The rows of a table of logs; `None` if it is something else."""
    path = Path(argument)
    if is_url(argument) or path.suffix.lower() != ".csv" or not path.is_file():
        return None
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream)
            if not set(COLUMNS) <= set(reader.fieldnames or ()):
                return None
            return path, list(reader)
    except (OSError, UnicodeDecodeError, csv.Error):
        return None  # whoever reads it as a log says what is wrong


def _of_table(table: Path, rows: Sequence[Mapping[str, str | None]]) -> list[LogPart]:
    found = []
    for number, row in enumerate(rows, start=2):
        place = f"{table}, line {number}"
        log, robot, day = (str(row[name] or "").strip() for name in COLUMNS)
        if not (log and robot and day):
            raise LogError("a cell is empty", where=place, fix="give log, robot and day")
        named = log if is_url(log) or Path(log).is_absolute() else str(table.parent / log)
        warm = str(row.get("temperature") or "").strip()
        try:
            degrees = float(warm) if warm else None
        except ValueError:
            wrong = f"the temperature '{warm}' is not a number"
            raise LogError(wrong, where=place, fix="give a number, or leave it empty") from None
        try:
            files = files_of(named)
        except SteelyardError as error:
            raise LogError(error.wrong, where=place, fix=error.fix) from None
        found += [LogPart(file, robot, day, temperature=degrees) for file in files]
    if not found:
        raise LogError("the table of logs has no rows", where=str(table), fix="list the logs")
    return found


def _pieces(part: LogPart) -> list[LogPart]:
    """A long Parquet file of this machine in pieces of about as many rows each."""
    path = Path(part.file.url)
    small = part.file.size < ROWS_OF_PART * LEAST_BYTES_OF_ROW
    if small or is_url(part.file.url) or path.suffix.lower() != ".parquet":
        return [part]
    try:
        count = ParquetLog.open(path).n_rows
    except SteelyardError:
        return [part]  # whoever reads it says why it cannot be read
    pieces = max(1, round(count / ROWS_OF_PART))
    if pieces == 1:
        return [part]
    edges = [count * k // pieces for k in range(pieces + 1)]
    return [replace(part, rows=edge) for edge in zip(edges[:-1], edges[1:], strict=True)]
