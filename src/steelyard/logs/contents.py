"""What is in a log: rows, time, the kind and range of each column; and a window of it."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from math import inf, isfinite
from os.path import commonprefix
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.logs.formats import FORMATS
from steelyard.logs.lerobot import is_lerobot
from steelyard.logs.log_and_errors import ROWS_OF_PART, Cut, Log
from steelyard.robot.file.signals import TIME_UNITS
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_clock_positions_and_velocities import guess_time

SAMPLED_TIMES = 2000  # rows read to find a column of time


@dataclass(frozen=True)
class TimeColumn:
    """The column that seems to be a log's time."""

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
    first = next(log.parts(unique, (0, SAMPLED_TIMES), SAMPLED_TIMES), np.zeros((0, len(unique))))
    found = guess_time(unique, dict(zip(unique, first.T, strict=True)))
    return None if found is None else TimeColumn(*found)


def windowed(log: Log, columns: Sequence[str], cut: Cut) -> Iterator[Array]:
    """Rows of a window in parts, as they are in the log.

    Seconds count from the log's first finite time; a row whose own time is none has that of the
    row before it.
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
    for part in log.parts(names, (0, None), ROWS_OF_PART):
        t = np.concatenate(([last], part[:, 0] * time.scale))
        known = np.where(np.isfinite(t), np.arange(len(t)), 0)
        t = t[np.maximum.accumulate(known)][1:]
        last = t[-1]
        if np.isnan(first):
            first = t[np.argmax(np.isfinite(t))]
        inside = (t - first >= cut.seconds[0]) & (t - first < cut.seconds[1])
        if inside.any():
            yield part[inside][:, wanted]
        elif np.all(t - first >= cut.seconds[1]):
            return


@dataclass(frozen=True)
class ColumnContent:
    """What is in a column: its first, least and greatest finite value, `None` if there is none.

    `kind` is the quantity that its name speaks of, `missing` the share of cells that hold no finite
    number.
    """

    name: str
    kind: str
    first: float | None
    least: float | None
    most: float | None
    missing: float


@dataclass(frozen=True)
class LogContent:
    """What is in a log."""

    path: str  # where it is, with its cut
    format: str
    size: int  # bytes on disk
    rows: int
    time: TimeColumn | None
    duration: float | None  # from least to greatest time [s]
    rate: float | None  # rows per second over all of it [Hz]
    columns: tuple[ColumnContent, ...]
    left_out: tuple[tuple[str, str], ...]  # name and reason of what the file holds beside its table
    topics: tuple[dict[str, Any], ...]  # topics of a log of messages
    remarks: tuple[str, ...]  # what a user should know about the file's state

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        left_out = [{"name": name, "why": why} for name, why in self.left_out]
        return {**asdict(self), "left_out": left_out}


def _columns_of(
    names: Sequence[str], parts: Iterable[Array]
) -> tuple[int, tuple[ColumnContent, ...]]:
    """Rows in all parts, and what is in each column."""
    rows, width = 0, len(names)
    first, least, most = np.full(width, inf), np.full(width, inf), np.full(width, -inf)
    missing = np.zeros(width, dtype=np.int64)
    for part in parts:
        finite = np.isfinite(part)
        first = first if rows else part[0].copy()
        rows += len(part)
        missing += (~finite).sum(axis=0)
        least = np.minimum(least, np.where(finite, part, inf).min(axis=0))
        most = np.maximum(most, np.where(finite, part, -inf).max(axis=0))
    found = []
    for name, *values, absent in zip(names, first, least, most, missing, strict=True):
        start, low, high = (float(x) if isfinite(x) else None for x in values)
        kind, share = Column(name).quantity or "", float(absent) / max(1, rows)
        found.append(ColumnContent(name, kind, start, low, high, share))
    return rows, tuple(found)


def content_of(log: Log, cut: Cut = Cut(), progress: Progress = silent) -> LogContent:  # noqa: B008
    """Read a log, or a window of it, once from front to back."""
    counts = Counter(log.columns)
    names = tuple(name for name, count in counts.items() if count == 1)
    time = time_column(log, names)
    parts = with_progress(windowed(log, names, cut), log, progress, "reading the log")
    rows, columns = _columns_of(names, parts)
    duration, rate = (None, None) if is_lerobot(log.path) else _clock(columns, time, rows)
    files = log.path.rglob("*") if log.path.is_dir() else [log.path]
    twice = tuple((n, f"{k} columns are called so") for n, k in counts.items() if k > 1)
    return LogContent(
        path=f"{log.path}{cut.text}",
        format=kind_of(log.path),
        size=sum(file.stat().st_size for file in files if file.is_file()),
        rows=rows,
        time=time,
        duration=duration,
        rate=rate,
        columns=columns,
        left_out=(*getattr(log, "left_out", ()), *twice),
        topics=getattr(log, "topics", ()),
        remarks=tuple(getattr(log, "remarks", ())),
    )


def with_progress(
    parts: Iterator[Array], log: Log, progress: Progress, phase: str
) -> Iterator[Array]:
    """Parts of a log as they come, with events of progress."""
    done, known = 0, getattr(log, "n_rows", None)
    for part in parts:
        yield part
        done += len(part)
        whole = done + ROWS_OF_PART if known is None else max(done, known)
        report_progress(progress, phase, done, whole)


def kind_of(path: Path) -> str:
    """What kind of log is at a path."""
    if is_lerobot(path):
        return "LeRobot dataset"
    if path.is_dir():
        return "ROS 2 bag" if (path / "metadata.yaml").exists() else "Parquet folder"
    return FORMATS.get(path.suffix.lower(), (path.suffix,))[0]


def _clock(
    columns: tuple[ColumnContent, ...], time: TimeColumn | None, rows: int
) -> tuple[float | None, float | None]:
    column = next((c for c in columns if time is not None and c.name == time.name), None)
    if time is None or column is None or column.least is None or column.most is None:
        return None, None
    duration = (column.most - column.least) * time.scale
    return duration, (rows - 1) / duration if duration > 0.0 and isfinite(duration) else None
