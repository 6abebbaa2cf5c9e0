"""The commands together."""

from typing import Annotated

import typer

from steelyard.cli.commands_from_functions import DerivedCommand
from steelyard.cli.doctor_command import doctor
from steelyard.cli.identify_and_use_commands import (
    compare,
    compare_models,
    contact,
    feedforward,
    health,
    identify,
    payload,
    validate,
    wrench,
)
from steelyard.cli.init_command import init
from steelyard.cli.log_commands import check, log
from steelyard.cli.motion_and_simulation_commands import demo, excite, replay, simulate, track
from steelyard.cli.reduce_and_export_commands import export, reduce
from steelyard.cli.watch_command import watch

app = typer.Typer(
    name="steelyard",
    help="Identify the dynamic model of a robot from logs of joint positions and torques. Input: "
    "robot file and logs. Output: report and model.",
    epilog="First try: steelyard demo",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (
    init,
    check,
    excite,
    identify,
    validate,
    compare,
    compare_models,
    reduce,
    payload,
    contact,
    wrench,
    health,
    watch,
    export,
    feedforward,
    simulate,
    track,
    replay,
    demo,
    doctor,
):
    app.command(cls=DerivedCommand)(command)

app.add_typer(log)


def _version(wanted: bool) -> None:
    if wanted:
        from steelyard import __version__

        typer.echo(f"steelyard {__version__}")
        raise typer.Exit


@app.callback()
def callback(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Options before the command."""
