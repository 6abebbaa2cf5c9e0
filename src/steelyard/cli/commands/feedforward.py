"""`steelyard feedforward`: torques of an identified model along a motion."""

import json
from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json, ModelArgument


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

    from steelyard.files import refuse_existing
    from steelyard.identification.uses.feedforward import feedforward as along
    from steelyard.report.sections.tables import light_table
    from steelyard.report.text.words import significant

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
