"""Bytes as they arrive: of a file that grows, or of a pipe."""

import os
import queue
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from steelyard.errors import LogError

PIECE = 1 << 16
"""Bytes read at a time."""

PENDING = 64
"""Pieces of a pipe that wait at most, before its writer has to."""

Waiting = Callable[[], bool]
"""Called whenever there is nothing new; it may pause, and ends the stream by `False`."""


def file_pieces(path: Path, waiting: Waiting) -> Iterator[bytes]:
    """What is in a file, and what is appended to it.

    Raises:
        LogError: It cannot be read, or is replaced or cut off meanwhile.
    """
    try:
        with path.open("rb") as file:
            while True:
                if piece := file.read(PIECE):
                    yield piece
                    continue
                _refuse_replaced(path, file.fileno(), file.tell())
                if not waiting():
                    return
    except OSError as error:
        raise LogError(
            f"the log cannot be read ({error.strerror or error})",
            where=str(path),
            fix="check the path and the file's permissions",
        ) from error


def _refuse_replaced(path: Path, number: int, at: int) -> None:
    """The path still names the open file, which has all bytes that were read."""
    named, opened = path.stat(), os.fstat(number)
    if (named.st_ino, named.st_dev) != (opened.st_ino, opened.st_dev) or opened.st_size < at:
        raise LogError(
            "the log was replaced or cut off while it was read",
            where=str(path),
            fix="start again with the new file; a recorder has to append to its file",
        )


def pipe_pieces(read: Callable[[], bytes], waiting: Waiting) -> Iterator[bytes]:
    """What a pipe hands out, until its writer closes it.

    Args:
        read: Waits for bytes and returns them, none at the end; called in a thread.
        waiting: Called while there are none.
    """
    pieces: queue.Queue[bytes] = queue.Queue(PENDING)

    def fill() -> None:
        piece = read()
        while piece:
            pieces.put(piece)
            piece = read()
        pieces.put(b"")

    threading.Thread(target=fill, daemon=True).start()
    while True:
        try:
            piece = pieces.get_nowait()
        except queue.Empty:
            if not waiting():
                return
            continue
        if not piece:
            return
        yield piece
