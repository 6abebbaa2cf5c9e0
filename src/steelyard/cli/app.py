"""The commands together."""

import re
from itertools import pairwise
from typing import Annotated

import typer

from steelyard.cli.derived_command import DerivedCommand
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
from steelyard.cli.model_commands import export, reduce
from steelyard.cli.motion_and_simulation_commands import demo, excite, replay, simulate, track
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

MANY_VALUED_OPTIONS = (
    "--validate",
    "--format",
    "--loaded",
    "--unloaded",
    "--columns",
    "--beside",
    "--calibrate",
    "--estimators",
    "--on",
    "--keep",
    "--drop",
)
"""Options that take all that follows up to the next option."""


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


def expanded(arguments: list[str]) -> list[str]:
    """Repeat an option that is followed by several values: `--validate A B` for each of them.

    One without a value goes to the end, where the parser misses it. `--fix` has a value if a robot
    file follows it that is not the command's first argument. `NAME:=VALUE` belongs to
    the xacro file before it.
    """
    arguments = _with_xacro(arguments)
    result: list[str] = []
    bare: list[str] = []
    current: str | None = None
    named = False
    for argument, following in pairwise([*arguments, "-"]):
        if argument.startswith("-"):
            current = argument if argument in MANY_VALUED_OPTIONS else None
            if argument == "--fix" and not (named and following.endswith(".toml")):
                result.append("--fix=")
            elif current is None:
                result.append(argument)
            elif following.startswith("-"):
                bare.append(current)
        elif current is not None:
            result += [current, argument]
        else:
            result.append(argument)
            named = named or len(result) > 1
    return result + bare


def _with_xacro(arguments: list[str]) -> list[str]:
    """Arguments of a xacro file, joined to it, or to the word before them if there is none."""
    words: list[str] = []
    for argument in arguments:
        if words and re.match(r"[A-Za-z_]\w*:=", argument):
            files = [n for n, word in enumerate(words) if ".xacro" in word]
            words[files[-1] if files else -1] += f" {argument}"
        else:
            words.append(argument)
    return words
