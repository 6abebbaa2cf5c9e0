"""Run a command and press Ctrl-C when it enters a function of steelyard for the first time.

Usage: interrupted_at.py FUNCTION LIST ARGUMENT... with the function as `module.qualname`, and the
file that gets the functions entered, in order, one a line.
"""

import os
import signal
import sys
from pathlib import Path
from types import CodeType, FrameType

from steelyard.cli.main import main

PACKAGE = f"{os.sep}steelyard{os.sep}"
QUIET = ("interrupt.", "main.main")
"""Functions that take Ctrl-C over or answer it."""


def press_at(wanted: str, seen: dict[str, None]) -> None:
    """Watch the functions that are entered, and press Ctrl-C at the one wanted."""
    known: set[CodeType] = set()

    def watch(frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if code in known:
            return
        known.add(code)
        name = f"{Path(code.co_filename).stem}.{code.co_qualname}"
        if PACKAGE not in code.co_filename or name.startswith(QUIET) or name in seen:
            return
        seen[name] = None
        if name == wanted:
            os.kill(os.getpid(), signal.SIGINT)

    sys.settrace(watch)


if __name__ == "__main__":
    wanted, report, sys.argv[1:] = sys.argv[1], Path(sys.argv[2]), sys.argv[3:]
    seen: dict[str, None] = {}
    press_at(wanted, seen)
    try:
        main()
    finally:
        sys.settrace(None)
        report.write_text("\n".join(seen))
