"""`steelyard compare`: estimators beside each other, each judged by a run it was not fitted to."""

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli import interrupt
from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, FixedBase, Json, RobotArgument, Threads

if TYPE_CHECKING:
    from steelyard.estimation.register import Offer
    from steelyard.identification.compare_inputs import Rivals
    from steelyard.progress import Progress
    from steelyard.report import ReportContent
    from steelyard.validation.trial import Comparison, Trial


@guarded
def compare(
    robot: RobotArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    estimators: Annotated[
        list[str] | None,
        typer.Option(
            "--estimators",
            help="Which to compare, as WLS consistent Huber IV; all that neither search nor "
            "simulate if unset.",
            metavar="NAME...",
        ),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Also those that search or simulate; takes minutes.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder to make for a page with plots; none if unset."),
    ] = None,
    no_check: Annotated[
        bool,
        typer.Option("--no-check", help="Do not check the logs before; see `steelyard check`."),
    ] = False,
    fixed_base: FixedBase = None,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Compare estimators: fit to all logs but one, predict that one, each in turn.

    Ctrl-C ends it with the estimators that are done.

    Example: steelyard compare ur10e.toml run1.parquet run2.parquet run3.parquet -o compared
    """
    from steelyard.cli.show import progress_bar
    from steelyard.identification.compare_inputs import offers_of, rivals_of
    from steelyard.identification.logs import new_folder

    folder = None if output is None else new_folder(output, "")
    offers = offers_of(estimators or (), everything)
    with progress_bar() as progress:
        cores = threads or os.cpu_count() or 1
        rivals = rivals_of(robot, logs, not no_check, cores, progress, fixed_base)
        comparison = kept(offers, rivals, progress)
    content = rivals.content(comparison)
    write(content, folder)
    if as_json:
        typer.echo(json.dumps(results(comparison, content, folder), allow_nan=False))
    else:
        show(content, folder)
    if comparison.untried:
        raise typer.Exit(interrupt.INTERRUPTED)


def kept(offers: "Sequence[Offer]", rivals: "Rivals", progress: "Progress") -> "Comparison":
    """The comparison as far as it comes: after Ctrl-C, of the estimators that are done.

    Raises:
        Interrupted: Ctrl-C was pressed before the first was done.
    """
    from steelyard.validation.compare import compared, trials_of

    trials: list[Trial] = []
    try:
        for trial in trials_of(offers, rivals.context, rivals.parts, progress=progress):
            trials.append(trial)
    except interrupt.Interrupted:
        if not trials:
            raise
        interrupt.answered()
    found = compared(trials, offers, rivals.context, rivals.parts)
    return replace(found, lines=rivals.lines)


def write(content: "ReportContent", folder: Path | None) -> None:
    """Write the page and its numbers, whole or not at all."""
    from steelyard.files import whole_folder
    from steelyard.report.compare_page import render_comparison

    if folder is None or content.comparison is None:
        return
    with whole_folder(folder) as part:
        told = {**content.comparison.to_dict(), "notes": list(content.notes)}
        (part / "compare.html").write_text(render_comparison(content), encoding="utf-8")
        (part / "compare.json").write_text(f"{json.dumps(told, indent=1)}\n", encoding="utf-8")
        interrupt.too_late()


def results(
    comparison: "Comparison", content: "ReportContent", folder: Path | None
) -> dict[str, object]:
    """What `--json` prints."""
    return {
        **comparison.to_dict(),
        "notes": list(content.notes),
        "output": None if folder is None else str(folder),
    }


def show(content: "ReportContent", folder: Path | None) -> None:
    """Print the table, the advice, and where the page is."""
    from rich.console import Console

    from steelyard.report.terminal.compare import comparison_lines

    comparison_lines(content, Console())
    if folder is not None:
        typer.echo(f"\npage  {folder / 'compare.html'}\nJSON  {folder / 'compare.json'}")
