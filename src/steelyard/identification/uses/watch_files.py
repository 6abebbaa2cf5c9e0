"""Tables that grow while a stream is watched."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TextIO

from steelyard.application.contact import ContactEvent
from steelyard.application.payload_events import PayloadEvent
from steelyard.application.watch.records import (
    EVENT_COLUMNS,
    estimate_columns,
    estimate_row,
    event_row,
)
from steelyard.application.watch.watcher import StreamEstimate, StreamEvent, StreamNote
from steelyard.files import explained

EVENTS, ESTIMATES = "events.csv", "estimates.csv"


class StreamFiles:
    """`events.csv` and `estimates.csv`, complete up to the last `flush`."""

    def __init__(self, events: TextIO, estimates: TextIO) -> None:
        self._files = events, estimates
        self._events, self._estimates = (csv.writer(x, lineterminator="\n") for x in self._files)

    @classmethod
    @contextmanager
    def opened(cls, folder: Path, joints: Sequence[str], wrench: bool) -> Iterator["StreamFiles"]:
        """New files in a new folder, closed at the end of the block.

        Args:
            folder: The folder to make.
            joints: Names of the joints.
            wrench: Whether wrenches are estimated.

        Raises:
            OutputError: The folder exists, or a file cannot be written.
        """
        with explained(folder), ExitStack() as stack:
            folder.mkdir(parents=True)
            files: list[Any] = [
                stack.enter_context((folder / name).open("x", encoding="utf-8", newline=""))
                for name in (EVENTS, ESTIMATES)
            ]
            tables = cls(*files)
            tables._events.writerow(EVENT_COLUMNS)
            tables._estimates.writerow(estimate_columns(joints, wrench))
            tables.flush()
            yield tables

    def take(self, event: StreamEvent) -> None:
        """Write what belongs into the tables: contacts when they end."""
        if isinstance(event, StreamEstimate):
            self._estimates.writerow(_short(estimate_row(event)))
        elif isinstance(event, ContactEvent | PayloadEvent | StreamNote):
            self._events.writerow(_short(event_row(event)))

    def flush(self) -> None:
        """Hand all rows to the system."""
        for file in self._files:
            file.flush()


def _short(row: Sequence[str | float]) -> list[str]:
    """Cells, numbers with nine digits."""
    return [cell if isinstance(cell, str) else f"{cell:.9g}" for cell in row]
