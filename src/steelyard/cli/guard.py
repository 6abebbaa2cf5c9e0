"""Around every command: errors become one clear message, Ctrl-C leaves nothing half done."""

import functools
from collections.abc import Callable
from typing import ParamSpec

import typer

from steelyard.errors import SteelyardError

Arguments = ParamSpec("Arguments")

USAGE, INTERRUPTED = 2, 130


def guarded(command: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """Exit code 2 with a message for what a user can mend, 130 after Ctrl-C."""

    @functools.wraps(command)
    def run(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except SteelyardError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(USAGE) from None
        except KeyboardInterrupt:
            typer.echo("stopped: nothing was written", err=True)
            raise typer.Exit(INTERRUPTED) from None

    return run
