"""`steelyard validate`: how well an identified model predicts other logs."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Commanded, Details, Json, ModelArgument


@guarded
def validate(
    model: ModelArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for the report; none if unset."),
    ] = None,
    max_error: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Largest error, in % of the effort used; above it the exit code is 1.",
            metavar="PERCENT",
        ),
    ] = None,
    commanded: Commanded = False,
    verbose: Details = False,
    as_json: Json = False,
) -> None:
    """Score an identified model on logs that it was not fitted to.

    Exit code 0: done, and the error is not too large. 1: the verdict is poor (the headline's error
    is above 30 %, or something is wrong with these logs), or with --max-error: that error is above
    it, or no log has unseen motion. 2: not done.

    Example: steelyard validate steelyard-ur10e other_motion.csv
    """
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.validate import validate as validated
    from steelyard.report.text.next_steps import fixing, path_word, robot_file, step_lines
    from steelyard.report.text.verdict import exit_code, over

    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress, ExitStack() as parts:
        found = validated(model, logs, commanded=commanded, progress=progress)
        if folder is not None:
            found.write(parts.enter_context(whole_folder(folder)))
            interrupt.too_late()
    if as_json:
        typer.echo(json.dumps(found.to_dict()["logs"], allow_nan=False))
    else:
        found.show(Console(), verbose)
        steps = fixing(found.content, model, robot_file(found.content))
        if not found.content.scores:
            steps = (
                *steps,
                (f"steelyard validate {path_word(model)} OTHER_LOG", "error on another motion"),
            )
        lines = step_lines(steps)
        if folder is not None:
            lines.append(f"report  {folder / 'report.html'}")
        if lines:
            typer.echo("\n".join(["", *lines]))
    above = over(found.verdict, max_error)
    if above and not as_json:
        typer.echo(f"\n{above}")
    raise typer.Exit(max(exit_code(found.content), int(bool(above))))
