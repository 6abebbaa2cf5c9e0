"""`steelyard payload`: what a robot carries, from logs with the payload and an identified model."""

import json
from math import floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json

if TYPE_CHECKING:
    from rich.table import Table

    from steelyard.estimation.payload.load import PayloadEstimate


@guarded
def payload(
    model: Annotated[
        str, typer.Argument(help="model.json, or the folder that contains it.", metavar="MODEL")
    ],
    logs: Annotated[
        list[str], typer.Argument(help=f"With the payload. {LOG_HELP}", metavar="LOG...")
    ],
    frame: Annotated[
        str | None,
        typer.Option(help="Frame of the results; that of the last link if unset.", metavar="NAME"),
    ] = None,
    unloaded: Annotated[
        list[str] | None,
        typer.Option(
            "--unloaded",
            help="Logs without the payload: arm and payload are then identified together, and of "
            "the model only the equations are used.",
            metavar="LOG...",
        ),
    ] = None,
    gain_uncertainty: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=0.5,
            help="Relative standard deviation of each gain of the efforts; if unset 0.02 for "
            "efforts of motors, or 0 if scales of the efforts were identified with the model.",
            metavar="SHARE",
        ),
    ] = None,
    mass: Annotated[
        float | None, typer.Option(min=1e-6, help="Known mass, in kg.", metavar="KG")
    ] = None,
    com: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Known centre of mass in the frame, in m.", metavar="X Y Z"),
    ] = None,
    box: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            help="Prior of the inertia: a box with these edges along the frame's axes, in m.",
            metavar="X Y Z",
        ),
    ] = None,
    cylinder: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Prior of the inertia: a cylinder along z, diameter and length in m.",
            metavar="D L",
        ),
    ] = None,
    sphere: Annotated[
        float | None,
        typer.Option(help="Prior of the inertia: a sphere, diameter in m.", metavar="D"),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for payload.json; none if unset."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Identify a payload: mass, centre and inertia of a body that can exist, with 95 % intervals.

    Example: steelyard payload steelyard-ur10e loaded.csv --frame tool0 --box 0.2 0.1 0.1
    """
    from rich.console import Console
    from rich.text import Text

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import whole_folder, write_json
    from steelyard.identification.logs import new_folder
    from steelyard.identification.payload import known_of, payload_inputs

    known = known_of(mass, com, box, cylinder, sphere)
    task = payload_inputs(model, logs, frame, unloaded or (), known)
    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress:
        estimate = task.done(gain_uncertainty, progress)
    result = estimate.to_dict()
    if folder is not None:
        with whole_folder(folder) as part:
            write_json(part / "payload.json", result)
            interrupt.too_late()
    if as_json:
        typer.echo(json.dumps(result, allow_nan=False))
        return
    console = Console()
    console.print(_table(estimate))
    for line in estimate.remarks:
        console.print(Text(line))
    for note in estimate.notes:
        console.print(Text(f"note: {note}"))
    if folder is not None:
        typer.echo(f"\npayload  {folder / 'payload.json'}")


def _table(estimate: "PayloadEstimate") -> "Table":
    from rich.table import Table
    from rich.text import Text

    carried = "" if estimate.frame == estimate.body else f", on link '{estimate.body}'"
    table = Table(title=Text(f"payload in frame '{estimate.frame}'{carried}"), title_justify="left")
    table.add_column("")
    for heading in ("value", "± 95 %"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    rows = [("mass", estimate.mass, estimate.half_width[0], "kg")]
    if estimate.weighs:
        centre, width = estimate.com, estimate.com_half_width
        rows += [(f"centre {axis}", centre[k], width[k], "m") for k, axis in enumerate("xyz")]
        inertia, around = estimate.inertia_com, estimate.inertia_com_half_width
        rows += [
            (f"I{'xyz'[i]}{'xyz'[j]} about the centre", inertia[i, j], around[i, j], "kg m²")
            for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        ]
    for name, value, half, unit in rows:
        table.add_row(name, *_rounded(float(value), float(half)), unit)
    return table


def _rounded(value: float, half: float) -> tuple[str, str]:
    """A value and its half-width, to two digits of the half-width."""
    if not (isfinite(value) and isfinite(half)):
        return "not identifiable", ""
    digits = min(12, max(0, 1 - floor(log10(half)))) if half > 0.0 else 6
    return f"{value:.{digits}f}", f"{half:.{digits}f}"
