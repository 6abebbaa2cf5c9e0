"""The formats of logs: which reader opens which suffix, and the writers of tables."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from struct import pack
from tempfile import TemporaryFile
from typing import IO
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from steelyard.base.arrays import Array, distinct_texts
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError, OutputError
from steelyard.base.files import csv_text, refuse_existing, whole_file
from steelyard.logs.clocks_and_combined_logs import WholeClocks
from steelyard.logs.hdf5_matlab import open_hdf5, open_mat
from steelyard.logs.lerobot import is_lerobot, open_lerobot
from steelyard.logs.log_and_errors import Log, require_file
from steelyard.logs.messages.message_log import MessageLog
from steelyard.logs.messages.ros2_bag import METADATA
from steelyard.logs.named_arrays_and_numpy_files import open_npy, open_npz
from steelyard.logs.parquet import ParquetLog, require_polars
from steelyard.logs.text_table import DelimitedLog

FORMATS: dict[str, tuple[str, Callable[[Path], Log]]] = {
    ".parquet": ("Parquet", ParquetLog.open),
    ".csv": ("text table", DelimitedLog.open),
    ".tsv": ("text table", DelimitedLog.open),
    ".txt": ("text table", DelimitedLog.open),
    ".npz": ("NumPy archive", open_npz),
    ".npy": ("NumPy array", open_npy),
    ".mat": ("MATLAB", open_mat),
    ".h5": ("HDF5", open_hdf5),
    ".hdf5": ("HDF5", open_hdf5),
    ".mcap": ("MCAP", MessageLog.open),
    ".bag": ("ROS 1 bag", MessageLog.open),
    ".active": ("ROS 1 bag", MessageLog.open),
    ".db3": ("ROS 2 bag", MessageLog.open),
    ".zstd": ("ROS 2 bag", MessageLog.open),
}
"""Suffix to what such files are, and the opener."""


@checked()
def open_log(path: str | Path) -> Log:
    """The log in a file, a ROS 2 bag's folder, a LeRobot dataset, or a folder of Parquet files.

    Raises:
        LogError: Not there, of an unknown kind, or not what its suffix says.

    Example:
        >>> open_log("fit.csv").columns[0]
        'time_s'
    """
    path = Path(path)
    if path.is_dir():
        if (path / METADATA).is_file():
            return MessageLog.open(path)
        if is_lerobot(path):
            return WholeClocks.of(open_lerobot(path))
        return WholeClocks.of(ParquetLog.of_folder(path))
    require_file(path)
    if path.suffix.lower() not in FORMATS:
        raise LogError(
            f"logs of the kind '{path.suffix or path.name}' are not known",
            where=str(path),
            fix=f"give a file that ends in one of {', '.join(FORMATS)}",
        )
    log = FORMATS[path.suffix.lower()][1](path)
    return log if isinstance(log, MessageLog) else WholeClocks.of(log)


Write = Callable[[Array], None]
Writer = Callable[[Path, Sequence[str]], AbstractContextManager[Write]]
"""Opens a file for columns; what it gives appends rows, shape `(N, number of columns)`."""

LONGEST_VARIABLE = (1 << 31) - 1
GROUP = 10_000
"""Rows of Parquet's row groups; Polars holds more of them at a time the more cores there are."""


def writer_for(path: Path) -> Writer:
    """The writer for the suffix of a file that is not there yet."""
    writer = _writer(path)
    refuse_existing(path)
    return writer


def write_table(path: Path, columns: Mapping[str, Array]) -> None:
    """Write columns of numbers, shape `(N,)`, by the file's suffix; a file there is replaced."""
    writer = _writer(path)
    with whole_file(path) as part, writer(part, tuple(columns)) as write:
        write(np.column_stack(list(columns.values())))


def _writer(path: Path) -> Writer:
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise OutputError(
            f"a log cannot be written as '{path.suffix or path.name}'",
            where=str(path),
            fix=f"end its name in one of {', '.join(WRITERS)}",
        )
    if writer is parquet:
        require_polars(path)
    return writer


@contextmanager
def text_table(path: Path, columns: Sequence[str]) -> Iterator[Write]:
    """CSV, with the shortest digits that read back as the same float."""
    with path.open("wb") as file:
        file.write(csv_text([(" ".join(c.split()) for c in columns)]).encode())

        def write(part: Array) -> None:
            file.write(csv_text(part.tolist()).encode())

        yield write


@contextmanager
def parquet(path: Path, columns: Sequence[str]) -> Iterator[Write]:
    """Parquet, by Polars; its threads fetch the rows, which a reader of SQLite could not serve."""
    import polars as pl
    from polars.io.plugins import register_io_source

    _require_distinct(path, columns)
    schema = dict.fromkeys(columns, pl.Float64)
    with _Spool(path, len(columns)) as spool:
        yield spool.write

        def drawn(*_: object) -> "Iterator[pl.DataFrame]":
            for block in spool.blocks():
                yield pl.DataFrame(block.T, schema=schema, orient="row")

        try:
            register_io_source(drawn, schema=schema).sink_parquet(
                path, compression="uncompressed", statistics=False, row_group_size=GROUP
            )
        except pl.exceptions.ComputeError as error:
            raise OSError(str(error)) from error


@contextmanager
def npz(path: Path, columns: Sequence[str]) -> Iterator[Write]:
    """NumPy's archive, one vector a column."""
    _require_distinct(path, columns)
    with _Spool(path, len(columns)) as spool:
        yield spool.write
        with ZipFile(path, "w", ZIP_DEFLATED, compresslevel=1) as archive:
            for place, name in enumerate(columns):
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    header = {"descr": "<f8", "fortran_order": False, "shape": (spool.rows,)}
                    np.lib.format.write_array_header_1_0(member, header)
                    for block in spool.column(place):
                        member.write(block)


@contextmanager
def mat(path: Path, columns: Sequence[str]) -> Iterator[Write]:
    """MATLAB's version 5, one vector a column; names become variables, as `matlab_names` says."""
    names = matlab_names(columns)
    with _Spool(path, len(columns)) as spool, path.open("wb") as file:
        yield spool.write
        size = 8 * spool.rows
        if size + 256 > LONGEST_VARIABLE:
            raise OutputError(
                f"{spool.rows} rows are too many for MATLAB's version 5",
                where=str(path),
                fix="write .h5 instead, which MATLAB reads with h5read",
            )
        file.write(b"MATLAB 5.0 MAT-file, written by steelyard".ljust(116) + bytes(8))
        file.write(pack("<H2s", 0x0100, b"IM"))
        for place, name in enumerate(names):
            flags, shape = pack("<4I", 6, 8, 6, 0), pack("<4I", 5, 8, spool.rows, 1)
            text = name.encode()
            padded = pack("<2I", 1, len(text)) + text + bytes(-len(text) % 8)
            head = flags + shape + padded + pack("<2I", 9, size)
            file.write(pack("<2I", 14, len(head) + size) + head)
            for block in spool.column(place):
                file.write(block)


@contextmanager
def hdf5(path: Path, columns: Sequence[str]) -> Iterator[Write]:
    """HDF5, one dataset a column; a `/` in a name makes a group."""
    import h5py  # type: ignore[import-untyped]

    _require_distinct(path, columns)
    # without its cache, which crashes at the end if the disk is full then
    with h5py.File(path, "w", track_order=True, rdcc_nbytes=0) as file:
        try:
            data = [
                file.create_dataset(name, (0,), "<f8", maxshape=(None,), chunks=(1 << 14,))
                for name in columns
            ]
        except (ValueError, OSError, KeyError, TypeError) as error:
            raise OutputError(
                f"the columns' names cannot be paths in HDF5 ({error})",
                where=str(path),
                fix="choose others with --columns, or write .parquet",
            ) from error

        def write(part: Array) -> None:
            for dataset, values in zip(data, part.T, strict=True):
                dataset.resize((len(dataset) + len(part),))
                dataset[len(dataset) - len(part) :] = values
            file.flush()

        yield write


WRITERS: dict[str, Writer] = {
    ".csv": text_table,
    ".parquet": parquet,
    ".npz": npz,
    ".mat": mat,
    ".h5": hdf5,
}
"""Suffix to writer."""


def matlab_names(columns: Sequence[str]) -> list[str]:
    """Names that MATLAB allows: letters, digits and `_`, a letter first, 63 at most, distinct."""
    plain = (re.sub(r"\W+", "_", column, flags=re.ASCII).strip("_") for column in columns)
    return distinct_texts((name if name[:1].isalpha() else f"x{name}" for name in plain), 63)


class _Spool(AbstractContextManager["_Spool"]):
    """Rows on disk until their number is known, then handed out column by column."""

    def __init__(self, path: Path, width: int) -> None:
        self.rows = 0
        self._width = width
        self._parts: list[tuple[int, int]] = []
        self._file: IO[bytes] = TemporaryFile(dir=path.parent)

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def write(self, part: Array) -> None:
        for at in range(0, len(part), GROUP):
            few = part[at : at + GROUP]
            self._parts.append((self._file.tell(), len(few)))
            self._file.write(np.ascontiguousarray(few.T, dtype="<f8").data)
            self.rows += len(few)

    def blocks(self) -> Iterator[Array]:
        """The rows, in arrays of shape `(number of columns, at most GROUP)`."""
        for start, rows in self._parts:
            self._file.seek(start)
            block = self._file.read(8 * rows * self._width)
            yield np.frombuffer(block, "<f8").reshape(self._width, rows)

    def column(self, place: int) -> Iterator[bytes]:
        """The floats of a column as bytes, in the parts they came in."""
        for start, rows in self._parts:
            self._file.seek(start + 8 * rows * place)
            yield self._file.read(8 * rows)


def _require_distinct(path: Path, columns: Sequence[str]) -> None:
    twice = next((c for c in columns if list(columns).count(c) > 1), None)
    if twice is not None:
        raise OutputError(
            f"two columns would be called '{twice}'",
            where=str(path),
            fix="choose columns with --columns",
        )
