"""`steelyard watch`: external torque, contacts and payload on samples as they arrive."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from steelyard.base.errors import DataError, visible
from steelyard.cli import interrupt
from steelyard.cli.commands_from_functions import from_function
from steelyard.cli.shared_by_commands import optional_folder, progress_bar

if TYPE_CHECKING:
    from steelyard.base.arrays import Array
    from steelyard.uses.watch.watch import WatchStart
    from steelyard.uses.watch.watcher_and_events import StreamEvent

POLL = 0.01  # pause while there is nothing new [s]
REDRAW_PERIOD = 0.1  # least time between two states of the terminal's line [s]


@from_function(
    "steelyard.uses.watch.watch:start_watch",
    rate={"min": 1e-9},
    bandwidth={"min": 1e-3},
    every={"min": 0.0},
    forget={"min": 1.0},
    source={"name": "--from", "metavar": "SOURCE"},
    timeout={"min": 0.0, "metavar": "SECONDS"},
)
def watch(
    call: "partial[WatchStart]",
    source: str,
    timeout: float | None = None,
    output: Path | None = None,
    as_json: bool = False,
) -> None:
    """Report external torque, contacts and payload on samples as they arrive.

    Events are printed as they come, one line each; with --json one JSON object a line.

    Options:
        source: File that is being written (CSV, JSON lines, MCAP), or - for standard input (CSV,
            JSON lines), with the columns of the robot file.
        timeout: End if nothing is appended to the file for this time; 0 reads what is there. If
            unset, only Ctrl-C ends it; standard input ends with its writer.
        output: Output folder for events.csv and estimates.csv, written as they come; must not
            exist.

    Example: steelyard watch steelyard-ur10e --from today.csv --frame tool0 -o today
    """
    from steelyard.logs.growing_logs import STANDARD_INPUT, rows_of
    from steelyard.uses.watch.watch import (
        StreamFiles,
        event_line,
        record_of,
        state_line,
        watch_rows,
    )
    from steelyard.uses.watch.watcher_and_events import StreamEstimate

    if source == STANDARD_INPUT and timeout is not None:
        wrong = "standard input ends when its writer closes it, not after some time"
        fix = "leave it out, or give a file with --from"
        raise DataError(wrong, where="--timeout", fix=fix)
    folder = optional_folder(output)
    with progress_bar() as progress:
        begun = call(progress=progress)
    frame, every = call.keywords["frame"], call.keywords["every"]
    watcher, joints = begun.watcher, begun.model.robot.joint_names
    terminal = _Terminal()
    arrival = _Arrival(timeout, lambda: terminal.draw(state_line(watcher)))
    arriving = rows_of(source, watcher.samples.columns, arrival.waiting, _read)

    def reported(event: "StreamEvent") -> None:
        if every is not None or not isinstance(event, StreamEstimate):
            terminal.say(json.dumps(record_of(event)) if as_json else event_line(event))

    with ExitStack() as stack:
        files = None
        if folder is not None:
            files = stack.enter_context(StreamFiles.opened(folder, joints, frame is not None))
        terminal.say(*([json.dumps(begun.to_dict())] if as_json else begun.notes))
        stack.enter_context(interrupt.quietly())
        try:
            rows, stopped = arrival.noted(arriving), interrupt.stop_requested
            watch_rows(watcher, rows, reported, files, source=source, stopped=stopped)
        finally:
            if watcher.started:
                terminal.say(*_summary(begun, as_json))
                if folder is not None and not as_json:
                    terminal.say(f"written  {folder}")
            terminal.clear()
        if watcher.observer.steps:
            interrupt.answered()


def _summary(begun: "WatchStart", as_json: bool) -> "Iterable[str]":
    from steelyard.uses.watch.watch import summary_lines

    found, robot = begun.watcher.summary, begun.model.robot
    if not as_json:
        return summary_lines(found, robot.joint_names, robot.effort_units)
    least = found["least_mass_kg"]
    return [json.dumps({**found, "least_mass_kg": None if least == inf else least})]


class _Arrival:
    """Waits for rows; without any for the time `timeout` [s], the stream ends."""

    def __init__(self, timeout: float | None, draw: Callable[[], None]) -> None:
        self._timeout, self._draw = timeout, draw
        self._latest = time.monotonic()

    def noted(self, arriving: "Iterable[Array]") -> "Iterator[Array]":
        """The same rows; the time at which they come is noted."""
        for rows in arriving:
            self._latest = time.monotonic()
            self._draw()
            yield rows

    def waiting(self) -> bool:
        """Pause; whether to go on."""
        late = self._timeout is not None and time.monotonic() - self._latest >= self._timeout
        if late or interrupt.stop_requested():
            return False
        self._draw()
        time.sleep(POLL)
        return True


class _Terminal:
    """Lines, and on a terminal's standard error one that is written again and again."""

    def __init__(self) -> None:
        self._on, self._drawn = sys.stderr.isatty(), -1.0

    def draw(self, text: str) -> None:
        """Replace the line, now and then."""
        now = time.monotonic()
        if self._on and now - self._drawn >= REDRAW_PERIOD:
            self._drawn = now
            sys.stderr.write(f"\r\x1b[2K{text}")
            sys.stderr.flush()

    def clear(self) -> None:
        if self._on and self._drawn >= 0.0:
            sys.stderr.write("\r\x1b[2K")
            sys.stderr.flush()

    def say(self, *texts: str) -> None:
        self.clear()
        for text in texts:
            typer.echo(visible(text, "\n"))


def _read() -> bytes:
    """What standard input has, without a buffer that a thread could hold at the end."""
    from steelyard.logs.growing_logs import PIECE_BYTES

    try:
        number = sys.stdin.fileno()
    except OSError:
        return bytes(sys.stdin.buffer.read(PIECE_BYTES))
    return os.read(number, PIECE_BYTES)
