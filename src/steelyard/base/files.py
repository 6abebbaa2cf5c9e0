"""Writing files and folders that are there whole or not at all."""

import csv
import io
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import chain, count
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

from steelyard.base.errors import ModelError, OutputError, SteelyardError

Parsed = TypeVar("Parsed")

LARGEST_JSON = 1 << 28  # bytes of the largest JSON file that is read

_unfinished: set[Path] = set()


def remove_unfinished() -> None:
    """Remove what blocks of `whole_file` and `whole_folder` left that were torn down halfway."""
    for part in tuple(_unfinished):
        _remove(part)


def refuse_existing(path: Path) -> None:
    """An `OutputError` where a file would be replaced."""
    if path.exists():
        raise OutputError(
            "the file exists already", where=str(path), fix="name another one, or remove it"
        )


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary file beside `path` that takes its place when the block ends without an error."""
    part = _beside(path)
    with explained(path):
        try:
            yield part
            part.replace(path)
        finally:
            _remove(part)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path` that takes its place when the block ends without an error.

    It is an `OutputError` if `path` is there and not an empty folder, or cannot be written.
    """
    part = _beside(path)
    with explained(path):
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            wrong = f"'{path}' exists already"
            fix = "name another folder, or remove this one"
            raise OutputError(wrong, where=str(path), fix=fix)
        new_parents = [parent for parent in part.parents if not parent.exists()]
        try:
            part.mkdir(parents=True)
            yield part
            if path.exists():
                path.rmdir()
            part.rename(path)
        finally:
            _remove(part)
            for parent in new_parents:
                with suppress(OSError):
                    parent.rmdir()


def read_json(
    path: Path,
    parse: Callable[[Any], Parsed],
    *,
    what: str,
    damaged: str,
    fix: str,
    error: type[SteelyardError] = ModelError,
) -> Parsed:
    """What `parse` makes of a JSON file of any origin.

    Args:
        path: The file.
        parse: Takes the parsed JSON; what it raises on values that are not as expected is turned
            into a clear error.
        what: What the file is expected to be, such as "the model".
        damaged: What is said of a file that is something else, such as "the model is damaged".
        fix: What the user can do about it.
        error: Kind of the error.

    Raises:
        SteelyardError: The file cannot be read, is no JSON, or `parse` does not accept it.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise ValueError("it is a device or a pipe")
        if path.stat().st_size > LARGEST_JSON:
            raise ValueError(f"it is larger than {LARGEST_JSON >> 20} MiB")
        return parse(json.loads(path.read_text(encoding="utf-8")))
    except OSError as failed:
        wrong = f"{what} cannot be read ({failed.strerror})"
    except RecursionError:
        wrong = f"{damaged}: it is nested too deeply"
    except (json.JSONDecodeError, UnicodeDecodeError):
        wrong = f"{damaged}: it is not JSON"
    except KeyError as failed:
        wrong = f"{damaged}: it has no {failed}"
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as failed:
        wrong = f"{damaged}: {failed}"
    raise error(wrong, where=str(path), fix=fix)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write `values` as indented JSON."""
    with whole_file(path) as part:
        part.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def _beside(path: Path) -> Path:
    """A hidden name in the same folder that no other run uses."""
    part = path.absolute().parent / f".{path.name}.{uuid4().hex[:8]}.part"
    _unfinished.add(part)
    return part


def _remove(part: Path) -> None:
    if part.is_dir():
        shutil.rmtree(part, ignore_errors=True)
    else:
        with suppress(OSError):
            part.unlink()
    _unfinished.discard(part)


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn the system's refusals into ours."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot be written: {error.strerror or error}",
            where=str(path),
            fix="check the path, its permissions and the space left",
        ) from error


def new_folder(output: Path | None, default: str) -> Path:
    """The folder to make: one that is not there, or `default`, with a number if that exists."""
    if output is None:
        names = chain([default], (f"{default}-{number}" for number in count(2)))
        return next(folder for folder in map(Path, names) if not folder.exists())
    if output.exists():
        raise OutputError(
            "the output folder exists already",
            where=str(output),
            fix="name another one with --output, or remove it"
            + ("; without --output folders are numbered" if default else ""),
        )
    return output


def cache_folder(name: str, mode: int = 0o777) -> Path | None:
    """A folder of the cache; `STEELYARD_CACHE` names another place, or empty switches it off."""
    from platformdirs import user_cache_dir

    named = os.environ.get("STEELYARD_CACHE")
    if named == "":
        return None
    place = Path(named or user_cache_dir("steelyard", appauthor=False)) / name
    try:
        place.mkdir(mode=mode, parents=True, exist_ok=True)
    except OSError:
        return None
    return place


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Rows as CSV, numbers with all digits; `None` is empty."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
