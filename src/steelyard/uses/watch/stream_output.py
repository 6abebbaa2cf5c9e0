"""What a stream reports: lines of a terminal, JSON values, and tables that grow with it."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from math import isinf, isnan
from pathlib import Path
from typing import Any, Self, TextIO

import numpy as np

from steelyard.base.files import explained
from steelyard.report.words import signed, significant
from steelyard.uses.contact.contact import ContactEvent, ContactStart, JointLoad
from steelyard.uses.payload.payload import mass_with_interval, rounded_mass
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvent
from steelyard.uses.watch import watcher_and_events as watching


def record_of(event: watching.StreamEvent) -> dict[str, Any]:
    """As JSON values; `event` says what it is."""
    match event:
        case ContactStart():
            return {
                "event": "contact",
                "time_s": event.time,
                "known_s": event.known,
                **vars(event.joint),
                "links": list(event.links),
            }
        case ContactEvent():
            return {"event": "contact_end", **event.to_dict()}
        case PayloadEvent():
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
        case watching.StreamNote():
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


def event_line(event: watching.StreamEvent) -> str:
    """One line of a terminal."""
    time = event.end if isinstance(event, ContactEvent) else event.time
    match event:
        case ContactStart():
            what, text = "contact", f"{_load(event.joint)}, {event.place}"
        case ContactEvent():
            largest, lasted = _load(event.joints[0]), event.end - event.start
            what, text = "released", f"after {lasted:.2f} s; largest {largest}, {event.place}"
        case PayloadEvent():
            mass, half = rounded_mass(event.mass, event.mass_half_width)
            between = f"between {event.earliest:.2f} and {event.latest:.2f} s"
            what, text = event.kind, f"{mass} ± {half} kg ({between})"
        case watching.StreamNote():
            what, text = "note", event.text
        case watching.StreamEstimate():
            what, text = "estimate", f"torque {' '.join(f'{x:.3g}' for x in event.torque)}"
            if event.wrench is not None:
                text += f"; wrench {' '.join(f'{x:.3g}' for x in event.wrench)}"
    return f"{time:9.2f} s  {what:9}  {text}"


def _load(load: JointLoad) -> str:
    change = " change" if load.change else ""
    ratio = significant(load.ratio)
    return f"{load.joint} {signed(load.peak)} {load.unit}{change}, {ratio} × threshold"


def state_line(watcher: watching.Watcher) -> str:
    """What a watcher sees now, for a line that is written again and again."""
    if not watcher.observer.steps:
        return "waiting for samples"
    parts = [f"{watcher.time:.1f} s"]
    if not isnan(watcher.ratio):
        parts.append(f"largest residual {significant(watcher.ratio)} × threshold")
    if watcher.frame is not None:
        force, half = watcher.observer.wrench[:3], watcher.observer.half_width[:3]
        parts.append(f"force {np.linalg.norm(force):.0f} ± {np.linalg.norm(half):.0f} N")
    payload = watcher.payload
    if payload is not None and payload.state is not None:
        mass, half_width = rounded_mass(payload.state.mass, payload.state.half_width)
        carried = f"{mass} ± {half_width} kg" if half_width else "none"
        least = payload.state.least_mass
        changes = "no changes" if isinf(least) else f"changes of {least:.2g} kg or more"
        parts.append(f"payload {carried} ({changes} visible)")
    return "   ".join(parts)


def summary_lines(
    summary: Mapping[str, Any], joints: Sequence[str], units: Sequence[str]
) -> Iterator[str]:
    """The end of a stream, see `Watcher.summary`."""
    duration, samples, least = (summary[x] for x in ("duration_s", "samples", "least_mass_kg"))
    yield (
        f"{duration:.1f} s, {_counted(samples, 'sample')} "
        f"({samples / duration if duration else 0.0:.0f} a second): "
        f"{_counted(summary['contacts'], 'contact')}, "
        f"{_counted(summary['payload_changes'], 'change')} of the payload"
    )
    largest = zip(joints, summary["largest_torque"], units, strict=True)
    sizes = ", ".join(f"{joint} {significant(size)} {unit}" for joint, size, unit in largest)
    yield f"largest external torque: {sizes}"
    if summary["doubt"]:
        yield summary["doubt"]
    if summary["dropped_rows"]:
        rows = ", ".join(f"{count} for {why}" for why, count in summary["dropped_rows"].items())
        yield f"rows left out: {rows}"
    if summary["gaps"]:
        yield f"pauses after which the observer restarted: {summary['gaps']}"
    if summary["carried_kg"] is not None:
        mass = mass_with_interval(summary["carried_kg"], summary["carried_half_width_kg"])
        yield f"payload at the last search: {mass} kg"
    if least is not None:
        yield (
            "no change of the payload would have been seen: too little motion"
            if isinf(least)
            else "smallest change of the payload's mass that would be detected: "
            f"{least:.2g} kg (for a mass at the frame's origin, in half of the searches)"
        )
    if failed := summary["payload_not_sought"]:
        yield f"the last search for changes of the payload was not possible: {failed}"


def _counted(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'s' * (count != 1)}"


EVENT_COLUMNS = (
    "event", "time_s", "end_s", "what", "value", "half_width", "unit", "over_threshold", "place",
)  # fmt: skip

WRENCH_COLUMNS = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")  # entries of a wrench


def event_row(event: ContactEvent | PayloadEvent | watching.StreamNote) -> dict[str, str | float]:
    """Cells of the table of events by `EVENT_COLUMNS`."""
    match event:
        case ContactEvent():
            load = event.joints[0]
            return {
                "event": "contact",
                "time_s": event.start,
                "end_s": event.end,
                "what": load.joint,
                "value": load.peak,
                "unit": load.unit,
                "over_threshold": load.ratio,
                "place": event.place,
            }
        case PayloadEvent():
            return {
                "event": event.kind,
                "time_s": event.time,
                "what": "payload",
                "value": event.mass,
                "half_width": event.mass_half_width,
                "unit": "kg",
                "over_threshold": event.ratio,
            }
    return {"event": "note", "time_s": event.time, "what": event.text}


EVENTS, ESTIMATES = "events.csv", "estimates.csv"


class StreamFiles:
    """`events.csv` and `estimates.csv`, complete up to the last `flush`."""

    def __init__(self, events: TextIO, estimates: TextIO) -> None:
        self._files = events, estimates
        self._events, self._estimates = (csv.writer(x, lineterminator="\n") for x in self._files)

    @classmethod
    @contextmanager
    def opened(cls, folder: Path, joints: Sequence[str], wrench: bool) -> Iterator[Self]:
        """New files in a new folder, closed at the end of the block."""
        with explained(folder), ExitStack() as stack:
            folder.mkdir(parents=True)
            files: list[Any] = [
                stack.enter_context((folder / name).open("x", encoding="utf-8", newline=""))
                for name in (EVENTS, ESTIMATES)
            ]
            tables = cls(*files)
            tables._events.writerow(EVENT_COLUMNS)
            both = [*WRENCH_COLUMNS, *(f"half_width.{x}" for x in WRENCH_COLUMNS)] if wrench else []
            torques = (f"{what}.{joint}" for what in ("torque", "half_width") for joint in joints)
            tables._estimates.writerow(["time_s", *torques, *both])
            tables.flush()
            yield tables

    def take(self, event: watching.StreamEvent) -> None:
        """Write what belongs into the tables: contacts when they end."""
        if isinstance(event, watching.StreamEstimate):
            both = (event.torque, event.half_width, event.wrench, event.wrench_half_width)
            known = (x for part in both if part is not None for x in part.tolist())
            self._estimates.writerow(_short([event.time, *known]))
        elif isinstance(event, ContactEvent | PayloadEvent | watching.StreamNote):
            row = event_row(event)
            self._events.writerow(_short([row.get(name, "") for name in EVENT_COLUMNS]))

    def flush(self) -> None:
        """Hand all rows to the system."""
        for file in self._files:
            file.flush()


def _short(row: Sequence[str | float]) -> list[str]:
    """Cells, numbers with nine digits."""
    return [cell if isinstance(cell, str) else f"{cell:.9g}" for cell in row]
