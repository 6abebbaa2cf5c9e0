"""`steelyard identify`: a robot and logs in, a model and a report out."""

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, FixedBase, Json, Output, RobotArgument, Threads

if TYPE_CHECKING:
    from steelyard.diagnosis import Diagnosis, Finding
    from steelyard.estimation.identified import IdentifiedModel
    from steelyard.identification.fitting import Fit
    from steelyard.measurement import Run
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
    loaded: Annotated[
        list[str] | None,
        typer.Option(
            "--loaded",
            help="Logs with a payload, to identify drive gains that are not known.",
            metavar="LOG...",
        ),
    ] = None,
    payload_mass: Annotated[
        float | None, typer.Option(min=1e-6, help="Mass of that payload, in kg.")
    ] = None,
    payload_frame: Annotated[
        str | None,
        typer.Option(help="Frame that carries it; the last link's if unset.", metavar="NAME"),
    ] = None,
    output: Output = None,
    no_check: Annotated[
        bool,
        typer.Option("--no-check", help="Do not check the logs before; see `steelyard check`."),
    ] = False,
    sensitivity: Annotated[
        bool,
        typer.Option("--sensitivity", help="Fit again with cut-offs x 0.5 to x 2, and compare."),
    ] = False,
    bootstrap: Annotated[
        int | None,
        typer.Option(
            min=20, help="Estimate again so often from windows of time drawn again.", metavar="N"
        ),
    ] = None,
    fixed_base: FixedBase = None,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Identify a robot's dynamics from logs of its motion.

    The exit code is 1 if the verdict is poor: the model is written, but not to be relied on.

    Example: steelyard identify ur10e.toml run1.parquet run2.parquet --validate run3.parquet
    """
    from rich.console import Console

    from steelyard.cli.show import progress_bar
    from steelyard.report.terminal.bootstrap import bootstrap_lines
    from steelyard.report.terminal.sensitivity import sensitivity_lines
    from steelyard.report.terminal.terminal import summary
    from steelyard.report.text.judgement import exit_code

    with progress_bar() as progress:
        content, folder = run_identify(
            robot,
            logs,
            validate or [],
            output,
            threads or os.cpu_count() or 1,
            progress,
            loaded=loaded or [],
            payload_mass=payload_mass,
            payload_frame=payload_frame,
            check=not no_check,
            sensitivity=sensitivity,
            bootstrap=bootstrap,
            fixed_base=fixed_base,
        )
    if as_json:
        typer.echo(json.dumps(results(content, folder), allow_nan=False))
    else:
        summary(content, Console())
        if content.sensitivity is not None:
            sensitivity_lines(content.sensitivity, Console())
        if content.bootstrap is not None:
            bootstrap_lines(content, Console())
        typer.echo(f"\nmodel   {folder / 'model.json'}\nreport  {folder / 'report.html'}")
    raise typer.Exit(exit_code(content))


def run_identify(
    robot: str,
    logs: list[str],
    validate: list[str],
    output: Path | None,
    threads: int,
    progress: "Progress",
    *,
    loaded: Sequence[str] = (),
    payload_mass: float | None = None,
    payload_frame: str | None = None,
    check: bool = True,
    sensitivity: bool = False,
    bootstrap: int | None = None,
    fixed_base: str | None = None,
    last: bool = True,
) -> "tuple[ReportContent, Path]":
    """The whole river; writes the output folder, whole or not at all.

    With `check`, a log that is not what the robot file says stops it. With `last`, nothing can
    stop the command once the folder is written.
    """
    from steelyard.cli import interrupt
    from steelyard.diagnosis.fitted.absurd import refuse_absurd
    from steelyard.diagnosis.signals.moving_base import of_base
    from steelyard.files import whole_folder
    from steelyard.identification.bootstrap import drawn_again
    from steelyard.identification.descriptions import dropped, notes_of, provenance
    from steelyard.identification.fitting import Payload, calibrated, fit
    from steelyard.identification.logs import (
        log_files,
        model_of,
        new_folder,
        refuse_overlaps,
        runs_of,
        signals_of,
    )
    from steelyard.identification.precheck import checked, passed
    from steelyard.identification.repeated_rows import refuse_same_rows
    from steelyard.identification.sensitivity import varied
    from steelyard.robot_file.file import load_robot

    file = load_robot(robot, base=fixed_base)
    folder = new_folder(output, f"steelyard-{file.stem}")
    known, carrying, unknown = (log_files(some) for some in (logs, loaded, validate))
    refuse_overlaps([*known, *carrying], unknown)
    signals, reasons = signals_of(file, known[0])
    model = model_of(file)
    with whole_folder(folder) as part:
        found_out = None
        if check:
            given = replace(file, signals=signals)
            found_out = checked(robot, given, (*known, *unknown), progress)
        clean, unseen = runs_of(file, signals, [*known, *carrying], unknown, progress)
        doubts = () if found_out is None else passed(found_out, robot)
        notes = (*file.notes, *reasons, *notes_of((*clean, *unseen)), *doubts)
        refuse_same_rows(clean, unseen)
        fitted, loaded_runs = clean[: len(known)], clean[len(known) :]
        origin = provenance(file, known, carrying, unknown, fitted, notes)
        payload = Payload(payload_mass, payload_frame)
        found = fit(model, file, fitted, loaded_runs, payload, origin, threads, progress)
        if check:
            refuse_absurd(found.identified, robot)
        found = calibrated(found, threads, progress)
        unseen = tuple(found.alike(run) for run in unseen)
        notes += (*found.notes, *dropped(model, (*clean, *unseen)))
        content = report_of(found, unseen, (*clean, *unseen), notes, progress)
        content = replace(content, diagnosis=found_out)
        limits = limitations_of(found, unseen, content, progress)
        limits += of_base(file, () if found_out is None else found_out.findings)
        content = replace(content, limitations=limits)
        if sensitivity:
            content = varied(content, found, (known, unknown), threads, progress)
        if bootstrap is not None:
            content = drawn_again(content, found, bootstrap, progress)
        write_results(found.identified, content, part)
        if last:
            interrupt.too_late()
    return content, folder


def report_of(
    fit: "Fit",
    unseen: "Sequence[Run]",
    logs: "Sequence[Run]",
    notes: tuple[str, ...],
    progress: "Progress",
) -> "ReportContent":
    """Score the model on all runs; what the report shows."""
    from steelyard.identification.descriptions import settings
    from steelyard.identification.logs import scored
    from steelyard.identification.repeated_rows import marked_repeats
    from steelyard.report import ReportContent

    identified, fitted = fit.identified, fit.runs
    name = identified.model.robot.name
    scores = scored(identified, (*fitted, *unseen), progress)
    fresh = marked_repeats(identified, unseen, scores[len(fitted) :])
    return ReportContent(
        title=f"{name}: identified dynamics",
        robot=name,
        identified=identified,
        scores=fresh,
        fitted=scores[: len(fitted)],
        qualities=tuple((run.name, run.quality.rows_of_text) for run in logs),
        notes=notes,
        settings=settings(identified),
        friction=fit.choice,
        findings=fit.findings,
        gains=fit.gains,
        offsets=fit.offsets,
        scales=fit.scales,
    )


def limitations_of(
    fit: "Fit",
    unseen: "Sequence[Run]",
    content: "ReportContent",
    progress: "Progress",
) -> "tuple[Finding, ...]":
    """What checks of the fitted model find."""
    from steelyard.diagnosis.fitted.post_fit import FittedCase, examine_fit

    case = FittedCase(
        fit.identified,
        tuple(fit.runs),
        tuple(unseen),
        content.fitted,
        content.scores,
        fit.information,
        doubts_of(content.diagnosis, fit.runs),
        fit.scales,
    )
    return examine_fit(case, progress)


def doubts_of(diagnosis: "Diagnosis | None", fitted: "Sequence[Run]") -> "tuple[Finding, ...]":
    """Other readings of the fitted runs that the check before found as good, or better."""
    from steelyard.diagnosis import Judgement

    names = {run.name for run in fitted}
    found = () if diagnosis is None else diagnosis.findings
    return tuple(
        finding
        for finding in found
        if finding.judgement == Judgement.DOUBTFUL and finding.hypotheses and finding.log in names
    )


def write_results(identified: "IdentifiedModel", content: "ReportContent", folder: Path) -> None:
    """Write `model.json`, `parameters.csv` and `report.html`."""
    from steelyard.report import render
    from steelyard.report.terminal.terminal import parameters_csv

    (folder / "model.json").write_text(identified.text(), encoding="utf-8")
    (folder / "parameters.csv").write_text(parameters_csv(identified), encoding="utf-8")
    (folder / "report.html").write_text(render(content), encoding="utf-8")


def results(content: "ReportContent", folder: Path) -> dict[str, object]:
    """What `--json` prints."""
    if content.identified is None:
        raise ValueError("there are results of an identified model only")
    from steelyard.report.text.findings import diagnosis_dict, finding_dict
    from steelyard.report.text.judgement import verdict
    from steelyard.terms.register import description_of

    estimate = content.identified.estimate
    return {
        "output": str(folder),
        "verdict": verdict(content).to_dict(),
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
        "per_run": [{"run": own.run, **own.parameters.as_dict()} for own in estimate.per_run],
        "terms": [description_of(term) for term in content.identified.model.terms],
        "friction": None if content.friction is None else content.friction.to_dict(),
        "fields": [finding.to_dict() for finding in content.findings],
        "gains": None if content.gains is None else content.gains.to_dict(),
        "zero_offsets": None if content.offsets is None else content.offsets.to_dict(),
        "effort_scales": None if content.scales is None else content.scales.to_dict(),
        "not_seen": [blind.name for blind in estimate.blind],
        "condition": estimate.condition,
        "condition_normalised": estimate.condition_normalised,
        "validation": [score.to_dict() for score in content.scores],
        "identification": [score.to_dict() | {"motion": "fitted"} for score in content.fitted],
        "limitations": [finding_dict(finding) for finding in content.limitations],
        "check": None if content.diagnosis is None else diagnosis_dict(content.diagnosis),
        "sensitivity": None if content.sensitivity is None else content.sensitivity.to_dict(),
        "bootstrap": None if content.bootstrap is None else content.bootstrap.to_dict(),
        "notes": list(content.notes),
    }
