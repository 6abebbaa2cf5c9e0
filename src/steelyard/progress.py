"""Events of progress of long work, and requests to stop it."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """How far a phase of long work has come.

    Attributes:
        phase: What is being done, in a few words.
        done: Work done so far, in the unit of `total`.
        total: All the work of this phase.
        note: What has been found so far, in a few words.
    """

    phase: str
    done: float
    total: float
    note: str = ""


Progress = Callable[[Event], bool]
"""Called with every event; the work stops if it returns `False`."""


class Stopped(Exception):
    """The callback of a long computation requested a stop."""


def silent(event: Event) -> bool:
    """A callback that does nothing and never stops the work."""
    return True


def report_progress(
    progress: Progress, phase: str, done: float, total: float, note: str = ""
) -> None:
    """Call `progress` with an event.

    Raises:
        Stopped: It returned `False`.
    """
    answer: bool | None = progress(Event(phase, done, total, note))
    if answer is not None and not answer:
        raise Stopped(f"stopped during {phase}, {done:.3g} of {total:.3g} done")
