"""`steelyard health`: what drifted in a robot, from logs of its operation."""

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

    Exit code 0: no drift. 1: something drifted, or may have (drift not proven). 2: error.

    Example: steelyard health steelyard-ur10e monday.csv tuesday.csv -o health
    """
    from steelyard.cli.show import computed
    from steelyard.identification.uses.health import health as found_in

    found = computed(
        lambda progress: found_in(model, logs, progress=progress),
        output,
        as_json,
        report="report.html",
    )
    raise typer.Exit(int(bool(found.drifts or found.unproven)))
