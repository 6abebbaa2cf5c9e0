"""The entry point: from its first line on, Ctrl-C ends the program cleanly."""

import sys

from steelyard.cli import interrupt


def main() -> None:
    """Run the command line; exit code 2 for what a user can mend, 130 after Ctrl-C."""
    try:
        interrupt.install()
        from steelyard.cli.app import app, expanded

        app(args=expanded(sys.argv[1:]))
    except BaseException:
        if interrupt.asked():
            interrupt.leave()
        interrupt.ignore()
        raise
