"""A stream in a terminal: one line for each event, a status line, a summary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isinf, isnan
from typing import TYPE_CHECKING

import numpy as np

from steelyard.report.words import signed, significant
from steelyard.uses.contact.contact_events import ContactEvent, JointLoad
from steelyard.uses.payload.payload_events import PayloadEvent
from steelyard.uses.payload.payload_page import mass_with_interval, rounded_mass
from steelyard.uses.watch.stream_events import ContactStart
from steelyard.uses.watch.watcher import StreamNote

if TYPE_CHECKING:
    from steelyard.uses.watch.watcher import StreamEstimate, StreamEvent, StreamSummary, Watcher


def event_line(event: StreamEvent) -> str:
    """One line."""
    if isinstance(event, ContactStart):
        load = event.joint
        return _line(
            event.time,
            "contact",
            f"{_load(load)}, {event.place}",
        )
    if isinstance(event, ContactEvent):
        load = event.joints[0]
        return _line(
            event.end,
            "released",
            f"after {event.end - event.start:.2f} s; largest {_load(load)}, {event.place}",
        )
    if isinstance(event, PayloadEvent):
        mass, half = rounded_mass(event.mass, event.mass_half_width)
        return _line(
            event.time,
            event.kind,
            f"{mass} ± {half} kg (between {event.earliest:.2f} and {event.latest:.2f} s)",
        )
    if isinstance(event, StreamNote):
        return _line(event.time, "note", event.text)
    return _line(event.time, "estimate", _numbers(event))


def _load(load: JointLoad) -> str:
    """What a joint shows."""
    change = " change" if load.change else ""
    ratio = significant(load.ratio)
    return f"{load.joint} {signed(load.peak)} {load.unit}{change}, {ratio} × threshold"


def _line(time: float, what: str, text: str) -> str:
    return f"{time:9.2f} s  {what:9}  {text}"


def _numbers(estimate: StreamEstimate) -> str:
    parts = [f"torque {' '.join(f'{x:.3g}' for x in estimate.torque)}"]
    if estimate.wrench is not None:
        parts.append(f"wrench {' '.join(f'{x:.3g}' for x in estimate.wrench)}")
    return "; ".join(parts)


def state_line(watcher: Watcher) -> str:
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
    summary: StreamSummary, joints: Sequence[str], units: Sequence[str]
) -> Iterator[str]:
    """The end of a stream."""
    rate = summary.samples / summary.duration if summary.duration else 0.0
    yield (
        f"{summary.duration:.1f} s, {_counted(summary.samples, 'sample')} ({rate:.0f} a second): "
        f"{_counted(summary.contacts, 'contact')}, "
        f"{_counted(summary.payload_changes, 'change')} of the payload"
    )
    largest = zip(joints, summary.largest, units, strict=True)
    sizes = ", ".join(f"{joint} {significant(size)} {unit}" for joint, size, unit in largest)
    yield f"largest external torque: {sizes}"
    if summary.doubt:
        yield summary.doubt
    if summary.dropped:
        rows = ", ".join(f"{count} for {why}" for why, count in summary.dropped.items())
        yield f"rows left out: {rows}"
    if summary.gaps:
        yield f"pauses after which the observer restarted: {summary.gaps}"
    if summary.carried is not None:
        yield f"payload at the last search: {mass_with_interval(*summary.carried)} kg"
    if summary.least_mass is not None:
        yield _visible(summary.least_mass)
    if summary.payload:
        yield f"the last search for changes of the payload was not possible: {summary.payload}"


def _visible(least: float) -> str:
    """Which change of the payload would have been seen."""
    if isinf(least):
        return "no change of the payload would have been seen: too little motion"
    return (
        f"smallest change of the payload's mass that would be detected: {least:.2g} kg (for a mass "
        "at the frame's origin, in half of the searches)"
    )


def _counted(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'s' * (count != 1)}"
