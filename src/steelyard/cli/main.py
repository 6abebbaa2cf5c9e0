"""The entry point: from its first line on, Ctrl-C ends the program cleanly."""

import io
import os
import sys

from steelyard.cli import interrupt

# matrices are small here: threads of their own only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """Run the command line; exit code 2 for what a user can correct, 130 after Ctrl-C."""
    try:
        interrupt.install()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # an encoding that lacks a letter
                stream.reconfigure(errors="backslashreplace")
        from steelyard.cli.app import app
        from steelyard.cli.options_with_several_values import expanded

        app(args=expanded(sys.argv[1:]))
    except BaseException:
        if interrupt.stop_requested():
            interrupt.leave()
        interrupt.ignore()
        raise
