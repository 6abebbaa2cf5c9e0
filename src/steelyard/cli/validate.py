"""`steelyard validate`: how well an identified model predicts other logs."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json


@guarded
def validate(
    model: Annotated[
        str, typer.Argument(help="model.json, or the folder that contains it.", metavar="MODEL")
    ],
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for the report; none if unset."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Score an identified model on logs that it was not fitted to.

    The exit code is 1 if the verdict is poor: the error is above 30 %, or a check of the model on
    these logs finds something wrong. Otherwise it is 0.

    Example: steelyard validate steelyard-ur10e other_motion.csv
    """
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import whole_folder
    from steelyard.identification.logs import new_folder
    from steelyard.identification.validate import validate as validated
    from steelyard.report.text.verdict import exit_code

    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress, ExitStack() as parts:
        found = validated(model, logs, progress=progress)
        if folder is not None:
            found.write(parts.enter_context(whole_folder(folder)))
            interrupt.too_late()
    if as_json:
        typer.echo(json.dumps(found.to_dict()["logs"], allow_nan=False))
    else:
        found.show(Console())
        if folder is not None:
            typer.echo(f"\nreport  {folder / 'report.html'}")
    raise typer.Exit(exit_code(found.content))
