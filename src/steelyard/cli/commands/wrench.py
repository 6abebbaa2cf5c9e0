"""`steelyard wrench`: the external wrench along a log, from efforts that are not explained."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, Json, ModelArgument


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
    from steelyard.cli.show import computed
    from steelyard.identification.uses.wrench import external_wrench

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
