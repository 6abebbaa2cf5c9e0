"""Ctrl-C: asked for once, it is never lost, and leaves no half-written file.

An interrupt can arrive anywhere: inside a native library that turns it into another error, or
inside a callback that swallows it. So the request is noted, and asked for again at every event of
progress and before results take their place; from then on it comes too late. It is no
`KeyboardInterrupt`: libraries answer that in ways of their own, and Python, once it has passed
through `exec`, ends with a signal whatever the program does.
"""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

INTERRUPTED = 130


class Interrupted(BaseException):
    """Ctrl-C was pressed."""


@dataclass
class _State:
    installed: bool = False
    requests: int = 0
    quiet: bool = False
    kept: str = ""


_state = _State()


def install() -> None:
    """Take over Ctrl-C; for the program itself, not for whoever imports it."""
    _state.installed = True
    signal.signal(signal.SIGINT, _note)

    show = sys.unraisablehook

    def hook(problem: "sys.UnraisableHookArgs") -> None:
        if not issubclass(problem.exc_type, Interrupted):
            show(problem)

    sys.unraisablehook = hook


def stop_requested() -> bool:
    """Whether Ctrl-C has been pressed."""
    return _state.requests > 0


def check() -> None:
    """Stop here, with `Interrupted`, if Ctrl-C has been pressed."""
    if stop_requested():
        raise Interrupted


@contextmanager
def quietly() -> Iterator[None]:
    """Inside, Ctrl-C is only noted, for work that looks at `stop_requested` and keeps what it has.

    Pressed again, or after it was `answered`, it stops the program as elsewhere.
    """
    _state.quiet = True
    try:
        yield
    finally:
        _state.quiet = False


def answered() -> None:
    """What is done is kept: one request has its answer, and only another one stops what follows."""
    _state.requests, _state.quiet = max(_state.requests - 1, 0), False


def finished(what: str) -> None:
    """A part of the results is in its place and stays there if Ctrl-C stops what follows."""
    _state.kept = f"{what} is written, nothing else"


def kept(words: str) -> None:
    """What is kept if Ctrl-C stops what follows."""
    _state.kept = words


def too_late() -> None:
    """The last chance to stop: after this, the results take their place and Ctrl-C does nothing."""
    if _state.installed:
        ignore()
        check()


def ignore() -> None:
    """From here on, Ctrl-C does nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def leave() -> None:
    """Clean up, say so, and end the program.

    Nothing may be imported here: the interrupt may have torn an import that cannot begin anew.

    Raises:
        SystemExit: With 130.
    """
    ignore()
    files = sys.modules.get("steelyard.base.files")
    if files is not None and hasattr(files, "remove_unfinished"):
        files.remove_unfinished()
    print(f"stopped: {_state.kept or 'nothing was written'}", file=sys.stderr)
    raise SystemExit(INTERRUPTED) from None


def _note(number: int, frame: FrameType | None) -> None:
    _state.requests += 1
    if _state.requests > 1 or not _state.quiet:
        raise Interrupted
