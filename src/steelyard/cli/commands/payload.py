"""`steelyard payload`: what a robot carries, from logs with the payload and an identified model."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json, ModelArgument


@guarded
def payload(
    model: ModelArgument,
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
            help="Logs without the payload: arm and payload are then identified together, and "
            "the parameter values of the model are not used.",
            metavar="LOG...",
        ),
    ] = None,
    gain_uncertainty: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=0.5,
            help="Relative standard deviation of each gain of the efforts; if unset 0.02 for "
            "motor currents and motor torques; 0 for joint torques, and where scales of the "
            "efforts were identified with the model.",
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
    when: Annotated[
        bool,
        typer.Option(
            "--when", help="Find when something is picked up and put down along each log."
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Output folder for payload.json and, with --when, a page."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Identify a payload: physically consistent mass, centre and inertia, with 95 % intervals.

    With --when: times at which it is picked up and put down, each with a 95 % interval.

    Example: steelyard payload steelyard-ur10e loaded.csv --frame tool0 --box 0.2 0.1 0.1
    """
    from rich.console import Console

    from steelyard.application.payload_events import events_dict
    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.estimation.payload.load import PayloadEstimate
    from steelyard.files import new_folder, whole_folder, write_json
    from steelyard.identification.uses.payload import known_of, payload_inputs
    from steelyard.report.payload_page import render_payload_events
    from steelyard.report.terminal.payload import event_lines, payload_lines

    known = known_of(mass, com, box, cylinder, sphere)
    task = payload_inputs(model, logs, frame, unloaded or (), known)
    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress:
        found = (task.events if when else task.done)(gain_uncertainty, progress)
    result = found.to_dict() if isinstance(found, PayloadEstimate) else events_dict(found)
    if folder is not None:
        with whole_folder(folder) as part:
            write_json(part / "payload.json", result)
            if not isinstance(found, PayloadEstimate):
                page = render_payload_events(found, task.identified.robot.name)
                (part / "report.html").write_text(page, encoding="utf-8")
            interrupt.too_late()
    if as_json:
        typer.echo(json.dumps(result, allow_nan=False))
        return
    if isinstance(found, PayloadEstimate):
        payload_lines(found, Console())
    else:
        event_lines(found, Console())
    if folder is not None:
        typer.echo(f"\npayload  {folder / 'payload.json'}")
        if when:
            typer.echo(f"report   {folder / 'report.html'}")
