"""The commands `identify`, `validate`, `compare` and `compare-models`."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steelyard.cli import interrupt
from steelyard.cli.command import (
    LOG_HELP,
    Commanded,
    Details,
    FixedBase,
    Json,
    ModelArgument,
    RobotArgument,
    Threads,
    guarded,
    output_folder,
)

if TYPE_CHECKING:
    from steelyard.identify.identify import Identification


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

    from steelyard.cli.command import progress_bar
    from steelyard.identify.page.model_verdict import exit_code, next_steps, step_lines

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
    from steelyard.base.files import new_folder, whole_folder
    from steelyard.cli import interrupt
    from steelyard.identify.identify import identify
    from steelyard.robot.models.xacro import stem_of

    folder = new_folder(output, f"steelyard-{stem_of(robot)}")
    with whole_folder(folder) as part:
        found = identify(robot, logs, **options)
        found.write(part)
        interrupt.too_late()
    return found, folder


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

    from steelyard.base.files import new_folder, whole_folder
    from steelyard.cli import interrupt
    from steelyard.cli.command import progress_bar
    from steelyard.identify.page.model_verdict import (
        error_limit_words,
        exit_code,
        fix_commands,
        path_word,
        robot_file,
        step_lines,
    )
    from steelyard.identify.validate import validate as validated

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
        steps = fix_commands(found.content, model, robot_file(found.content))
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
    above = error_limit_words(found.verdict, max_error)
    if above and not as_json:
        typer.echo(f"\n{above}")
    raise typer.Exit(max(exit_code(found.content), int(bool(above))))


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

    from steelyard.base.files import new_folder, whole_folder
    from steelyard.cli.command import progress_bar
    from steelyard.identify.comparison.compare import compare as compared

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

    from steelyard.base.files import new_folder, whole_folder
    from steelyard.cli import interrupt
    from steelyard.cli.command import progress_bar
    from steelyard.identify.comparison.compare_models import compare_models as compared

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
