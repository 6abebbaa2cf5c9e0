"""What a stream reports as JSON values and rows of tables, and the tables that grow with it."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from math import isfinite
from pathlib import Path
from typing import Any, TextIO

from steelyard.base.files import explained
from steelyard.uses.contact.contact_events import ContactEvent
from steelyard.uses.payload.payload_events import PayloadEvent
from steelyard.uses.watch.stream_events import ContactStart
from steelyard.uses.watch.watcher import StreamEstimate, StreamEvent, StreamNote, StreamSummary

EVENT_COLUMNS = (
    "event",
    "time_s",
    "end_s",
    "what",
    "value",
    "half_width",
    "unit",
    "over_threshold",
    "place",
)
"""Columns of the table of events."""

WRENCH_COLUMNS = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
"""Entries of a wrench."""


def record_of(event: StreamEvent) -> dict[str, Any]:
    """As JSON values; `event` says what it is."""
    if isinstance(event, ContactStart):
        load = event.joint
        return {
            "event": "contact",
            "time_s": event.time,
            "known_s": event.known,
            **vars(load),
            "links": list(event.links),
        }
    if isinstance(event, ContactEvent):
        return {"event": "contact_end", **event.to_dict()}
    if isinstance(event, PayloadEvent):
        return {
            "event": "payload",
            "kind": event.kind,
            "time_s": event.time,
            "earliest_s": event.earliest,
            "latest_s": event.latest,
            "mass_kg": event.mass,
            "mass_half_width_kg": event.mass_half_width,
            "over_threshold": event.ratio,
        }
    if isinstance(event, StreamNote):
        return {"event": "note", "time_s": event.time, "text": event.text}
    record: dict[str, Any] = {
        "event": "estimate",
        "time_s": event.time,
        "torque": event.torque.tolist(),
        "torque_half_width": event.half_width.tolist(),
    }
    if event.wrench is not None and event.wrench_half_width is not None:
        record["wrench"] = event.wrench.tolist()
        record["wrench_half_width"] = event.wrench_half_width.tolist()
    return record


def summary_record(summary: StreamSummary) -> dict[str, Any]:
    """A summary as JSON values."""
    least = summary.least_mass
    return {
        "event": "summary",
        "duration_s": summary.duration,
        "samples": summary.samples,
        "dropped_rows": summary.dropped,
        "gaps": summary.gaps,
        "contacts": summary.contacts,
        "payload_changes": summary.payload_changes,
        "largest_torque": list(summary.largest),
        "payload_not_sought": summary.payload,
        "carried_kg": None if summary.carried is None else summary.carried[0],
        "carried_half_width_kg": None if summary.carried is None else summary.carried[1],
        "least_mass_kg": None if least is None or not isfinite(least) else least,
        "doubt": summary.doubt or None,
    }


def event_row(event: ContactEvent | PayloadEvent | StreamNote) -> list[str | float]:
    """A row of the table of events, in the order of `EVENT_COLUMNS`."""
    if isinstance(event, ContactEvent):
        load = event.joints[0]
        return [
            "contact",
            event.start,
            event.end,
            load.joint,
            load.peak,
            "",
            load.unit,
            load.ratio,
            event.place,
        ]
    if isinstance(event, PayloadEvent):
        mass, half = event.mass, event.mass_half_width
        return [
            event.kind,
            event.time,
            "",
            "payload",
            mass,
            half,
            "kg",
            event.ratio,
            "",
        ]
    return ["note", event.time, "", event.text, "", "", "", "", ""]


def estimate_columns(joints: Sequence[str], wrench: bool) -> list[str]:
    """Columns of the table of estimates."""
    names = [*(f"torque.{joint}" for joint in joints)]
    names += [*(f"half_width.{joint}" for joint in joints)]
    both = [*WRENCH_COLUMNS, *(f"half_width.{name}" for name in WRENCH_COLUMNS)] if wrench else []
    return ["time_s", *names, *both]


def estimate_row(estimate: StreamEstimate) -> list[float]:
    """A row of the table of estimates."""
    parts = (estimate.torque, estimate.half_width, estimate.wrench, estimate.wrench_half_width)
    return [estimate.time, *(x for part in parts if part is not None for x in part.tolist())]


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
