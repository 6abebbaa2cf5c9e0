"""The register of formats, and how a log is opened by its suffix."""

from collections.abc import Callable
from pathlib import Path

from steelyard.errors import LogError
from steelyard.formats.delimited import DelimitedLog
from steelyard.formats.log import Log, require_file
from steelyard.formats.parquet import ParquetLog

FORMATS: dict[str, Callable[[Path], Log]] = {
    ".parquet": ParquetLog.open,
    ".csv": DelimitedLog.open,
    ".tsv": DelimitedLog.open,
    ".txt": DelimitedLog.open,
}
"""Suffix to opener."""


def open_log(path: str | Path) -> Log:
    """The log in a file.

    Raises:
        LogError: Not there, of an unknown kind, or not what its suffix says.
    """
    path = Path(path)
    require_file(path)
    opener = FORMATS.get(path.suffix.lower())
    if opener is None:
        raise LogError(
            f"logs of the kind '{path.suffix or path.name}' are not known",
            where=str(path),
            mend=f"give a file that ends in one of {', '.join(FORMATS)}",
        )
    return opener(path)
