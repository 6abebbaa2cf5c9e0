"""`steelyard identify`: a robot and logs in, a model and a report out."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import (
    LOG_HELP,
    Commanded,
    Details,
    FixedBase,
    Json,
    RobotArgument,
    Threads,
    output_folder,
)

if TYPE_CHECKING:
    from steelyard.identification.identify import Identification


@guarded
def identify(
    robot: RobotArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    validate: Annotated[
        list[str] | None,
        typer.Option("--validate", help="Logs of other motions, for validation.", metavar="LOG..."),
    ] = None,
    loaded: Annotated[
        list[str] | None,
        typer.Option(
            "--loaded",
            help="Logs with a payload, to identify unknown drive gains.",
            metavar="LOG...",
        ),
    ] = None,
    payload_mass: Annotated[
        float | None, typer.Option(min=1e-6, help="Mass of that payload, in kg.")
    ] = None,
    payload_frame: Annotated[
        str | None,
        typer.Option(help="Frame of the payload; that of the last link if unset.", metavar="NAME"),
    ] = None,
    output: Annotated[Path | None, output_folder("steelyard-ROBOT")] = None,
    no_check: Annotated[
        bool,
        typer.Option("--no-check", help="Skip the check of the logs; see `steelyard check`."),
    ] = False,
    commanded: Commanded = False,
    sensitivity: Annotated[
        bool,
        typer.Option(
            "--sensitivity", help="Repeat the fit with cut-offs x 0.5 to x 2, and compare."
        ),
    ] = False,
    bootstrap: Annotated[
        int | None,
        typer.Option(
            min=20, help="Number of bootstrap estimates, from resampled time windows.", metavar="N"
        ),
    ] = None,
    each: Annotated[
        bool,
        typer.Option(
            "--each",
            help="Also estimate from each log alone: mean and standard deviation of every "
            "parameter over the logs.",
        ),
    ] = False,
    method: Annotated[
        str | None,
        typer.Option(
            help="Estimator, such as WLS, Huber or IV, instead of the robot file's; `steelyard "
            "compare` recommends one.",
            metavar="NAME",
        ),
    ] = None,
    fixed_base: FixedBase = None,
    threads: Threads = None,
    verbose: Details = False,
    as_json: Json = False,
) -> None:
    """Identify a robot's dynamics from logs of its motion.

    The exit code is 1 if the verdict is poor, by the model or by a log of --validate: the model is
    written, but should not be used before the headline's reason is corrected.

    Example: steelyard identify ur10e.toml run1.csv run2.csv --validate run3.csv
    """
    from rich.console import Console

    from steelyard.cli.show import progress_bar
    from steelyard.report.text.next_steps import next_steps, step_lines
    from steelyard.report.text.verdict import exit_code

    with progress_bar() as progress:
        found, folder = run_identify(
            robot,
            logs,
            output,
            validate=validate or (),
            loaded=loaded or (),
            payload_mass=payload_mass,
            payload_frame=payload_frame,
            check=not no_check,
            commanded=commanded,
            sensitivity=sensitivity,
            bootstrap=bootstrap,
            each=each,
            method=method,
            fixed_base=fixed_base,
            threads=threads,
            progress=progress,
        )
    if as_json:
        typer.echo(json.dumps({"output": str(folder), **found.to_dict()}, allow_nan=False))
    else:
        found.show(Console(), verbose)
        lines = step_lines(next_steps(found.content, robot, folder))
        paths = f"model   {folder / 'model.json'}\nreport  {folder / 'report.html'}"
        typer.echo("\n".join(["", *lines, paths]))
    raise typer.Exit(exit_code(found.content))


def run_identify(
    robot: str, logs: list[str], output: Path | None, **options: Any
) -> "tuple[Identification, Path]":
    """Identify into a new folder, whole or not at all; once written, nothing stops the command."""
    from steelyard.cli import interrupt
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.identify import identify
    from steelyard.robot.xacro.read import stem_of

    folder = new_folder(output, f"steelyard-{stem_of(robot)}")
    with whole_folder(folder) as part:
        found = identify(robot, logs, **options)
        found.write(part)
        interrupt.too_late()
    return found, folder
