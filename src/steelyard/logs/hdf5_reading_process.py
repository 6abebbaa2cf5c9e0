"""Reads HDF5 in a process of its own: a broken file crashes libhdf5 now and then.

Run as `python -m steelyard.logs.hdf5_reading_process`; what is wanted comes as JSON on standard
input. Without rows it answers with the datasets as JSON, else with rows of 64-bit floats.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from math import prod
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np

from steelyard.base.arrays import Array
from steelyard.logs.named_arrays_and_numpy_files import (
    ColumnPlace,
    NamedArray,
    joined,
    member_of,
    picked,
    record_fields,
)

DEFLATE, SHUFFLE, FLETCHER32, SZIP, NBIT, SCALE_OFFSET, LZF = 1, 2, 3, 4, 5, 6, 32000
FILTERS = frozenset((DEFLATE, SHUFFLE, FLETCHER32, SZIP, NBIT, SCALE_OFFSET, LZF))
LARGEST_CHUNK = 1 << 25  # bytes of a chunk, which is decoded whole
LARGEST_RATIO = 1100  # how much a byte of a file can stand for, about
UNSTORED = 1 << 26  # bytes that a dataset may declare without storing anything of them
MOST_DATASETS = 20_000


def main() -> None:
    """Answer the request on standard input."""
    request = json.loads(sys.stdin.read())
    try:
        with h5py.File(request["path"], "r", rdcc_nbytes=1 << 22) as file:
            if request.get("rows") is None:
                found = _datasets(file, request["matlab"])
                sys.stdout.write(json.dumps([asdict(member) for member in found]))
            else:
                for part in _rows(file, request):
                    sys.stdout.buffer.write(np.ascontiguousarray(part).data)
    except BrokenPipeError:
        sys.exit(1)
    except Exception as error:
        sys.exit(" ".join(str(error).split())[:300] or type(error).__name__)


def _datasets(file: h5py.File, matlab: bool) -> Iterator[NamedArray]:
    """What is in a file, links to elsewhere included, which are not followed."""
    waiting: list[tuple[str, h5py.Group]] = [("", file)]
    seen: set[Any] = set()
    count = 0
    while waiting:
        path, group = waiting.pop(0)
        for name in group:
            count += 1
            if count > MOST_DATASETS:
                raise ValueError(f"the file has more than {MOST_DATASETS} entries")
            full = f"{path}{name}"
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                yield NamedArray(
                    full, (), left_out="it is a link to another file, which is not followed"
                )
            if not isinstance(link, h5py.HardLink) or (matlab and not path and name[0] == "#"):
                continue
            entry = group[name]
            mark = h5py.h5o.get_info(entry.id).addr
            if mark in seen:
                continue
            seen.add(mark)
            if isinstance(entry, h5py.Group):
                waiting.append((f"{full}{'.' if matlab else '/'}", entry))
            elif isinstance(entry, h5py.Dataset):
                yield _found(full, entry, matlab)


def _found(name: str, data: h5py.Dataset, matlab: bool) -> NamedArray:
    if why := _refused(data) or (_not_numbers_in_matlab(data) if matlab else ""):
        return NamedArray(name, (), left_out=why)
    shape = tuple(data.shape or ())
    shape = () if matlab and shape == (1, 1) else shape
    return member_of(name, data.dtype, shape, f"{name}/")


def _refused(data: h5py.Dataset) -> str:
    """Why a dataset is not read: it would make us read other files, load code, or fill memory."""
    properties = data.id.get_create_plist()
    filters = [properties.get_filter(k)[0] for k in range(properties.get_nfilters())]
    size = prod(data.shape or ()) * data.dtype.itemsize
    if data.is_virtual:
        return "it is a virtual dataset, whose numbers are in other files"
    if data.external:
        return "its numbers are in another file"
    if unknown := set(filters) - FILTERS:
        return f"its numbers went through filter {min(unknown)}, which HDF5 does not come with"
    if data.chunks and prod(data.chunks) * data.dtype.itemsize > LARGEST_CHUNK:
        return "its chunks are larger than 32 MiB; repack it with h5repack -l CHUNK=..."
    if size > UNSTORED and size > LARGEST_RATIO * data.id.get_storage_size():
        return "its declared size is much larger than its stored data"
    return ""


def _not_numbers_in_matlab(data: h5py.Dataset) -> str:
    kind = data.attrs.get("MATLAB_class", b"")
    text = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
    if "MATLAB_empty" in data.attrs:
        return "it is empty"
    numeric = text in ("", "double", "single", "logical") or text.lstrip("u").startswith("int")
    return "" if numeric else f"it is of MATLAB's class {text}"


def _rows(file: h5py.File, request: dict[str, Any]) -> Iterator[Array]:
    """Rows of components: `columns` holds name, axis and component of each."""
    start, stop = request["rows"]
    size = request["size"]

    def slabs(name: str, axis: int, components: list[int]) -> Iterator[Array]:
        data = file[name]
        fields = record_fields(data.dtype)
        for at in range(start, stop, size):
            rows = slice(at, min(stop, at + size))
            block = data[rows] if axis == 0 else data[:, rows].T
            yield picked(block if block.ndim == 2 or fields else block[:, None], components, fields)

    return joined([ColumnPlace(*c) for c in request["columns"]], (start, stop), size, slabs)


if __name__ == "__main__":
    main()
