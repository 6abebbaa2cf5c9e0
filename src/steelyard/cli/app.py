"""The commands together."""

from typing import Annotated

import typer

from steelyard.cli import (
    app_command,
    doctor_command,
    fleet_command,
    init_command,
    log_commands,
    watch_command,
)
from steelyard.cli import identify_and_use_commands as use
from steelyard.cli import motion_and_simulation_commands as motion
from steelyard.cli import reduce_and_export_commands as model
from steelyard.cli.commands_from_functions import DerivedCommand

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
    init_command.init,
    log_commands.check,
    motion.excite,
    use.identify,
    use.validate,
    use.compare,
    use.compare_models,
    model.reduce,
    use.payload,
    use.contact,
    use.wrench,
    use.health,
    watch_command.watch,
    fleet_command.fleet,
    model.export,
    use.feedforward,
    motion.simulate,
    motion.track,
    motion.replay,
    motion.demo,
    app_command.app,
    doctor_command.doctor,
):
    app.command(cls=DerivedCommand)(command)

app.add_typer(log_commands.log)


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
