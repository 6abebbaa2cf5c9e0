"""Rows of a log while it is written: a text file, JSON lines, MCAP, or standard input."""

import json
import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.logs.clocks_and_combined_logs import logged_columns, split_clocks, with_clocks
from steelyard.logs.log_and_errors import reading, require_columns
from steelyard.logs.messages.mcap_and_ros1_bag import open_mcap
from steelyard.logs.messages.message_log import MessageLog
from steelyard.logs.text_table import HEADER_LINES, by_numpy, read_header, rows_of_numbers, tidied

PIECE_BYTES = 1 << 16  # bytes read at a time
PENDING_PIECES = 64  # pieces of a pipe that wait at most, before its writer has to

Waiting = Callable[[], bool]
"""Called whenever there is nothing new; it may pause, and ends the stream by `False`."""


def file_pieces(path: Path, waiting: Waiting) -> Iterator[bytes]:
    """What is in a file, and what is appended to it."""
    with reading(path), path.open("rb") as file:
        while True:
            if piece := file.read(PIECE_BYTES):
                yield piece
                continue
            named, opened = path.stat(), os.fstat(file.fileno())
            same = (named.st_ino, named.st_dev) == (opened.st_ino, opened.st_dev)
            if not same or opened.st_size < file.tell():
                raise LogError(
                    "the log was replaced or cut off while it was read",
                    where=str(path),
                    fix="start again with the new file; a recorder has to append to its file",
                )
            if not waiting():
                return


def pipe_pieces(read: Callable[[], bytes], waiting: Waiting) -> Iterator[bytes]:
    """What a pipe hands out, until its writer closes it."""
    pieces: queue.Queue[bytes] = queue.Queue(PENDING_PIECES)

    def fill() -> None:
        for piece in iter(read, b""):
            pieces.put(piece)
        pieces.put(b"")

    threading.Thread(target=fill, daemon=True).start()
    while True:
        try:
            piece = pieces.get_nowait()
        except queue.Empty:
            if waiting():
                continue
            return
        if not piece:
            return
        yield piece


ROWS_BELOW_HEADER = 2  # rows of numbers below a header, with which it is known
LONGEST_STREAM_LINE = 1 << 20  # bytes of a line, at most

Read = Callable[[list[bytes]], Array]  # turns lines into rows of the columns wanted


def rows_of_lines(path: Path, wanted: Sequence[str], pieces: Iterable[bytes]) -> Iterator[Array]:
    """Rows of columns in every piece of bytes, shape `(N, len(wanted))` with N > 0.

    Lines before the header are passed over; it is known once two rows follow it. A table whose
    first line begins like a JSON object has such objects in all lines, with the columns as keys. A
    cell that is missing or no number is NaN; a line that is no row, and a last line without its
    end, are rows of NaN.
    """
    rest, read = b"", None
    for piece in pieces:
        rest += piece
        end = rest.rfind(b"\n") + 1
        if len(rest) - end > LONGEST_STREAM_LINE:
            raise LogError(
                f"a line is longer than {LONGEST_STREAM_LINE >> 20} MiB",
                where=str(path),
                fix="give one line per sample",
            )
        if read is None and end:
            read, start = _reader(path, wanted, rest[:end])
            rest, end = rest[start:], end - start
        if read is not None:
            lines = [line for line in rest[:end].split(b"\n") if line.strip()]
            rest = rest[end:]
            if lines:
                yield read(lines)
    if read is None:
        raise _no_table(path)
    if rest.strip():
        yield np.full((1, len(wanted)), np.nan)


def _reader(path: Path, wanted: Sequence[str], begin: bytes) -> tuple[Read | None, int]:
    """What reads the lines of a table, and where these begin; `None` until its header is known."""
    lines = begin.split(b"\n")[:-1]
    text = [line.decode("utf-8", errors="replace").strip("\ufeff \r") for line in lines]
    header = None
    if not next((line for line in text if line), "").startswith("{"):
        header = read_header(text[:HEADER_LINES])
    elif names := next((row for row in map(_object, lines) if row), None):
        require_columns(path, tuple(names), wanted)
        return partial(_of_objects, wanted), 0
    if header is None or rows_of_numbers(text[:HEADER_LINES], header) < ROWS_BELOW_HEADER:
        if len(lines) > HEADER_LINES:
            raise _no_table(path)
        return None, 0
    clocks = split_clocks(header.columns)
    require_columns(path, (*header.columns, *clocks), wanted)
    places = [header.columns.index(name) for name in logged_columns(wanted, clocks)]
    separator, comma = header.separator, header.decimal_comma

    def cells(lines: list[bytes]) -> Array:
        chunk = tidied(b"\n".join([*lines, b""]), separator, comma)
        return with_clocks(by_numpy(chunk, places, separator, comma), wanted, clocks)

    return cells, sum(len(line) + 1 for line in lines[: header.body])


def _of_objects(wanted: Sequence[str], lines: list[bytes]) -> Array:
    cells = [row.get(name) for row in map(_object, lines) for name in wanted]
    return np.array(list(map(_number, cells))).reshape(len(lines), len(wanted))


def _object(line: bytes) -> dict[str, Any]:
    """The JSON object in a line; empty if there is none."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _number(cell: Any) -> float:
    """A cell of JSON as a number; NaN for anything else, and beyond the largest float."""
    try:
        return float(cell) if type(cell) in (int, float) else np.nan
    except OverflowError:
        return np.nan


def _no_table(path: Path) -> LogError:
    return LogError(
        "there is no table: no header with two rows of numbers below it",
        where=str(path),
        fix="send a line of column names, then one line per sample; or one JSON object a line",
    )


STANDARD_INPUT = "-"  # name of the source that is no file
TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".jsonl", ".ndjson")  # suffixes of files of lines
BATCH_ROWS = 16  # messages that are put together at a time


def rows_of(
    source: str, columns: Sequence[str], waiting: Waiting, read: Callable[[], bytes]
) -> Iterator[Array]:
    """Rows of some columns as they arrive, shape `(N, len(columns))`."""
    if source == STANDARD_INPUT:
        return rows_of_lines(Path("standard input"), columns, pipe_pieces(read, waiting))
    path = Path(source)
    if not path.is_file():
        raise LogError(
            "there is no such file",
            where=source,
            fix="start the recorder first, or send rows to standard input: --from -",
        )
    if path.suffix.lower() == ".mcap":
        return _messages(path, columns, waiting)
    if path.suffix.lower() in TEXT_SUFFIXES:
        return rows_of_lines(path, columns, file_pieces(path, waiting))
    raise LogError(
        f"a log of the kind '{path.suffix or path.name}' cannot be read while it is written",
        where=source,
        fix=f"record a file that ends in {', '.join(TEXT_SUFFIXES)} or .mcap, or send rows to "
        "standard input (--from -); steelyard contact and payload --when read finished logs of all "
        "kinds",
    )


def _messages(path: Path, columns: Sequence[str], waiting: Waiting) -> Iterator[Array]:
    """Rows of an MCAP file, read without its index, once messages of all topics are in it."""
    while True:
        try:
            log = MessageLog.open(path)
            require_columns(path, log.columns, columns)
        except LogError:
            if not waiting() or (path.stat().st_size and open_mcap(path, path).whole):
                raise
        else:
            break
    growing = replace(open_mcap(path, path), whole=False, waiting=waiting)
    yield from replace(log, container=growing).parts(columns, size=BATCH_ROWS)
