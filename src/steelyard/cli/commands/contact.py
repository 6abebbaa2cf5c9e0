"""`steelyard contact`: contacts in a log, from the efforts that the model does not explain."""

from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import LOG_HELP, AlarmRate, Json, ModelArgument


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
    from steelyard.cli.show import computed
    from steelyard.identification.uses.contact import contact as found_in

    computed(
        lambda progress: found_in(
            model, log, calibrate=calibrate or (), rate=rate, progress=progress
        ),
        output,
        as_json,
        report="report.html",
    )
