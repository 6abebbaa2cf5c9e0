"""`steelyard validate`: how well an identified model predicts other logs."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json

if TYPE_CHECKING:
    from steelyard.diagnosis import Finding
    from steelyard.estimation.identified import IdentifiedModel
    from steelyard.measurement import Run
    from steelyard.progress import Progress
    from steelyard.report import ReportContent
    from steelyard.validation.score import RunScore


@guarded
def validate(
    model: Annotated[
        str, typer.Argument(help="model.json, or the folder that holds it.", metavar="MODEL")
    ],
    logs: Annotated[list[str], typer.Argument(help=LOG_HELP, metavar="LOG...")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder to make for a report; none if unset."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Score an identified model on logs that it was not fitted to.

    The exit code is 1 if the verdict is poor: the error is above 30 %, or a check of the model on
    these logs finds something wrong. A score itself is no failure.

    Example: steelyard validate steelyard-ur10e other_motion.parquet
    """
    from rich.console import Console

    from steelyard.cli.show import progress_bar
    from steelyard.report.terminal.terminal import summary
    from steelyard.report.text.judgement import exit_code

    with progress_bar() as progress:
        content = run_validate(model, logs, output, progress)
    if as_json:
        typer.echo(json.dumps(results(content), allow_nan=False))
    else:
        summary(content, Console())
        if output is not None:
            typer.echo(f"\nreport  {output / 'report.html'}")
    raise typer.Exit(exit_code(content))


def run_validate(
    model: str, logs: list[str], output: Path | None, progress: "Progress"
) -> "ReportContent":
    """Score a model on logs; writes the output folder, if one is wanted, whole or not at all."""
    from steelyard.cli import interrupt
    from steelyard.estimation.identified import load_model
    from steelyard.files import whole_folder
    from steelyard.identification.logs import (
        fitted_before,
        log_files,
        new_folder,
        prepared,
        processing_of,
        recording_of,
        scored,
    )
    from steelyard.identification.repeated_rows import holds_fitted_rows, marked_repeats
    from steelyard.report import render

    identified = load_model(model)
    folder = None if output is None else new_folder(output, "")
    files = log_files(logs)
    recordings = [recording_of(log, identified.signals) for log in files]
    runs = prepared(recordings, processing_of(identified), progress)
    scores = scored(identified, runs, progress)
    scores = marked_repeats(identified, runs, scores)
    known = [
        fitted_before(identified, log) or holds_fitted_rows(identified, run)
        for log, run in zip(files, runs, strict=True)
    ]
    content = _content(identified, runs, scores, known)
    content = replace(content, limitations=limitations_of(identified, runs, scores, known))
    if folder is not None:
        with whole_folder(folder) as part:
            (part / "report.html").write_text(render(content), encoding="utf-8")
            interrupt.too_late()
    return content


def results(content: "ReportContent") -> list[dict[str, object]]:
    """What `--json` prints: scores and verdict of each log, in the order of the logs."""
    order = [name for name, _ in content.qualities]
    found = [_result(content, score, fitted=False) for score in content.scores]
    found += [_result(content, score, fitted=True) for score in content.fitted]
    return sorted(found, key=lambda one: order.index(str(one["run"])))


def _result(content: "ReportContent", score: "RunScore", *, fitted: bool) -> dict[str, object]:
    from steelyard.report.text.findings import finding_dict
    from steelyard.report.text.judgement import verdict

    own = replace(
        content,
        scores=() if fitted else (score,),
        fitted=(score,) if fitted else (),
        limitations=tuple(f for f in content.limitations if f.log in ("", score.run)),
    )
    return {
        **score.to_dict(),
        "fitted": fitted,
        "verdict": verdict(own).to_dict(),
        "limitations": [finding_dict(finding) for finding in own.limitations],
    }


def _content(
    identified: "IdentifiedModel",
    runs: "Sequence[Run]",
    scores: "Sequence[RunScore]",
    known: Sequence[bool],
) -> "ReportContent":
    """What the report shows; `known` says which runs the model was fitted to."""
    from steelyard.identification.descriptions import dropped, notes_of, settings
    from steelyard.report import ReportContent

    again = tuple(score for score, old in zip(scores, known, strict=True) if old)
    return ReportContent(
        title=f"{identified.model.robot.name}: validation",
        robot=identified.model.robot.name,
        identified=identified,
        scores=tuple(score for score, old in zip(scores, known, strict=True) if not old),
        fitted=again,
        qualities=tuple((run.name, run.quality.rows_of_text) for run in runs),
        notes=(
            *notes_of(runs),
            *dropped(identified.model, runs),
            *(f"{score.run} was fitted: its score is no test of the model" for score in again),
        ),
        settings=settings(identified),
    )


def limitations_of(
    identified: "IdentifiedModel",
    runs: "Sequence[Run]",
    scores: "Sequence[RunScore]",
    known: Sequence[bool],
) -> "tuple[Finding, ...]":
    """What checks of the model on runs that it was not fitted to find."""
    from steelyard.diagnosis.fitted.post_fit import FittedCase, examine_fit

    fresh = [(run, score) for run, score, old in zip(runs, scores, known, strict=True) if not old]
    unseen, unseen_scores = tuple(run for run, _ in fresh), tuple(score for _, score in fresh)
    return examine_fit(FittedCase(identified, unseen=unseen, unseen_scores=unseen_scores))
