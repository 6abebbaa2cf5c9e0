"""Page and terminal text of `steelyard payload`: mass, its interval, and its changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import version
from math import floor, isfinite, log10
from typing import TYPE_CHECKING

import numpy as np

from steelyard.report.figures import Figure, Group, Key, area, evenly, line
from steelyard.report.page import Shown, fill, page_of
from steelyard.report.tables import PlainTable, Row, light_table
from steelyard.uses.payload.payload_changes import CHANGE_SPAN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console
    from rich.text import Text

    from steelyard.base.arrays import Array
    from steelyard.estimate.payload.payload_estimate import PayloadEstimate
    from steelyard.uses.payload.payload_events import PayloadEvents


def rounded_mass(value: float, half: float) -> tuple[str, str]:
    """A value and its half-width, to two digits of the half-width; the latter empty without."""
    if not (isfinite(value) and isfinite(half)):
        return "not identifiable", ""
    digits = min(12, max(0, 1 - floor(log10(half)))) if half > 0.0 else 6
    return f"{value:.{digits}f}", f"{half:.{digits}f}"


def mass_with_interval(value: float, half: float) -> str:
    """A value with the half-width of its interval."""
    number, width = rounded_mass(value, half)
    return f"{number} ± {width}" if width else number


def counted_changes(found: PayloadEvents) -> str:
    """How many changes of the payload there are, or which would be seen."""
    count, least = len(found.events), f"{found.least_mass:.2g} kg"
    if count:
        return f"{count} change{'s' * (count > 1)} of the payload"
    if found.conclusive:
        return f"no change of payload by {least} or more"
    return (
        f"cannot tell whether the payload changes: one by less than {least} would not be seen; the "
        "model does not describe this log (steelyard check names what differs)"
    )


MOST_POINTS_OF_MASS = 3000
"""Points of a line, at most."""


def render_payload_events(found: Sequence[PayloadEvents], robot: str) -> str:
    """The page as HTML text, to be written as UTF-8."""
    sections = []
    for number, one in enumerate(found, start=1):
        content = {
            "title": one.run,
            "words": f"{one.run}: {counted_changes(one)}. Frame '{one.frame}'.",
            "tables": _tables(one),
            "folded": "",
            "legend": MASS_LEGEND,
            "groups": [Group([_figure(one)], columns="one")],
            "note": MASS_WINDOW_NOTE,
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


MASS_LEGEND = [
    Key("--measured", f"mass in a window of {CHANGE_SPAN:g} s"),
    Key("--interval", "its 95 % interval", "area"),
    Key("--vermillion", "carried between changes"),
]
MASS_WINDOW_NOTE = (
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
                mass_with_interval(event.mass, event.mass_half_width),
                f"{event.ratio:.3g}",
            )
        )
        for number, event in enumerate(found.events, start=1)
    ]
    carried = [
        Row(
            (
                f"{one.start:.2f} to {one.stop:.2f}",
                mass_with_interval(one.payload.mass, float(one.payload.half_width[0])),
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
    some = evenly(len(sliding.t), MOST_POINTS_OF_MASS)
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


Number = tuple[str, float, float, str]
"""Name, value, half-width of its 95 % interval, unit."""


def payload_lines(estimate: PayloadEstimate, console: Console) -> None:
    """Print the mass in one line, the table and how far it can be trusted."""
    from rich.text import Text

    clear = estimate.weighs and not estimate.unexplained
    console.print(Text(payload_headline(estimate), style="bold green" if clear else "bold"))
    if estimate.unexplained:
        console.print(_warning(estimate.unexplained))
    carried = "" if estimate.frame == estimate.body else f", on link '{estimate.body}'"
    console.print()
    console.print(Text(f"payload in frame '{estimate.frame}'{carried}"))
    table = light_table(("", "value", "± 95 %", "unit"), (0, 3))
    for name, value, half, unit in _numbers(estimate):
        table.add_row(name, *rounded_mass(value, half), unit)
    console.print(table)
    remarks = (remark for remark in estimate.remarks if remark != estimate.unexplained)
    for text in (*remarks, *(f"note: {note}" for note in estimate.notes)):
        console.print(Text(text))


def event_lines(found: Sequence[PayloadEvents], console: Console) -> None:
    """Print when the payload changes along some logs."""
    from rich.text import Text

    for one in found:
        console.print(Text(f"{one.run}: {counted_changes(one)}", style="bold"))
        if one.unexplained:
            console.print(_warning(one.unexplained))
        for text in _lines_of(one):
            console.print(Text(text))
    for note in dict.fromkeys(note for one in found for note in one.notes):
        console.print(Text(f"note: {note}"))


def _warning(text: str) -> Text:
    """What qualifies a result."""
    from rich.text import Text

    return Text(f"! {text}", style="yellow")


def _lines_of(found: PayloadEvents) -> Iterator[str]:
    """Changes, then what is carried."""
    for event in found.events:
        mass, half = rounded_mass(event.mass, event.mass_half_width)
        yield (
            f"  {event.time:8.2f} s  ({event.earliest:.2f} to {event.latest:.2f} s)  "
            f"{event.kind:9}  {mass} ± {half} kg"
        )
    for one in found.carried:
        mass, half = rounded_mass(one.payload.mass, float(one.payload.half_width[0]))
        yield f"  carried from {one.start:.2f} to {one.stop:.2f} s: {mass} ± {half} kg"


def payload_headline(estimate: PayloadEstimate) -> str:
    """The mass with its interval, or that there is none, in a sentence."""
    mass, half = rounded_mass(estimate.mass, float(estimate.half_width[0]))
    if not half:
        return "The mass of the payload is not identifiable from these logs"
    found = f"{mass} ± {half} kg (95 % interval)"
    if estimate.negative_mass is not None:
        return (
            f"No payload: the data ask for a negative mass of about {estimate.negative_mass:.2g} kg"
        )
    return f"Payload: {found}" if estimate.weighs else f"No payload detected: {found}"


def _numbers(estimate: PayloadEstimate) -> Iterator[Number]:
    """The rows: mass, centre and inertia."""
    yield "mass", estimate.mass, float(estimate.half_width[0]), "kg"
    if not estimate.weighs:
        return
    centre, width = estimate.com, estimate.com_half_width
    for k, axis in enumerate("xyz"):
        yield f"centre {axis}", float(centre[k]), float(width[k]), "m"
    inertia, around = estimate.inertia_com, estimate.inertia_com_half_width
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        name = f"I{'xyz'[i]}{'xyz'[j]} about the centre"
        yield name, float(inertia[i, j]), float(around[i, j]), "kg m²"
