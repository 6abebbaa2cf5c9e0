"""`steelyard identify`: a robot and logs in, a model and a report out."""

import json
import os
from collections.abc import Sequence
from functools import reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json, Output, RobotArgument, Threads

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel, Provenance
    from steelyard.measurement import Run
    from steelyard.model import Model
    from steelyard.progress import Progress
    from steelyard.report import ReportContent
    from steelyard.robot.robot_file import LoadedRobot
    from steelyard.robot.signals import Signals


@guarded
def identify(
    robot: RobotArgument,
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    validate: Annotated[
        list[str] | None,
        typer.Option(
            "--validate", help="Logs of other motions, to be predicted.", metavar="LOG..."
        ),
    ] = None,
    output: Output = None,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Identify a robot's dynamics from logs of its motion.

    Example: steelyard identify ur10e.toml run1.parquet run2.parquet --validate run3.parquet
    """
    from rich.console import Console

    from steelyard.cli.show import progress_bar
    from steelyard.report.terminal import summary

    with progress_bar() as progress:
        content, folder = run_identify(
            robot, logs, validate or [], output, threads or os.cpu_count() or 1, progress
        )
    if as_json:
        typer.echo(json.dumps(results(content, folder), allow_nan=False))
        return
    summary(content, Console())
    typer.echo(f"\nmodel   {folder / 'model.json'}\nreport  {folder / 'report.html'}")


def run_identify(
    robot: str,
    logs: list[str],
    validate: list[str],
    output: Path | None,
    threads: int,
    progress: "Progress",
    *,
    last: bool = True,
) -> "tuple[ReportContent, Path]":
    """The whole river; writes the output folder, whole or not at all.

    With `last`, nothing can stop the command once the folder is written.
    """
    from steelyard.cli import describe, interrupt, river
    from steelyard.files import whole_folder
    from steelyard.measurement import Processing
    from steelyard.robot.robot_file import load_robot

    loaded = load_robot(robot)
    folder = river.new_folder(output, f"steelyard-{Path(robot).stem}")
    known, unknown = river.log_files(logs), river.log_files(validate)
    river.refuse_overlaps(known, unknown)
    signals, reasons = river.signals_of(loaded, known[0])
    model = river.model_of(loaded)
    wanted = Processing(**loaded.processing.model_dump())
    with whole_folder(folder) as part:
        fitted = river.prepared(
            [river.recording_of(log, signals) for log in known], wanted, progress
        )
        unseen = river.prepared(
            [river.recording_of(log, signals) for log in unknown],
            river.settled(wanted, fitted),
            progress,
        )
        notes = (*loaded.notes, *reasons, *describe.notes_of((*fitted, *unseen)))
        origin = describe.provenance(
            loaded, [log.path for log in known], [log.path for log in unknown], fitted, notes
        )
        identified = fit(model, fitted, signals, loaded, origin, threads, progress)
        content = report_of(identified, fitted, unseen, notes, progress)
        write_results(identified, content, part)
        if last:
            interrupt.too_late()
    return content, folder


def fit(
    model: "Model",
    runs: "Sequence[Run]",
    signals: "Signals",
    loaded: "LoadedRobot",
    origin: "Provenance",
    threads: int,
    progress: "Progress",
) -> "IdentifiedModel":
    """Gather what the runs say, and estimate."""
    from steelyard.estimation.identified import Cutoffs, IdentifiedModel
    from steelyard.estimation.least_squares import OrdinaryLeastSquares, WeightedLeastSquares
    from steelyard.regression.gather import gather
    from steelyard.regression.regressor import base_regressor

    regressor = base_regressor(model)
    said = [gather(regressor, run, threads=threads, progress=progress) for run in runs]
    information = reduce(add, said).scaled(signals.gains, model.robot.effort_units)
    return IdentifiedModel(
        model=model,
        base=regressor.base,
        estimate=WeightedLeastSquares()(information),
        reference=(OrdinaryLeastSquares()(information),),
        signals=signals,
        cutoffs=Cutoffs(
            motion=runs[0].motion_cutoff,
            matched=runs[0].matched_cutoff,
            score=loaded.validation.cutoff or runs[0].matched_cutoff,
        ),
        rest_speed=loaded.processing.rest_speed,
        provenance=origin,
    )


def report_of(
    identified: "IdentifiedModel",
    fitted: "Sequence[Run]",
    unseen: "Sequence[Run]",
    notes: tuple[str, ...],
    progress: "Progress",
) -> "ReportContent":
    """Score the model on all runs; what the report shows."""
    from steelyard.cli import describe, river
    from steelyard.report import ReportContent

    name, runs = identified.model.robot.name, (*fitted, *unseen)
    scores = river.scored(identified, runs, progress)
    return ReportContent(
        title=f"{name}: identified dynamics",
        robot=name,
        identified=identified,
        scores=scores[len(fitted) :],
        fitted=scores[: len(fitted)],
        qualities=tuple((run.name, run.quality.rows_of_text) for run in runs),
        notes=notes,
        settings=describe.settings(identified),
    )


def write_results(identified: "IdentifiedModel", content: "ReportContent", folder: Path) -> None:
    """Write `model.json`, `parameters.csv` and `report.html`."""
    from steelyard.report import render
    from steelyard.report.terminal import parameters_csv

    (folder / "model.json").write_text(identified.text(), encoding="utf-8")
    (folder / "parameters.csv").write_text(parameters_csv(identified), encoding="utf-8")
    (folder / "report.html").write_text(render(content), encoding="utf-8")


def results(content: "ReportContent", folder: Path) -> dict[str, object]:
    """What `--json` prints."""
    if content.identified is None:
        raise ValueError("there are results of an identified model only")
    estimate = content.identified.estimate
    return {
        "output": str(folder),
        "n_base_parameters": len(content.identified.base),
        "parameters": [
            {"name": n, "unit": u, "value": v, "std": s}
            for n, u, v, s in zip(
                estimate.parameters.names,
                estimate.parameters.units,
                estimate.parameters.values.tolist(),
                estimate.std.tolist(),
                strict=True,
            )
        ],
        "not_seen": [blind.name for blind in estimate.blind],
        "condition": estimate.condition,
        "condition_normalised": estimate.condition_normalised,
        "validation": [score.to_dict() for score in content.scores],
        "identification": [score.to_dict() for score in content.fitted],
        "notes": list(content.notes),
    }
