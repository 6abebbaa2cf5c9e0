"""The commands `payload`, `contact`, `wrench`, `health` and `feedforward`."""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from steelyard.cli.command import LOG_HELP, AlarmRate, Json, ModelArgument, guarded


@guarded
def payload(
    model: ModelArgument,
    logs: Annotated[
        list[str], typer.Argument(help=f"With the payload. {LOG_HELP}", metavar="LOG...")
    ],
    frame: Annotated[
        str | None,
        typer.Option(help="Frame of the results; that of the last link if unset.", metavar="NAME"),
    ] = None,
    unloaded: Annotated[
        list[str] | None,
        typer.Option(
            "--unloaded",
            help="Logs without the payload: arm and payload are then identified together, and "
            "the parameter values of the model are not used.",
            metavar="LOG...",
        ),
    ] = None,
    gain_uncertainty: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=0.5,
            help="Relative standard deviation of each gain of the efforts; if unset 0.02 for "
            "motor currents and motor torques; 0 for joint torques, and where scales of the "
            "efforts were identified with the model.",
            metavar="SHARE",
        ),
    ] = None,
    mass: Annotated[
        float | None, typer.Option(min=1e-6, help="Known mass, in kg.", metavar="KG")
    ] = None,
    com: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Known centre of mass in the frame, in m.", metavar="X Y Z"),
    ] = None,
    box: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            help="Prior of the inertia: a box with these edges along the frame's axes, in m.",
            metavar="X Y Z",
        ),
    ] = None,
    cylinder: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Prior of the inertia: a cylinder along z, diameter and length in m.",
            metavar="D L",
        ),
    ] = None,
    sphere: Annotated[
        float | None,
        typer.Option(help="Prior of the inertia: a sphere, diameter in m.", metavar="D"),
    ] = None,
    when: Annotated[
        bool,
        typer.Option(
            "--when", help="Find when something is picked up and put down along each log."
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Output folder for payload.json and, with --when, a page."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Identify a payload: physically consistent mass, centre and inertia, with 95 % intervals.

    With --when: times at which it is picked up and put down, each with a 95 % interval.

    Example: steelyard payload steelyard-ur10e loaded.csv --frame tool0 --box 0.2 0.1 0.1
    """
    from rich.console import Console

    from steelyard.base.files import new_folder, whole_folder, write_json
    from steelyard.cli import interrupt
    from steelyard.cli.command import progress_bar
    from steelyard.estimate.payload.payload_estimate import PayloadEstimate
    from steelyard.uses.payload.payload import known_of, payload_inputs
    from steelyard.uses.payload.payload_events import events_dict
    from steelyard.uses.payload.payload_page import (
        event_lines,
        payload_lines,
        render_payload_events,
    )

    known = known_of(mass, com, box, cylinder, sphere)
    task = payload_inputs(model, logs, frame, unloaded or (), known)
    folder = None if output is None else new_folder(output, "")
    with progress_bar() as progress:
        found = (task.events if when else task.done)(gain_uncertainty, progress)
    result = found.to_dict() if isinstance(found, PayloadEstimate) else events_dict(found)
    if folder is not None:
        with whole_folder(folder) as part:
            write_json(part / "payload.json", result)
            if not isinstance(found, PayloadEstimate):
                page = render_payload_events(found, task.identified.robot.name)
                (part / "report.html").write_text(page, encoding="utf-8")
            interrupt.too_late()
    if as_json:
        typer.echo(json.dumps(result, allow_nan=False))
        return
    if isinstance(found, PayloadEstimate):
        payload_lines(found, Console())
    else:
        event_lines(found, Console())
    if folder is not None:
        typer.echo(f"\npayload  {folder / 'payload.json'}")
        if when:
            typer.echo(f"report   {folder / 'report.html'}")


@guarded
def contact(
    model: ModelArgument,
    log: Annotated[str, typer.Argument(help=LOG_HELP, metavar="LOG")],
    calibrate: Annotated[
        list[str] | None,
        typer.Option(
            "--calibrate",
            help="Logs of motion without contact, not fitted, to calibrate thresholds with; if "
            "unset, the residuals of the cross-validation that are stored in the model.",
            metavar="LOG...",
        ),
    ] = None,
    rate: AlarmRate = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for the report; none if unset."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find contacts in a log without a force sensor: when, at which joints, on which link.

    Example: steelyard contact steelyard-ur10e shift.csv --calibrate free1.csv free2.csv
    """
    from steelyard.cli.command import computed
    from steelyard.uses.contact.contact import contact as found_in

    computed(
        lambda progress: found_in(
            model, log, calibrate=calibrate or (), rate=rate, progress=progress
        ),
        output,
        as_json,
        report="report.html",
    )


@guarded
def wrench(
    model: ModelArgument,
    log: Annotated[str, typer.Argument(help=LOG_HELP, metavar="LOG")],
    frame: Annotated[
        str | None,
        typer.Option(help="Frame that the wrench acts on; that of the robot's end if unset."),
    ] = None,
    axes: Annotated[
        Literal["frame", "base"], typer.Option(help="Axes of the components.")
    ] = "frame",
    residual: Annotated[
        Literal["momentum", "torque"],
        typer.Option(
            help="What external torques are computed from; the momentum needs no accelerations."
        ),
    ] = "momentum",
    method: Annotated[
        Literal["smoothed", "weighted", "inverse"],
        typer.Option(
            help="smoothed over time, with errors of the model estimated from the same log; "
            "weighted by the uncertainty of the model and the expected wrench, each sample by "
            "itself; inverse of the transposed Jacobian."
        ),
    ] = "smoothed",
    bandwidth: Annotated[
        float | None,
        typer.Option(
            help="Low-pass of external torques in Hz; if unset, the validation cutoff of the robot "
            "file or else the regression cut-off, or a tenth of the log's rate if that is less.",
            metavar="HZ",
        ),
    ] = None,
    force: Annotated[
        float,
        typer.Option(help="Expected size of each component of the force in N, 0.1 to 100 000."),
    ] = 30.0,
    lever: Annotated[
        float,
        typer.Option(
            help="Expected moment over expected force in m, up to 100; 0 for forces at the frame's "
            "origin, moments then count as zero.",
        ),
    ] = 0.1,
    duration: Annotated[
        float, typer.Option(help="Usual duration of a push in s, for smoothed.")
    ] = 1.0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Output folder for report.html, wrench.csv and wrench.json; none if unset.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Estimate force and moment on a frame along a log, without a force sensor.

    With 95 % intervals, finite in singular postures; names what is not observable.

    Example: steelyard wrench steelyard-ur10e shift.csv --frame tool0 -o wrench
    """
    from steelyard.cli.command import computed
    from steelyard.uses.wrench.external_wrench import external_wrench

    computed(
        lambda progress: external_wrench(
            model,
            log,
            frame,
            residual=residual,
            method=method,
            bandwidth=bandwidth,
            force=force,
            lever=lever,
            duration=duration,
            axes=axes,
            progress=progress,
        ),
        output,
        as_json,
        report="report.html",
        table="wrench.csv",
    )


@guarded
def health(
    model: ModelArgument,
    logs: Annotated[
        list[str], typer.Argument(help=f"In the order of time. {LOG_HELP}", metavar="LOG...")
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder for the report; none if unset."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Detect drift of friction, offsets and effort scales from logs of normal operation.

    Exit code 0: no drift. 1: something drifted, or may have (drift not proven). 2: error.

    Example: steelyard health steelyard-ur10e monday.csv tuesday.csv -o health
    """
    from steelyard.cli.command import computed
    from steelyard.uses.health.health import health as found_in

    found = computed(
        lambda progress: found_in(model, logs, progress=progress),
        output,
        as_json,
        report="report.html",
    )
    raise typer.Exit(int(bool(found.drifts or found.unproven)))


@guarded
def feedforward(
    model: ModelArgument,
    motion: Annotated[
        Path,
        typer.Argument(
            help="trajectory.json, or a table of time and positions; joints are matched by name.",
            metavar="MOTION",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Table to write, .csv or .parquet; must not exist."),
    ] = Path("feedforward.csv"),
    rate: Annotated[float, typer.Option(min=1.0, help="Rows per second.")] = 250.0,
    smoothing: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Speed in rad/s (m/s) over which the sign function of friction laws is smoothed; "
            "0 for the sign itself. A law with a smoothing in the robot file keeps it.",
        ),
    ] = 1e-3,
    as_logged: Annotated[
        bool,
        typer.Option(
            "--as-logged",
            help="Torques in Nm (N) as the robot file reads them from the log: multiplied by the "
            "estimated effort scales of the model, if it has any. Currents: divide by the robot "
            "file's gain.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Compute the joint torques of a model along a desired motion.

    The table has time, positions, velocities, accelerations and torques (q_NAME, dq_NAME, ddq_NAME,
    tau_NAME) in SI units. Friction is computed from the desired velocity: from the measured one
    it would chatter.

    Example: steelyard feedforward steelyard-ur10e motion/trajectory.json -o torques.csv
    """
    from rich.console import Console
    from rich.text import Text

    from steelyard.base.files import refuse_existing
    from steelyard.report.tables import light_table
    from steelyard.report.words import significant
    from steelyard.uses.control.feedforward_torques import feedforward as along

    refuse_existing(output)
    found = along(model, motion, rate=rate, smoothing=smoothing, as_logged=as_logged)
    found.write(output)
    if as_json:
        typer.echo(json.dumps({**found.to_dict(), "output": str(output)}, allow_nan=False))
        return
    console = Console()
    table = light_table(("joint", "RMS", "largest", "unit"), (0, 3))
    table.title, table.title_justify = Text("torque along the motion"), "left"
    for joint, rms, peak in zip(found.joints, found.rms, found.peaks, strict=True):
        cells = (joint.name, significant(rms), significant(peak), joint.effort_unit)
        table.add_row(*(Text(cell) for cell in cells))
    console.print(table)
    for warning in found.warnings:
        console.print(Text(f"! {warning}", style="bold red"))
    for note in found.notes:
        console.print(Text(f"note: {note}"))
    typer.echo(f"\n{len(found.motion)} rows  {output}")
