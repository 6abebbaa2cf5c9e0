"""A payload in a terminal: the mass in front, then the table and what limits it; its changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from steelyard.report.sections.tables import light_table
from steelyard.report.text.payload_words import counted_changes, rounded

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from steelyard.application.payload_events import PayloadEvents
    from steelyard.estimation.payload.load import PayloadEstimate

Number = tuple[str, float, float, str]
"""Name, value, half-width of its 95 % interval, unit."""


def payload_lines(estimate: PayloadEstimate, console: Console) -> None:
    """Print the mass in one line, the table and how far it can be trusted.

    Args:
        estimate: The payload.
        console: Where to print.
    """
    from rich.text import Text

    clear = estimate.weighs and not estimate.unexplained
    console.print(Text(headline(estimate), style="bold green" if clear else "bold"))
    if estimate.unexplained:
        console.print(_warning(estimate.unexplained))
    carried = "" if estimate.frame == estimate.body else f", on link '{estimate.body}'"
    console.print()
    console.print(Text(f"payload in frame '{estimate.frame}'{carried}"))
    table = light_table(("", "value", "± 95 %", "unit"), (0, 3))
    for name, value, half, unit in _numbers(estimate):
        table.add_row(name, *rounded(value, half), unit)
    console.print(table)
    remarks = (line for line in estimate.remarks if line != estimate.unexplained)
    for line in (*remarks, *(f"note: {note}" for note in estimate.notes)):
        console.print(Text(line))


def event_lines(found: Sequence[PayloadEvents], console: Console) -> None:
    """Print when the payload changes along some logs.

    Args:
        found: The logs one by one.
        console: Where to print.
    """
    from rich.text import Text

    for one in found:
        console.print(Text(f"{one.run}: {counted_changes(one)}", style="bold"))
        if one.unexplained:
            console.print(_warning(one.unexplained))
        for line in _lines_of(one):
            console.print(Text(line))
    for note in dict.fromkeys(note for one in found for note in one.notes):
        console.print(Text(f"note: {note}"))


def _warning(text: str) -> Text:
    """What qualifies a result."""
    from rich.text import Text

    return Text(f"! {text}", style="yellow")


def _lines_of(found: PayloadEvents) -> Iterator[str]:
    """Changes, then what is carried."""
    for event in found.events:
        mass, half = rounded(event.mass, event.mass_half_width)
        yield (
            f"  {event.time:8.2f} s  ({event.earliest:.2f} to {event.latest:.2f} s)  "
            f"{event.kind:9}  {mass} ± {half} kg"
        )
    for one in found.carried:
        mass, half = rounded(one.payload.mass, float(one.payload.half_width[0]))
        yield f"  carried from {one.start:.2f} to {one.stop:.2f} s: {mass} ± {half} kg"


def headline(estimate: PayloadEstimate) -> str:
    """The mass with its interval, or that there is none, in a sentence."""
    mass, half = rounded(estimate.mass, float(estimate.half_width[0]))
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
