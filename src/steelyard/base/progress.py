"""Long work: events of its progress, requests to stop it, and processes that do it."""

import sys
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """How far a phase of long work has come, in the unit of `total`, and what is found so far."""

    phase: str
    done: float
    total: float
    note: str = ""


Progress = Callable[[Event], bool]  # called with every event; the work stops if it returns `False`


class Stopped(Exception):
    """The callback of a long computation requested a stop."""


def silent(event: Event) -> bool:
    """A callback that does nothing and never stops the work."""
    return True


def report_progress(
    progress: Progress, phase: str, done: float, total: float, note: str = ""
) -> None:
    """Call `progress` with an event; it is `Stopped` if that returned `False`."""
    answer: bool | None = progress(Event(phase, done, total, note))
    if answer is not None and not answer:
        raise Stopped(f"stopped during {phase}, {done:.3g} of {total:.3g} done")


_RUN_MODULE = """
import sys
sys.path = [folder for folder in sys.path if folder]
import runpy
runpy.run_module({!r}, run_name="__main__", alter_sys=True)
"""


def module_command(module: str) -> list[str]:
    """`python -P -m module`, which Python 3.10 lacks: no module of the current folder counts."""
    return [sys.executable, "-c", _RUN_MODULE.format(module)]


DESIGN_BUDGET_S = 10.0  # time limit of the search for an excitation motion, if none is given [s]
