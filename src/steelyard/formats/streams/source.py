"""Rows of a log while it is written: a text file, standard input or MCAP."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.log import require_columns
from steelyard.formats.messages.mcap import McapFile
from steelyard.formats.messages.message_log import MessageLog
from steelyard.formats.streams.lines import Lines
from steelyard.formats.streams.pieces import Waiting, file_pieces, pipe_pieces

STANDARD_INPUT = "-"
"""Name of the source that is no file."""

TEXT = (".csv", ".tsv", ".txt", ".jsonl", ".ndjson")
"""Suffixes of files of lines."""

BATCH = 16
"""Messages that are put together at a time."""


def rows_of(
    source: str, columns: Sequence[str], waiting: Waiting, read: Callable[[], bytes]
) -> Iterator[Array]:
    """Rows of some columns as they arrive, shape `(N, len(columns))`.

    Args:
        source: A file, or `-`.
        columns: Their names.
        waiting: Called while there is nothing new; the rows end when it returns `False`.
        read: Reads from standard input: some bytes, none at its end.

    Raises:
        LogError: The source is not there, of a kind that cannot be read while it is written, or
            lacks a column.
    """
    if source == STANDARD_INPUT:
        return Lines(Path("standard input"), columns).rows(pipe_pieces(read, waiting))
    path = Path(source)
    if not path.is_file():
        raise LogError(
            "there is no such file",
            where=source,
            fix="start the recorder first, or send rows to standard input: --from -",
        )
    if path.suffix.lower() == ".mcap":
        return _messages(path, columns, waiting)
    if path.suffix.lower() in TEXT:
        return Lines(path, columns).rows(file_pieces(path, waiting))
    raise LogError(
        f"a log of the kind '{path.suffix or path.name}' cannot be read while it is written",
        where=source,
        fix=f"record a file that ends in {', '.join(TEXT)} or .mcap, or send rows to standard "
        "input (--from -); steelyard contact and payload --when read finished logs of all kinds",
    )


def _messages(path: Path, columns: Sequence[str], waiting: Waiting) -> Iterator[Array]:
    """Rows of an MCAP file, read from front to back without its index."""
    log = _announced(path, columns, waiting)
    growing = McapFile(path, complete=False, waiting=waiting)
    yield from replace(log, container=growing).parts(columns, size=BATCH)


def _announced(path: Path, columns: Sequence[str], waiting: Waiting) -> MessageLog:
    """The log once the first messages of all wanted topics are in it."""
    while True:
        try:
            log = MessageLog.open(path)
            require_columns(path, log.columns, columns)
        except LogError:
            if not waiting() or (path.stat().st_size and McapFile.open(path).complete):
                raise
        else:
            return log
