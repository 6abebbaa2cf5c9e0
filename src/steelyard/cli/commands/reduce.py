"""`steelyard reduce`: a smaller model that predicts as well on motion it has not seen."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Details, Json, ModelArgument, Threads, output_folder
from steelyard.identification.defaults import DESIGN_BUDGET_S


@guarded
def reduce(
    model: ModelArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    validate: Annotated[
        list[str] | None,
        typer.Option("--validate", help="Logs of other motions, for validation.", metavar="LOG..."),
    ] = None,
    criterion: Annotated[
        str,
        typer.Option(
            help="The parameter that is removed next has the least loss (rise of chi-square), "
            "contribution (to the torque), mean_column (mean absolute value of its regressor "
            "column) or deviation (value over standard deviation).",
            metavar="NAME",
        ),
    ] = "loss",
    stop: Annotated[
        str,
        typer.Option(
            help="Stopping rule: one_standard_error (smallest model with a left-out error within "
            "one standard error of the least), tolerance=5 (greatest relative rise of a joint's "
            "error in percent), bic, condition=30 (normalised condition number), ratio=30 "
            "(greatest over least relative standard deviation), count=25 (parameters), one_fewer "
            "(removes one besides those of --drop) or refit (none besides those).",
            metavar="RULE",
        ),
    ] = "one_standard_error",
    keep: Annotated[
        list[str] | None,
        typer.Option(
            "--keep",
            help="Base parameters that stay, such as 'viscous.*'; with tolerance, friction of "
            "joints that move stays too.",
            metavar="NAME...",
        ),
    ] = None,
    drop: Annotated[
        list[str] | None,
        typer.Option(
            "--drop",
            help="Base parameters that are removed first, whatever the stopping rule.",
            metavar="NAME...",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Robot file; --bodies and --next need it.", metavar="ROBOT"),
    ] = None,
    bodies: Annotated[
        bool,
        typer.Option(
            "--bodies",
            help="Estimate physically consistent link inertial parameters, with the removed "
            "parameters equal to zero; such a model can be exported.",
        ),
    ] = False,
    following: Annotated[
        Path | None,
        typer.Option(
            "--next",
            help="Also design the motion that excites the smaller model best, into this folder.",
            metavar="DIR",
        ),
    ] = None,
    last: Annotated[
        Path | None,
        typer.Option(
            "--last",
            help="trajectory.json of the motion that was logged: the next one is improved from it.",
            metavar="MOTION",
        ),
    ] = None,
    budget: Annotated[
        float, typer.Option(min=1.0, help="Time limit of that design in seconds.")
    ] = DESIGN_BUDGET_S,
    output: Annotated[Path | None, output_folder("steelyard-reduced")] = None,
    threads: Threads = None,
    verbose: Details = False,
    as_json: Json = False,
) -> None:
    """Remove parameters as long as errors on left-out data do not rise significantly.

    Removed parameters are zero, and the others are estimated again. The smaller model describes
    the speeds and postures of the logs; elsewhere a removed parameter may matter. The estimate with
    a prior (`steelyard identify`) often predicts as well without removing anything.

    Example: steelyard reduce steelyard-ur10e run1.parquet run2.parquet --validate run3.parquet
    """
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.motion.design import design_excitation
    from steelyard.identification.reduction.reduce import reduce as reduced
    from steelyard.report.text.verdict import exit_code

    _refuse_missing(robot, {"--bodies": bodies, "--next": following is not None}, last)
    folder = new_folder(output, "steelyard-reduced")
    motion_folder = None if following is None else new_folder(following, "")
    with progress_bar() as progress:
        found = reduced(
            model,
            logs,
            validate or (),
            criterion=criterion,
            stop=stop,
            keep=keep or (),
            drop=drop or (),
            bodies=robot if bodies else None,
            threads=threads,
            progress=progress,
        )
        with whole_folder(folder) as place:
            found.write(place)
            if motion_folder is None:
                interrupt.too_late()
    interrupt.finished(str(folder))
    if not as_json:
        found.show(Console(), verbose)
        typer.echo(f"\nmodel   {folder / 'model.json'}\nreport  {folder / 'report.html'}")
    if motion_folder is not None and robot is not None:
        with progress_bar() as progress, whole_folder(motion_folder) as place:
            motion = design_excitation(
                robot, earlier=found.model, start=last, budget=budget, progress=progress
            )
            motion.write(place)
            interrupt.too_late()
        if not as_json:
            typer.echo(f"motion  {motion_folder / 'trajectory.json'}")
    if as_json:
        written = {"output": str(folder), "motion": motion_folder and str(motion_folder)}
        typer.echo(json.dumps({**found.to_dict(), **written}, allow_nan=False))
    raise typer.Exit(exit_code(found.content))


def _refuse_missing(robot: str | None, asking: dict[str, bool], last: Path | None) -> None:
    """Options that others need are given.

    Args:
        robot: The robot file.
        asking: Options that need it, and whether they are given.
        last: The motion to improve, which needs `--next`.

    Raises:
        ModelError: One is missing.
    """
    from steelyard.errors import ModelError

    if robot is None and any(asking.values()):
        raise ModelError(
            f"{' and '.join(name for name, given in asking.items() if given)} without a robot file",
            where="--robot",
            fix="give the robot file that the model was identified with: --robot ROBOT",
        )
    if last is not None and not asking["--next"]:
        raise ModelError(
            "--last is given, but no motion is designed",
            where="--last",
            fix="add --next DIR, or leave --last out",
        )
