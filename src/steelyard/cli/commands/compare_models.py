"""`steelyard compare-models`: identified models side by side on the same logs."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Details, Json


@guarded
def compare_models(
    models: Annotated[
        list[str],
        typer.Argument(
            help="Two or more models: model.json, or the folders that contain it.",
            metavar="MODEL...",
        ),
    ],
    logs: Annotated[
        list[str],
        typer.Option(
            "--on", help=f"{LOG_HELP} Not logs that a model was identified from.", metavar="LOG..."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for a page with plots; none if unset."),
    ] = None,
    verbose: Details = False,
    as_json: Json = False,
) -> None:
    """Compare identified models of one robot on logs: errors, parameters, masses, efforts.

    Logs are processed as for the first model, so that all models predict the same effort.

    Example: steelyard compare-models full-model reduced-model --on other_motion.csv -o compared
    """
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.comparison.compare_models import compare_models as compared

    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress, ExitStack() as parts:
        found = compared(models, logs, progress=progress)
        if folder is not None:
            found.write(parts.enter_context(whole_folder(folder)))
            interrupt.too_late()
    if as_json:
        told = {**found.to_dict(), "output": folder and str(folder)}
        typer.echo(json.dumps(told, allow_nan=False))
        return
    found.show(Console(), verbose)
    if folder is not None:
        typer.echo(f"page  {folder / 'models.html'}\nJSON  {folder / 'models.json'}")
