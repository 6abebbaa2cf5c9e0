"""The register of formats, and how a log is opened by its suffix."""

from collections.abc import Callable
from pathlib import Path

from steelyard.arguments import checked
from steelyard.errors import LogError
from steelyard.formats.arrays.hdf5 import open_hdf5
from steelyard.formats.arrays.mat import open_mat
from steelyard.formats.arrays.npz import open_npy, open_npz
from steelyard.formats.log import Log, require_file
from steelyard.formats.messages.bag2 import METADATA
from steelyard.formats.messages.message_log import MessageLog
from steelyard.formats.tables.delimited import DelimitedLog
from steelyard.formats.tables.parquet import ParquetLog

FORMATS: dict[str, Callable[[Path], Log]] = {
    ".parquet": ParquetLog.open,
    ".csv": DelimitedLog.open,
    ".tsv": DelimitedLog.open,
    ".txt": DelimitedLog.open,
    ".npz": open_npz,
    ".npy": open_npy,
    ".mat": open_mat,
    ".h5": open_hdf5,
    ".hdf5": open_hdf5,
    ".mcap": MessageLog.open,
    ".bag": MessageLog.open,
    ".active": MessageLog.open,
    ".db3": MessageLog.open,
    ".zstd": MessageLog.open,
}
"""Suffix to opener."""


@checked()
def open_log(path: str | Path) -> Log:
    """The log in a file, a ROS 2 bag's folder, or a folder of Parquet files.

    Raises:
        LogError: Not there, of an unknown kind, or not what its suffix says.

    Example:
        >>> open_log("fit.csv").columns[0]
        'time_s'
    """
    path = Path(path)
    if path.is_dir():
        from steelyard.formats.tables.parquet_folder import PartitionedParquet

        return (MessageLog if (path / METADATA).is_file() else PartitionedParquet).open(path)
    require_file(path)
    opener = FORMATS.get(path.suffix.lower())
    if opener is None:
        raise LogError(
            f"logs of the kind '{path.suffix or path.name}' are not known",
            where=str(path),
            fix=f"give a file that ends in one of {', '.join(FORMATS)}",
        )
    return opener(path)
