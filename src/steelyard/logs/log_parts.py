"""Parts of logs: files of this machine or URLs, long ones cut into rows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from steelyard.base.errors import LogError, SteelyardError
from steelyard.logs.files_and_urls import StoredFile, files_of, is_url, without_secrets
from steelyard.logs.log_and_errors import Cut, parse_log_argument
from steelyard.logs.parquet import ParquetLog, natural

ROWS_OF_PART = 500_000
"""Rows of a part of a Parquet file; other files are one part, as their rows are not known."""

ROWS_OF_SAMPLE = 40_000  # rows of a part that a first model is identified from

LEAST_BYTES_OF_ROW = 16  # of a Parquet file; smaller ones are not looked into


@dataclass(frozen=True)
class LogPart:
    """Rows of one log, all if `rows` is `None`; of a fleet's log its robot and day."""

    file: StoredFile
    robot: str = ""
    day: str = ""
    rows: tuple[int, int] | None = None
    temperature: float | None = None  # of the table of logs [K or °C]; `None` if it has none
    share: float = 1.0  # of the file's rows

    @property
    def cut(self) -> str:
        """The rows as they stand behind a log's name."""
        return "" if self.rows is None else Cut(rows=self.rows).text

    @property
    def where(self) -> str:
        """The file and the rows, for messages."""
        return f"{without_secrets(self.file.url)}{self.cut}"

    @property
    def size(self) -> int:
        """Bytes, about."""
        return round(self.file.size * self.share)

    @property
    def place(self) -> tuple[Any, ...]:
        """By which parts are put in order: robot, day, file, rows; numbers in names count."""
        start = 0 if self.rows is None else self.rows[0]
        return natural(self.robot), natural(self.day), self.file.url, start


def pieces_of(part: LogPart) -> list[LogPart]:
    """A long Parquet file of this machine in pieces of about as many rows each."""
    if part.file.size < ROWS_OF_PART * LEAST_BYTES_OF_ROW:
        return [part]
    count = _rows(part)
    n = max(1, round(count / ROWS_OF_PART))
    if n == 1:
        return [part]
    edges = [count * k // n for k in range(n + 1)]
    each = zip(edges[:-1], edges[1:], strict=True)
    return [replace(part, rows=edge, share=1.0 / n) for edge in each]


def _rows(part: LogPart) -> int:
    """Rows of a Parquet file of this machine; 0 of what is not known without reading it."""
    path = Path(part.file.url)
    if is_url(part.file.url) or path.suffix.lower() != ".parquet":
        return 0
    try:
        return ParquetLog.open(path).n_rows
    except SteelyardError:
        return 0  # whoever reads it says why it cannot be read


def middle_of(part: LogPart) -> LogPart:
    """The middle of a long part, `ROWS_OF_SAMPLE` rows of it; a short one as it is."""
    start, stop = part.rows or (0, _rows(part))
    if stop - start <= ROWS_OF_SAMPLE:
        return part
    first = start + (stop - start - ROWS_OF_SAMPLE) // 2
    return replace(part, rows=(first, first + ROWS_OF_SAMPLE))


def whole_logs(logs: Sequence[str]) -> tuple[LogPart, ...]:
    """All logs, each as one part, in the order of their names.

    Args:
        logs: Files, folders, patterns with `*`, or URLs.

    Raises:
        LogError: There is no log, one is named twice, or a window of one is named.
    """
    found = dict[str, LogPart]()
    for argument in logs:
        if not is_url(argument) and parse_log_argument(argument)[1] != Cut():
            raise LogError(
                "windows of logs are not cut for workers",
                where=argument,
                fix="name the whole log, or write the window to a file of its own",
            )
        for file in files_of(argument):
            if file.url in found:
                where = without_secrets(file.url)
                raise LogError("a log is named twice", where=where, fix="name every log once")
            found[file.url] = LogPart(file)
    return tuple(sorted(found.values(), key=lambda part: natural(part.file.url)))
