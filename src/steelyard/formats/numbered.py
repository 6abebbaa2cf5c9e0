"""A log without a clock: its rows are numbered, for a robot file that says their rate."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.formats.log import PART, Log, Rows
from steelyard.robot_file.signals import ROW


@dataclass(frozen=True, eq=False)
class Numbered:
    """A log with the numbers of its rows, from zero, as one more column.

    Attributes:
        log: As it is on disk.
    """

    log: Log

    @property
    def path(self) -> Path:
        """Where it is."""
        return self.log.path

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns, and `ROW`."""
        return (*self.log.columns, ROW)

    def parts(
        self, columns: Sequence[str], rows: Rows = (0, None), size: int = PART
    ) -> Iterator[Array]:
        """The requested rows; see `Log.parts`."""
        logged = [column for column in columns if column != ROW]
        start = rows[0]
        for part in self.log.parts(logged or self.log.columns[:1], rows, size):
            numbers = np.arange(start, start + len(part), dtype=np.float64)
            start += len(part)
            named = dict(zip(logged, part.T, strict=False)) | {ROW: numbers}
            yield np.column_stack([named[column] for column in columns])
