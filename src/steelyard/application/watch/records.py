"""What a stream reports as JSON values and as rows of tables."""

from collections.abc import Sequence
from typing import Any

from steelyard.application.contact import ContactEvent
from steelyard.application.payload_events import PayloadEvent
from steelyard.application.watch.contact_stream import ContactStart
from steelyard.application.watch.watcher import (
    Happening,
    StreamEstimate,
    StreamNote,
    StreamSummary,
)

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

WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
"""Entries of a wrench."""


def record_of(happening: Happening) -> dict[str, Any]:
    """As JSON values; `event` says what it is."""
    if isinstance(happening, ContactStart):
        load = happening.joint
        return {
            "event": "contact",
            "time_s": happening.time,
            "known_s": happening.known,
            **vars(load),
            "links": list(happening.links),
        }
    if isinstance(happening, ContactEvent):
        return {"event": "contact_end", **happening.to_dict()}
    if isinstance(happening, PayloadEvent):
        return {
            "event": "payload",
            "kind": happening.kind,
            "time_s": happening.time,
            "earliest_s": happening.earliest,
            "latest_s": happening.latest,
            "mass_kg": happening.mass,
            "mass_half_width_kg": happening.mass_half_width,
            "over_threshold": happening.ratio,
        }
    if isinstance(happening, StreamNote):
        return {"event": "note", "time_s": happening.time, "text": happening.text}
    record: dict[str, Any] = {
        "event": "estimate",
        "time_s": happening.time,
        "torque": happening.torque.tolist(),
        "torque_half_width": happening.half_width.tolist(),
    }
    if happening.wrench is not None and happening.wrench_half_width is not None:
        record["wrench"] = happening.wrench.tolist()
        record["wrench_half_width"] = happening.wrench_half_width.tolist()
    return record


def summary_record(summary: StreamSummary) -> dict[str, Any]:
    """A summary as JSON values."""
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
        "doubt": summary.doubt or None,
    }


def event_row(happening: ContactEvent | PayloadEvent | StreamNote) -> list[str | float]:
    """A row of the table of events, in the order of `EVENT_COLUMNS`."""
    if isinstance(happening, ContactEvent):
        load = happening.joints[0]
        return [
            "contact",
            happening.start,
            happening.end,
            load.joint,
            load.peak,
            "",
            load.unit,
            load.ratio,
            happening.place,
        ]
    if isinstance(happening, PayloadEvent):
        mass, half = happening.mass, happening.mass_half_width
        return [
            happening.kind,
            happening.time,
            "",
            "payload",
            mass,
            half,
            "kg",
            happening.ratio,
            "",
        ]
    return ["note", happening.time, "", happening.text, "", "", "", "", ""]


def estimate_columns(joints: Sequence[str], wrench: bool) -> list[str]:
    """Columns of the table of estimates."""
    names = [*(f"torque.{joint}" for joint in joints)]
    names += [*(f"half_width.{joint}" for joint in joints)]
    both = [*WRENCH, *(f"half_width.{name}" for name in WRENCH)] if wrench else []
    return ["time_s", *names, *both]


def estimate_row(estimate: StreamEstimate) -> list[float]:
    """A row of the table of estimates."""
    parts = (estimate.torque, estimate.half_width, estimate.wrench, estimate.wrench_half_width)
    return [estimate.time, *(x for part in parts if part is not None for x in part.tolist())]
