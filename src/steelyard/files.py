"""Writing files and folders that are there whole or not at all."""

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

from steelyard.arrays import Array
from steelyard.errors import OutputError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary file beside `path` that takes its place when the block ends without an error."""
    part = _beside(path)
    with _explained(path):
        try:
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path` that takes its place when the block ends without an error.

    Raises:
        OutputError: `path` is there and not an empty folder, or cannot be written.
    """
    part = _beside(path)
    with _explained(path):
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise OutputError(
                f"'{path}' exists already",
                where=str(path),
                mend="name another folder, or remove this one",
            )
        part.mkdir(parents=True)
        try:
            yield part
            if path.exists():
                path.rmdir()
            part.rename(path)
        finally:
            shutil.rmtree(part, ignore_errors=True)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write `values` as indented JSON."""
    with whole_file(path) as part:
        part.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def write_table(path: Path, columns: Mapping[str, Array]) -> None:
    """Write columns as Parquet or CSV, by the name's ending."""
    import polars

    if path.suffix not in (".parquet", ".csv"):
        raise OutputError(
            f"a log cannot be written as '{path.suffix}'",
            where=str(path),
            mend="end its name in .parquet or .csv",
        )
    table = polars.DataFrame(dict(columns))
    with whole_file(path) as part:
        if path.suffix == ".csv":
            table.write_csv(part)
        else:
            table.write_parquet(part)


def _beside(path: Path) -> Path:
    """A hidden name in the same folder that no other run uses."""
    return path.absolute().parent / f".{path.name}.{uuid4().hex[:8]}.part"


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn the system's refusals into ours."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot be written: {error.strerror or error}",
            where=str(path),
            mend="check the path, its permissions and the space left",
        ) from error
