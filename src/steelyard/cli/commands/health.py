"""`steelyard health`: what drifted in a robot, from logs of its operation."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json, ModelArgument


@guarded
def health(
    model: ModelArgument,
    logs: Annotated[
        list[str], typer.Argument(help=f"In the order of time. {LOG_HELP}", metavar="LOG...")
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for the report; none if unset."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Detect drift of friction, offsets and effort scales from logs of normal operation.

    Exit code 0: no drift. 1: something drifted, or differs by far from the model. 2: error.

    Example: steelyard health steelyard-ur10e monday.csv tuesday.csv -o health
    """
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import whole_folder
    from steelyard.identification.logs import new_folder
    from steelyard.identification.uses.health import health as found_in

    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress:
        found = found_in(model, logs, progress=progress)
        if folder is not None:
            with whole_folder(folder) as part:
                found.write(part)
                interrupt.too_late()
    if as_json:
        typer.echo(json.dumps(found.to_dict(), allow_nan=False))
    else:
        found.show(Console())
        if folder is not None:
            typer.echo(f"\nreport  {folder / 'report.html'}")
    raise typer.Exit(int(bool(found.drifts or found.unproven)))
