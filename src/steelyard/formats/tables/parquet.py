"""Logs in Apache Parquet, through Polars."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.extras import require
from steelyard.formats.log import PART, Rows, require_columns, require_file
from steelyard.formats.tables.parquet_pages import ORDINARY, longest_page

if TYPE_CHECKING:
    import polars

DECODED = 1 << 21
"""Values in pages that are decoded side by side."""
LONGEST_PAGE = DECODED
"""Values of a page."""
WIDEST = 1 << 16


@dataclass(frozen=True)
class ParquetLog:
    """A Parquet file; only the requested row groups and columns are read.

    Attributes:
        path: Where it is.
        columns: Names of its columns.
    """

    path: Path
    columns: tuple[str, ...]

    @classmethod
    def open(cls, path: Path) -> "ParquetLog":
        """Read the names of the columns.

        Raises:
            LogError: Not there, or not Parquet.
            PackageError: Polars is not installed.
        """
        require_file(path)
        require_polars(path)
        with _explained(path, "the file cannot be read as Parquet"):
            _together(path)
            return cls(path, tuple(_scan(path).collect_schema().names()))

    @property
    def n_rows(self) -> int:
        """Number of rows, as the file's end says it."""
        import polars as pl

        with _explained(self.path, "the file cannot be read as Parquet"):
            return int(_scan(self.path).select(pl.len()).collect().item())

    def parts(
        self, columns: Sequence[str], rows: Rows = (0, None), size: int = PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        require_columns(self.path, self.columns, columns)
        start, stop = rows
        while stop is None or start < stop:
            length = size if stop is None else min(size, stop - start)
            part = self._read(columns, start, length)
            height = len(part)
            if height:
                yield part
            del part
            if height < length:
                return
            start += length

    def _read(self, columns: Sequence[str], start: int, length: int) -> Array:
        import polars as pl

        numbers = [pl.col(c).cast(pl.Float64, strict=False) for c in columns]
        with _explained(self.path, f"rows {start} to {start + length} cannot be read"):
            width = _together(self.path)
            tables = [
                _scan(self.path).select(numbers[at : at + width]).slice(start, length).collect()
                for at in range(0, len(numbers), width)
            ]
            return tables[0].to_numpy() if len(tables) == 1 else np.hstack(tables)


def require_polars(path: Path) -> None:
    """Refuse a Parquet file without Polars.

    Raises:
        PackageError: Polars is not installed.
    """
    require("polars", "polars", "Parquet files", str(path))


def _together(path: Path) -> int:
    """How many columns can be read side by side: their pages are decoded whole.

    Raises:
        ValueError: One is too many, or the file is broken.
    """
    stat = path.stat()
    values = longest_page(path.resolve(), stat.st_mtime_ns, stat.st_size)
    if values > LONGEST_PAGE:
        raise ValueError(
            f"one of its pages holds {values} values, where {LONGEST_PAGE} are as many as are read"
        )
    return DECODED // max(1, values) if values > ORDINARY else WIDEST


@contextmanager
def _explained(path: Path, wrong: str) -> Iterator[None]:
    """Turn what Polars raises into our errors, its panics at broken files too."""
    from polars.exceptions import PanicException, PolarsError

    try:
        yield
    except (PolarsError, OSError, PanicException, MemoryError, OverflowError, ValueError) as error:
        raise LogError(
            f"{wrong} ({_first_line(error)})",
            where=str(path),
            fix="copy or convert it again; columns must hold one number a row, and a log in text "
            "form needs the suffix .csv",
        ) from error


def _scan(path: Path) -> "polars.LazyFrame":
    import polars as pl

    return pl.scan_parquet(path, glob=False, cache=False)


def _first_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
