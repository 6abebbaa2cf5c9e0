"""`steelyard identify`: a robot and logs in, a model and a report out."""

import json
import os
from functools import reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json, Output, RobotArgument, Threads

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel
    from steelyard.progress import Progress
    from steelyard.report import ReportContent


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
    from steelyard.estimation.identified import Cutoffs, IdentifiedModel
    from steelyard.estimation.least_squares import OrdinaryLeastSquares, WeightedLeastSquares
    from steelyard.files import whole_folder
    from steelyard.measurement import Processing
    from steelyard.regression.gather import gather
    from steelyard.regression.regressor import base_regressor
    from steelyard.report import ReportContent
    from steelyard.robot.robot_file import load_robot

    loaded = load_robot(robot)
    folder = river.new_folder(output, f"steelyard-{loaded.robot.name}")
    fitted, unseen = river.log_files(logs), river.log_files(validate)
    signals, reasons = river.signals_of(loaded, fitted[0])
    model = river.model_of(loaded)
    with whole_folder(folder) as part:
        wanted = Processing(**loaded.processing.model_dump())
        runs = river.prepared(
            [river.recording_of(log, signals) for log in fitted], wanted, progress
        )
        runs += river.prepared(
            [river.recording_of(log, signals) for log in unseen],
            river.settled(wanted, runs),
            progress,
        )
        regressor = base_regressor(model)
        raw = reduce(
            add,
            [
                gather(regressor, run, threads=threads, progress=progress)
                for run in runs[: len(fitted)]
            ],
        )
        information = raw.scaled(signals.gains, model.robot.effort_units)
        cutoffs = Cutoffs(
            motion=runs[0].motion_cutoff,
            matched=runs[0].matched_cutoff,
            score=loaded.validation.cutoff or runs[0].matched_cutoff,
        )
        notes = (*loaded.notes, *reasons, *describe.notes_of(runs))
        identified = IdentifiedModel(
            model=model,
            base=regressor.base,
            estimate=WeightedLeastSquares()(information),
            reference=(OrdinaryLeastSquares()(information),),
            signals=signals,
            cutoffs=cutoffs,
            rest_speed=loaded.processing.rest_speed,
            provenance=describe.provenance(
                loaded,
                [log.path for log in fitted],
                [log.path for log in unseen],
                runs[: len(fitted)],
                notes,
            ),
        )
        scores = river.scored(identified.valued, runs, signals.gains, cutoffs.score, progress)
        content = ReportContent(
            title=f"{model.robot.name}: identified dynamics",
            robot=model.robot.name,
            identified=identified,
            scores=scores[len(fitted) :],
            fitted=scores[: len(fitted)],
            qualities=tuple((run.name, run.quality.rows_of_text) for run in runs),
            notes=notes,
            settings=describe.settings(signals, cutoffs, identified.estimate.estimator),
        )
        write_results(identified, content, part)
        if last:
            interrupt.too_late()
    return content, folder


def write_results(identified: "IdentifiedModel", content: "ReportContent", folder: Path) -> None:
    """Write `model.json`, `parameters.csv` and `report.html`."""
    from steelyard.report import render
    from steelyard.report.terminal import parameters_csv

    (folder / "model.json").write_text(identified.text(), encoding="utf-8")
    (folder / "parameters.csv").write_text(parameters_csv(identified), encoding="utf-8")
    (folder / "report.html").write_text(render(content), encoding="utf-8")


def results(content: "ReportContent", folder: Path) -> dict[str, object]:
    """What `--json` prints."""
    identified = content.identified
    assert identified is not None
    estimate = identified.estimate
    return {
        "output": str(folder),
        "n_base_parameters": len(identified.base),
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
