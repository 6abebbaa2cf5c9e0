"""`steelyard compare`: estimators beside each other, each judged by a run it was not fitted to."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli import interrupt
from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Details, FixedBase, Json, RobotArgument, Threads


@guarded
def compare(
    robot: RobotArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    estimators: Annotated[
        list[str] | None,
        typer.Option(
            "--estimators",
            help="Estimators to compare, such as WLS consistent Huber IV; if unset, all without "
            "random search or simulation.",
            metavar="NAME...",
        ),
    ] = None,
    everything: Annotated[
        bool,
        typer.Option(
            "--all", help="Also estimators that use random search or simulation; takes minutes."
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for a page with plots; none if unset."),
    ] = None,
    no_check: Annotated[
        bool,
        typer.Option("--no-check", help="Skip the check of the logs; see `steelyard check`."),
    ] = False,
    fixed_base: FixedBase = None,
    threads: Threads = None,
    verbose: Details = False,
    as_json: Json = False,
) -> None:
    """Compare estimators by cross-validation: fit all logs but one and predict it.

    Ctrl-C ends the comparison; finished estimators are reported.

    Example: steelyard compare ur10e.toml run1.csv run2.csv run3.csv -o compared
    """
    from rich.console import Console

    from steelyard.cli.show import progress_bar
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.comparison.compare import compare as compared

    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress, ExitStack() as parts:
        found = compared(
            robot,
            logs,
            estimators or (),
            everything=everything,
            check=not no_check,
            fixed_base=fixed_base,
            threads=threads,
            progress=progress,
            interruption=interrupt.Interrupted,
        )
        if found.untried:
            interrupt.answered()
        if folder is not None:
            found.write(parts.enter_context(whole_folder(folder)))
            interrupt.too_late()
    if as_json:
        content = {**found.to_dict(), "output": folder and str(folder)}
        typer.echo(json.dumps(content, allow_nan=False))
    else:
        found.show(Console(), verbose)
        if folder is not None:
            typer.echo(f"\npage  {folder / 'compare.html'}\nJSON  {folder / 'compare.json'}")
    if found.untried:
        raise typer.Exit(interrupt.INTERRUPTED)
