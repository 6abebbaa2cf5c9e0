"""`steelyard app`: the guided app in a browser."""

import os
import signal
from pathlib import Path
from threading import Event
from types import FrameType
from typing import Annotated

import typer

from steelyard.cli import interrupt
from steelyard.cli.commands_from_functions import from_function


@from_function(port={"min": 0, "max": 65535, "metavar": "N"})
def app(
    folder: Annotated[Path, typer.Argument(help="The workspace; made if it is missing.")] = Path(),
    port: int = 0,
    no_browser: bool = False,
) -> None:
    """Guide from robot and logs to a model in the browser, on a folder of plain files.

    Its robot file, logs, models and reports are those of the other commands, which may be used on
    them at any time. The address works on this machine alone, and its token once. Ctrl-C ends it.

    Options:
        port: Port of the address; a free one if 0.
        no_browser: Print the address only.

    Example: steelyard app ur10e
    """
    from steelyard.app.server import serve

    stop = Event()

    def asked(number: int, frame: FrameType | None) -> None:
        if stop.is_set():  # again: at once, which loses nothing that is finished
            os._exit(interrupt.INTERRUPTED)
        stop.set()

    signal.signal(signal.SIGINT, asked)
    serve(folder, port, not no_browser, typer.echo, stop.is_set)
