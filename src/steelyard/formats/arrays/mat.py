"""MATLAB's `.mat`: version 5 read here, version 7.3 as the HDF5 that it is."""

from pathlib import Path

from steelyard.errors import LogError
from steelyard.formats.arrays.arrays_log import ArraysLog
from steelyard.formats.arrays.hdf5 import open_hdf5
from steelyard.formats.arrays.mat5 import HEADER, byte_order, mat5_arrays
from steelyard.formats.arrays.packed import explained, packed_log
from steelyard.formats.log import require_file


def open_mat(path: Path) -> ArraysLog:
    """The matrices of a file as a table; a struct's field is called `data.q`.

    Raises:
        LogError: Not there, not of MATLAB, or without a table.
    """
    require_file(path)
    with path.open("rb") as file:
        header = file.read(HEADER)
    if header[124:128] in (b"\x00\x02IM", b"\x02\x00MI"):
        return open_hdf5(path, matlab=True)
    try:
        byte_order(header)
    except ValueError:
        raise LogError(
            "the file is no MATLAB file of version 5 or later",
            where=str(path),
            fix="save it in MATLAB with save(..., '-v7') or '-v7.3'",
        ) from None
    with explained(path):
        arrays = list(mat5_arrays(path))
    return packed_log(path, arrays)
