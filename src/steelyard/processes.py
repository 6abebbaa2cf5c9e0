"""Processes that run a module of the package."""

import sys

_RUN = """
import sys
sys.path = [folder for folder in sys.path if folder]
import runpy
runpy.run_module({!r}, run_name="__main__", alter_sys=True)
"""


def module_command(module: str) -> list[str]:
    """The command that runs a module, with no module of the current folder in its place.

    The same as `python -P -m module`, which Python 3.10 does not have.
    """
    return [sys.executable, "-c", _RUN.format(module)]
