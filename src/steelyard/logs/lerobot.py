"""Datasets of LeRobot, versions 2 and 3: folders of Parquet files whose episodes are runs.

`meta/info.json` names the elements of every feature; `data/` holds the rows, an episode a file in
version 2, many in version 3. Only numbers are read: no video and no image.
"""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import ROWS_OF_PART, RowRange, reading
from steelyard.logs.parquet import Element, ParquetLog

INFO = Path("meta", "info.json")
EPISODE, TIME = "episode_index", "timestamp"
PAUSE = 10.0  # between the clocks of two episodes [s]
SHOWN_EPISODES = 8
LARGEST_INFO = 1 << 24  # bytes
LARGEST_EPISODE_NUMBER = 1 << 31


def is_lerobot(path: Path) -> bool:
    """Whether a folder is a dataset of LeRobot."""
    return (path / INFO).is_file()


class Dataset:
    """The rows of all episodes, one after the other, with one clock.

    The clock of every episode starts at zero; here each begins `PAUSE` after the end of the one
    before, which is a gap of the log. Columns are called by feature and element:
    `action.elbow_flex.pos`.

    Attributes:
        episodes: First row of each episode and the row after its last one.
        starts: What the clock of each is shifted by [s].
    """

    def __init__(
        self, path: Path, table: ParquetLog, episodes: tuple[tuple[int, int], ...], starts: Array
    ) -> None:
        self.path, self.table, self.episodes, self.starts = path, table, episodes, starts
        self.columns, self.n_rows, self.left_out = table.columns, table.n_rows, table.left_out
        listed = [f"#{first}:{last}" for first, last in episodes[:SHOWN_EPISODES]]
        more = ", ..." * (len(episodes) > SHOWN_EPISODES)
        self.remarks = (f"{len(episodes)} episodes, each a run: {', '.join(listed)}{more}",)

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        times = [k for k, column in enumerate(columns) if column == TIME]
        ends, done = np.array([last for _, last in self.episodes], dtype=int), rows[0]
        for part in self.table.parts(columns, rows, size):
            number = np.searchsorted(ends, np.arange(done, done + len(part)), side="right")
            part[:, times] += self.starts[np.minimum(number, len(ends) - 1)][:, None]
            done += len(part)
            yield part


def open_lerobot(path: Path) -> Dataset:
    """The dataset in a folder.

    Raises:
        LogError: The description or the rows cannot be read, or episodes are not one by one.
    """
    files = [path / INFO, *sorted((path / "data").rglob("*"))]
    with reading(path):
        states = [(file, file.stat()) for file in files]
    return _opened(path, tuple((file, s.st_mtime_ns, s.st_size) for file, s in states))


@lru_cache(maxsize=16)
def _opened(path: Path, files: tuple[tuple[Path, int, int], ...]) -> Dataset:
    """The dataset as its files were; it is opened for each of its episodes."""
    features = _features(path)
    data = path / "data"
    if not data.is_dir():
        raise LogError(
            "the dataset has no folder data with its rows",
            where=str(path),
            fix="fetch the whole dataset; videos are not needed",
        )
    log = ParquetLog.of_folder(data)
    names: dict[str, str] = {}
    for column in log.columns:
        element = log.elements.get(column, Element(column, 0, 0))
        feature = features.get(element.column)
        if element.length == 1:
            names[column] = element.column
        elif element.length:
            labels = _labels(feature, element.length)
            names[column] = f"{element.column}.{labels[element.number]}"
        elif isinstance(feature, dict) and feature.get("dtype") in ("image", "video", "string"):
            names[column] = ""
    counts = Counter(names.get(column, column) for column in log.columns)
    table = log.renamed({c: name for c, name in names.items() if not name or counts[name] == 1})
    return Dataset(path, table, *_episodes(path, table))


def _episodes(path: Path, table: ParquetLog) -> tuple[tuple[tuple[int, int], ...], Array]:
    """Rows of every episode, and by how much its clock is shifted."""
    absent = [f"'{column}'" for column in (EPISODE, TIME) if column not in table.columns]
    if absent:
        raise LogError(
            f"the dataset has no column {' and no '.join(absent)}",
            where=str(path),
            fix="export it again, or give its Parquet files one by one",
        )
    found = np.concatenate([*table.parts([EPISODE, TIME]), np.zeros((0, 2))])
    numbers, times = found.T
    bad = ~(np.abs(numbers) < LARGEST_EPISODE_NUMBER)
    if bad.any():
        raise _unusable(path, f"row {int(np.argmax(bad))} has no number of its episode")
    ends = [*(np.flatnonzero(np.diff(numbers)) + 1).tolist(), len(numbers)]
    if len(np.unique(numbers)) < len(ends) or not len(numbers):
        apart = "the rows of an episode are not together"
        raise _unusable(path, apart if len(numbers) else "the log has no rows")
    rows = tuple(zip([0, *ends[:-1]], ends, strict=True))
    starts, last = [], -PAUSE
    for first, stop in rows:
        own = times[first:stop][np.isfinite(times[first:stop])]
        starts.append(last + PAUSE - float(own.min()) if len(own) else 0.0)
        last = float(own.max()) + starts[-1] if len(own) else last
    return rows, np.array(starts)


def _unusable(path: Path, wrong: str) -> LogError:
    fix = "export the dataset again, or give its Parquet files one by one"
    return LogError(wrong, where=str(path), fix=fix)


def _features(path: Path) -> dict[str, Any]:
    file = path / INFO
    with reading(file):
        text = file.read_bytes() if file.stat().st_size <= LARGEST_INFO else b""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _unclear(file, "it is no JSON, or too long") from error
    features = found.get("features") if isinstance(found, dict) else None
    if not isinstance(features, dict):
        raise _unclear(file, "it has no 'features'")
    return features


def _unclear(file: Path, why: str) -> LogError:
    return LogError(
        f"the description of the dataset cannot be used: {why}",
        where=str(file),
        fix="fetch the dataset again; steelyard reads versions 2 and 3 of LeRobot's datasets",
    )


def _labels(feature: Any, length: int) -> Sequence[str]:
    """Names of a feature's elements: a list, or lists in a table; numbers from 1 without them."""
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict):
        several = len(names) > 1
        names = [
            f"{key}_{name}" if several else name
            for key, part in names.items()
            for name in (part if isinstance(part, list) else [part])
        ]
    known = isinstance(names, list) and all(isinstance(name, str) and name for name in names)
    if isinstance(names, list) and known and len(set(names)) == len(names) == length:
        return names
    return [str(k + 1) for k in range(length)]
