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
"""Told of every event; the work stops if it answers `False`."""


class Stopped(Exception):
    """The watcher of a long piece of work requested a stop."""


def silent(event: Event) -> bool:
    """A watcher that says nothing and never stops the work."""
    return True


def tell(progress: Progress, phase: str, done: float, total: float, note: str = "") -> None:
    """Report to `progress`.

    Raises:
        Stopped: The answer was to stop.
    """
    answer: bool | None = progress(Event(phase, done, total, note))
    if answer is not None and not answer:
        raise Stopped(f"stopped during {phase}, {done:.3g} of {total:.3g} done")
