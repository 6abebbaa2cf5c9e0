"""Around every command: errors become one clear message."""

import functools
from collections.abc import Callable
from typing import ParamSpec

import typer

from steelyard.cli import interrupt
from steelyard.cli.argument_order import refuse_wrong_order
from steelyard.errors import SteelyardError

Arguments = ParamSpec("Arguments")

USAGE = 2


def guarded(command: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """Exit code 2 with a message for what a user can correct."""

    @functools.wraps(command)
    def run(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        try:
            refuse_wrong_order(command, kwargs)
            command(*args, **kwargs)
        except SteelyardError as error:
            interrupt.check()
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(USAGE) from None

    return run
