"""A folder of Parquet files that continue each other, as Spark, Hive or a recorder leaves it."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.log import PART, Rows, require_columns
from steelyard.formats.tables.parquet import ParquetLog


@dataclass(frozen=True)
class PartitionedParquet:
    """Files of a folder and of those in it as one log, in the natural order of their names.

    `part-2.parquet` comes before `part-10.parquet`; names that start with `.` or `_` are passed
    over.

    Attributes:
        path: The folder.
        columns: Names of the columns, the same in all files.
        files: Its files, in order.
    """

    path: Path
    columns: tuple[str, ...]
    files: tuple[ParquetLog, ...]

    @classmethod
    def open(cls, path: Path) -> "PartitionedParquet":
        """Find the files and compare their columns.

        Raises:
            LogError: There are none, one cannot be read, or two have other columns.
        """
        try:
            found = [p for p in path.rglob("*") if p.suffix.lower() == ".parquet" and p.is_file()]
        except OSError as error:
            raise LogError(
                f"the folder cannot be read ({error.strerror or error})",
                where=str(path),
                fix="check its permissions",
            ) from error
        names = {p: p.relative_to(path).parts for p in found}
        named = [p for p in found if not any(part[0] in "._" for part in names[p])]
        if not named:
            raise LogError(
                "the folder holds no log",
                where=str(path),
                fix="name a log file, a folder of .parquet files, or the folder of a ROS 2 bag, "
                "which holds its metadata.yaml",
            )

        def order(file: Path) -> tuple[object, ...]:
            return natural((*names[file][:-1], file.stem))

        files = [ParquetLog.open(p) for p in sorted(named, key=order)]
        for file in files[1:]:
            _require_same(files[0], file)
        return cls(path, files[0].columns, tuple(files))

    @property
    def n_rows(self) -> int:
        """Number of rows of all files."""
        return sum(file.n_rows for file in self.files)

    def parts(
        self, columns: Sequence[str], rows: Rows = (0, None), size: int = PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        require_columns(self.path, self.columns, columns)
        start, stop = rows
        for file in self.files:
            height = file.n_rows if start > 0 or stop is not None else 0
            yield from file.parts(columns, (start, stop), size)
            start = max(0, start - height)
            stop = None if stop is None else max(0, stop - height)
            if stop == 0:
                return


def natural(names: Sequence[str]) -> tuple[tuple[tuple[int, int | str], ...], ...]:
    """A key that sorts numbers in names as numbers."""
    return tuple(
        tuple(
            (0, int(piece)) if piece.isdecimal() else (1, piece)
            for piece in re.split(r"(\d+)", name)
        )
        for name in names
    )


def _require_same(first: ParquetLog, other: ParquetLog) -> None:
    absent = [c for c in first.columns if c not in other.columns]
    new = [c for c in other.columns if c not in first.columns]
    if absent or new:
        differ = [*(f"no '{c}'" for c in absent[:3]), *(f"also '{c}'" for c in new[:3])]
        raise LogError(
            f"two files of the log have other columns: the second has {', '.join(differ)}",
            where=f"{first.path} and {other.path}",
            fix="keep the files of one log in a folder of their own",
        )
