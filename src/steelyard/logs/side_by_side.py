"""Logs of one clock as one table: row k of each is one row."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.logs.log import ROWS_OF_PART, Log, RowRange, require_columns


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
