"""What is in a log: rows, time, and for each column its kind, its range and what is missing."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.formats.cut import Cut
from steelyard.formats.log import PART, Log
from steelyard.formats.window import TimeColumn, time_column, windowed
from steelyard.progress import Progress, report_progress, silent
from steelyard.robot_file.column_names import Column

KINDS = {
    ".csv": "text table",
    ".tsv": "text table",
    ".txt": "text table",
    ".parquet": "Parquet",
    ".npz": "NumPy archive",
    ".npy": "NumPy array",
    ".mat": "MATLAB",
    ".h5": "HDF5",
    ".hdf5": "HDF5",
    ".mcap": "MCAP",
    ".db3": "ROS 2 bag",
    ".zstd": "ROS 2 bag",
    ".bag": "ROS 1 bag",
}
"""What files are, by their suffix."""


@dataclass(frozen=True)
class ColumnContent:
    """What is in a column.

    Attributes:
        name: Its name.
        kind: The quantity that its name speaks of, empty if none.
        first: Its first value; `None` if that is missing or there are no rows.
        least: Least finite value; `None` if there is none.
        most: Greatest finite value.
        missing: Share of cells that hold no finite number.
    """

    name: str
    kind: str
    first: float | None
    least: float | None
    most: float | None
    missing: float


@dataclass(frozen=True)
class LogContent:
    """What is in a log.

    Attributes:
        path: Where it is, with its cut.
        format: What kind of file it is.
        size: Bytes on disk.
        rows: Number of rows.
        time: The column of time, if one looks like it.
        duration: From least to greatest time [s].
        rate: Rows per second over all of it [Hz].
        columns: What is in each column.
        left_out: Name and reason of what the file holds beside its table.
        topics: Topics of a log of messages: name, type, number of messages, rate.
        remarks: What a user should know about the file's state.
    """

    path: str
    format: str
    size: int
    rows: int
    time: TimeColumn | None
    duration: float | None
    rate: float | None
    columns: tuple[ColumnContent, ...]
    left_out: tuple[tuple[str, str], ...]
    topics: tuple[dict[str, Any], ...]
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        left_out = [{"name": name, "why": why} for name, why in self.left_out]
        return {**asdict(self), "left_out": left_out}


class Tally:
    """First value, range and missing values of columns, part by part."""

    def __init__(self, width: int) -> None:
        self.rows = 0
        self.first: list[float] = []
        self.least, self.most = np.full(width, inf), np.full(width, -inf)
        self.missing = np.zeros(width, dtype=np.int64)

    def add(self, part: Array) -> None:
        """Count the rows of a part, shape `(N, width)` with N > 0."""
        finite = np.isfinite(part)
        self.first = self.first or part[0].tolist()
        self.rows += len(part)
        self.missing += (~finite).sum(axis=0)
        self.least = np.minimum(self.least, np.where(finite, part, inf).min(axis=0))
        self.most = np.maximum(self.most, np.where(finite, part, -inf).max(axis=0))

    def column(self, name: str, place: int) -> ColumnContent:
        """What was found in a column."""
        first = self.first[place] if self.first else inf
        least, most = float(self.least[place]), float(self.most[place])
        return ColumnContent(
            name,
            Column(name).quantity or "",
            first if isfinite(first) else None,
            least if isfinite(least) else None,
            most if isfinite(most) else None,
            float(self.missing[place]) / max(1, self.rows),
        )


def content_of(log: Log, cut: Cut = Cut(), progress: Progress = silent) -> LogContent:  # noqa: B008
    """Read a log, or a window of it, once from front to back.

    Raises:
        LogError: It cannot be read.
    """
    counts = Counter(log.columns)
    names = tuple(name for name, count in counts.items() if count == 1)
    time = time_column(log, names)
    tally = Tally(len(names))
    for part in with_progress(windowed(log, names, cut), log, progress, "reading the log"):
        tally.add(part)
    columns = tuple(tally.column(name, place) for place, name in enumerate(names))
    duration, rate = _clock(columns, time, tally.rows)
    twice = tuple((n, f"{k} columns are called so") for n, k in counts.items() if k > 1)
    return LogContent(
        path=f"{log.path}{cut.text}",
        format=kind_of(log.path),
        size=size_of(log.path),
        rows=tally.rows,
        time=time,
        duration=duration,
        rate=rate,
        columns=columns,
        left_out=(*getattr(log, "left_out", ()), *twice),
        topics=tuple(_topic(topic) for topic in getattr(log, "topics", ())),
        remarks=tuple(getattr(log, "remarks", ())),
    )


def with_progress(
    parts: Iterator[Array], log: Log, progress: Progress, phase: str
) -> Iterator[Array]:
    """Parts of a log as they come, with events of progress."""
    known = getattr(log, "n_rows", None)
    done = 0
    for part in parts:
        yield part
        done += len(part)
        report_progress(
            progress, phase, done, max(done, known if known is not None else done + PART)
        )


def kind_of(path: Path) -> str:
    """What kind of log is at a path."""
    if path.is_dir():
        return "ROS 2 bag" if (path / "metadata.yaml").exists() else "Parquet folder"
    return KINDS.get(path.suffix.lower(), path.suffix)


def size_of(path: Path) -> int:
    """Bytes of a file, or of the files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _clock(
    columns: tuple[ColumnContent, ...], time: TimeColumn | None, rows: int
) -> tuple[float | None, float | None]:
    """Duration and rate."""
    column = next((c for c in columns if time is not None and c.name == time.name), None)
    if time is None or column is None or column.least is None or column.most is None:
        return None, None
    duration = (column.most - column.least) * time.scale
    return duration, (rows - 1) / duration if duration > 0.0 and isfinite(duration) else None


def _topic(topic: Any) -> dict[str, Any]:
    return {
        "name": topic.name,
        "type": topic.type,
        "count": topic.count,
        "rate": topic.rate,
        "problem": topic.problem,
    }
