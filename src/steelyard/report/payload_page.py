"""The page of `steelyard payload --when`: the mass over time, and when it changes."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np

from steelyard.application.payload_changes import SPAN
from steelyard.report.figures import Figure, Group, Key, area, evenly, line
from steelyard.report.html import fill
from steelyard.report.page import Shown, page_of
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.payload_words import counted_changes, with_interval

if TYPE_CHECKING:
    from collections.abc import Sequence

    from steelyard.application.payload_events import PayloadEvents
    from steelyard.arrays import Array

DRAWN = 3000
"""Points of a line, at most."""


def render_payload_events(found: Sequence[PayloadEvents], robot: str) -> str:
    """The page as HTML text, to be written as UTF-8.

    Args:
        found: The logs one by one.
        robot: The robot's name.
    """
    sections = []
    for number, one in enumerate(found, start=1):
        content = {
            "title": one.run,
            "words": f"{one.run}: {counted_changes(one)}. Frame '{one.frame}'.",
            "tables": _tables(one),
            "folded": "",
            "legend": LEGEND,
            "groups": [Group([_figure(one)], columns="one")],
            "note": NOTE,
        }
        sections.append(Shown(f"log{number}", one.run, fill("figures.html", content)))
    limits = [f"{one.run}: {one.unexplained}" for one in found if one.unexplained]
    if limits:
        shown = fill("notes.html", {"notes": limits})
        sections.insert(0, Shown("limits", "Limits of this result", shown))
    notes = tuple(dict.fromkeys(note for one in found for note in one.notes))
    sections.append(Shown("notes", "Notes", fill("notes.html", {"notes": notes}), folded=True))
    title = f"{robot}: payload in {', '.join(one.run for one in found)}"
    return page_of(title, robot, "inspected", version("steelyard"), sections)


LEGEND = [
    Key("--measured", f"mass in a window of {SPAN:g} s"),
    Key("--interval", "its 95 % interval", "area"),
    Key("--vermillion", "carried between changes"),
]
NOTE = (
    "The window slides over the motion; a change appears as a slope of its length. The masses "
    "between changes are weighed with all their samples, arm and friction together; changes are "
    "decided by all ten numbers of the payload, not by this line."
)


def _tables(found: PayloadEvents) -> list[PlainTable]:
    """Changes, and what is carried."""
    changes = [
        Row(
            (
                f"{number}",
                event.kind,
                f"{event.time:.2f}",
                f"{event.earliest:.2f} to {event.latest:.2f}",
                with_interval(event.mass, event.mass_half_width),
                f"{event.ratio:.3g}",
            )
        )
        for number, event in enumerate(found.events, start=1)
    ]
    carried = [
        Row(
            (
                f"{one.start:.2f} to {one.stop:.2f}",
                with_interval(one.payload.mass, float(one.payload.half_width[0])),
            )
        )
        for one in found.carried
    ]
    headings = ("#", "change", "time [s]", "95 % interval [s]", "mass [kg]", "× threshold")
    tables = [PlainTable("", "", headings, changes, (1, 3, 4))] if changes else []
    if carried:
        tables.append(PlainTable("", "", ("carried [s]", "mass [kg]"), carried, (0, 1)))
    return tables


def _figure(found: PayloadEvents) -> Figure:
    sliding = found.sliding
    some = evenly(len(sliding.t), DRAWN)
    t, mass, half = sliding.t[some], sliding.mass[some], sliding.half_width[some]
    steps, carried = _steps(found)
    return Figure(
        "",
        f"Mass of the payload along {found.run}, with its interval and the changes",
        "time [s]",
        "mass [kg]",
        [
            area("95 % interval", t, mass - half, mass + half, "--interval"),
            line("window", t, mass, "--measured", width=1.2),
            line("carried", steps, carried, "--vermillion", width=2.5),
        ],
        {"showlegend": False},
    )


def _steps(found: PayloadEvents) -> tuple[Array, Array]:
    """The mass between changes as a line with steps, zero where nothing is carried."""
    sliding = found.sliding
    edges = [float(sliding.t[0]), *(e.time for e in found.events), float(sliding.t[-1])]
    middles = [0.5 * (a + b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    masses = [
        next((one.payload.mass for one in found.carried if one.start <= t <= one.stop), 0.0)
        for t in middles
    ]
    return np.repeat(edges, 2)[1:-1], np.repeat(masses, 2)
