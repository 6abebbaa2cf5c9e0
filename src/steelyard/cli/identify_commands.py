"""The commands `identify`, `validate`, `compare` and `compare-models`."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.base.progress import Progress
from steelyard.cli import interrupt
from steelyard.cli.command import (
    LOG_HELP,
    PlotsFolder,
    ReportFolder,
    computed,
    file_lines,
    optional_folder,
    output_folder,
    print_json,
    reported,
    show,
)
from steelyard.cli.derived_command import from_function

if TYPE_CHECKING:
    from steelyard.identify.comparison.compare import EstimatorComparison
    from steelyard.identify.comparison.compare_models import ComparedModels
    from steelyard.identify.identify import Identification
    from steelyard.identify.validate import Validation

NO_CHECK = {"help": "Skip the check of the logs; see `steelyard check`."}


@from_function("steelyard:identify", check=NO_CHECK, bootstrap={"metavar": "N"})
def identify(
    call: "partial[Identification]",
    output: Annotated[Path | None, output_folder("steelyard-ROBOT")] = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Identify a robot's dynamics from logs of its motion.

    The exit code is 1 if the verdict is poor, by the model or by a log of --validate: the model is
    written, but should not be used before the headline's reason is corrected.

    Example: steelyard identify ur10e.toml run1.csv run2.csv --validate run3.csv
    """
    from steelyard.base.files import new_folder
    from steelyard.identify.page.verdict_and_next_steps import exit_code, next_steps, step_lines
    from steelyard.robot.models.xacro import stem_of

    robot = call.keywords["robot"]
    folder = new_folder(output, f"steelyard-{stem_of(robot)}")
    found = computed(call, folder)
    if as_json:
        print_json({"output": str(folder), **found.to_dict()})
    else:
        show(found, verbose)
        lines = step_lines(next_steps(found.content, robot, folder))
        paths = file_lines(folder, model="model.json", report="report.html")
        typer.echo("\n".join(["", *lines, paths]))
    raise typer.Exit(exit_code(found.content))


@from_function("steelyard:validate", max_error={"min": 0.0, "metavar": "PERCENT"})
def validate(
    call: "partial[Validation]",
    output: ReportFolder = None,
    max_error: float | None = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Score an identified model on logs that it was not fitted to.

    Options:
        max_error: Largest error, in % of the effort used; above it the exit code is 1.

    Exit code 0: done, and the error is not too large. 1: the verdict is poor (the headline's error
    is above 30 %, or something is wrong with these logs), or with --max-error: that error is above
    it, or no log has unseen motion. 2: not done.

    Example: steelyard validate steelyard-ur10e other_motion.csv
    """
    from steelyard.identify.page.verdict_and_next_steps import (
        error_limit_words,
        exit_code,
        fix_commands,
        path_word,
        robot_file,
        step_lines,
    )

    folder, model = optional_folder(output), call.keywords["model"]
    found = computed(call, folder)
    if as_json:
        print_json(found.to_dict()["logs"])
    else:
        show(found, verbose)
        steps = fix_commands(found.content, model, robot_file(found.content))
        if not found.content.scores:
            steps = (
                *steps,
                (f"steelyard validate {path_word(model)} OTHER_LOG", "error on another motion"),
            )
        lines = step_lines(steps)
        if folder is not None:
            lines.append(file_lines(folder, report="report.html"))
        if lines:
            typer.echo("\n".join(["", *lines]))
    above = error_limit_words(found.verdict, max_error)
    if above and not as_json:
        typer.echo(f"\n{above}")
    raise typer.Exit(max(exit_code(found.content), int(bool(above))))


@from_function(
    "steelyard:compare",
    estimators={"metavar": "NAME..."},
    everything={"name": "--all"},
    check=NO_CHECK,
    interruption=None,
)
def compare(
    call: "partial[EstimatorComparison]",
    output: PlotsFolder = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Compare estimators by cross-validation: fit all logs but one and predict it.

    Ctrl-C ends the comparison; finished estimators are reported.

    Example: steelyard compare ur10e.toml run1.csv run2.csv run3.csv -o compared
    """

    def compute(progress: Progress) -> "EstimatorComparison":
        found = call(progress=progress, interruption=interrupt.Interrupted)
        if found.untried:
            interrupt.answered()
        return found

    files = {"page": "compare.html", "JSON": "compare.json"}
    found = reported(compute, output, as_json, verbose, **files)
    if found.untried:
        raise typer.Exit(interrupt.INTERRUPTED)


@from_function(
    "steelyard:compare_models",
    models={
        "help": "Two or more models: model.json, or the folders that contain it.",
        "metavar": "MODEL...",
    },
    logs={
        "name": "--on",
        "help": f"{LOG_HELP} Not logs that a model was identified from.",
        "metavar": "LOG...",
    },
)
def compare_models(
    call: "partial[ComparedModels]",
    output: PlotsFolder = None,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Compare identified models of one robot on logs: errors, parameters, masses, efforts.

    Logs are processed as for the first model, so that all models predict the same effort.

    Example: steelyard compare-models full-model reduced-model --on other_motion.csv -o compared
    """
    reported(call, output, as_json, verbose, page="models.html", JSON="models.json")
