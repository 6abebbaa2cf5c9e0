"""What a stream reports as JSON values and as rows of tables."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

from steelyard.application.contact import ContactEvent
from steelyard.application.payload_events import PayloadEvent
from steelyard.application.watch.contact_stream import ContactStart
from steelyard.application.watch.watcher import (
    StreamEstimate,
    StreamEvent,
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
    both = [*WRENCH, *(f"half_width.{name}" for name in WRENCH)] if wrench else []
    return ["time_s", *names, *both]


def estimate_row(estimate: StreamEstimate) -> list[float]:
    """A row of the table of estimates."""
    parts = (estimate.torque, estimate.half_width, estimate.wrench, estimate.wrench_half_width)
    return [estimate.time, *(x for part in parts if part is not None for x in part.tolist())]
