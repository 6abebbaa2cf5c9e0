"""Logs in Apache Parquet, through Polars."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.log import PART, Rows, require_columns, require_file

if TYPE_CHECKING:
    import polars


@dataclass(frozen=True)
class ParquetLog:
    """A Parquet file; only the row groups and columns asked for are read.

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
        """
        require_file(path)
        with _explained(path, "the file cannot be read as Parquet"):
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
        """The rows asked for, in parts; see `Log`."""
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
            return _scan(self.path).select(numbers).slice(start, length).collect().to_numpy()


@contextmanager
def _explained(path: Path, wrong: str) -> Iterator[None]:
    """Turn what Polars raises into our errors, its panics at broken files too."""
    from polars.exceptions import PanicException, PolarsError

    try:
        yield
    except (PolarsError, OSError, PanicException, MemoryError, OverflowError) as error:
        raise LogError(
            f"{wrong} ({_first_line(error)})",
            where=str(path),
            mend="copy or convert it again; columns must hold one number a row, and a log in text "
            "form needs the suffix .csv",
        ) from error


def _scan(path: Path) -> "polars.LazyFrame":
    import polars as pl

    return pl.scan_parquet(path, glob=False, cache=False)


def _first_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
