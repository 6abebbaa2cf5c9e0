"""Changes of a payload as samples arrive: `payload --when` on the latest samples, again and again.

Every `PERIOD` the events of the last `SPAN` are sought. One that is found twice in a row, at about
the same time and of the same kind, is an event of the stream: it is reported once.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from steelyard.application.payload_events import PayloadEvent, PayloadEvents
from steelyard.arrays import Array
from steelyard.errors import SteelyardError

PERIOD = 2.0
"""Time between two searches [s]."""

SPAN = 40.0
"""Latest samples that are searched [s]."""

FIRST = 10.0
"""Time of samples before the first search [s]."""

SAME = 3.0
"""Difference of the times of one event in two searches, at most [s]."""

Detect = Callable[[Array], PayloadEvents]
"""Finds the events of consecutive rows as logged; times count from the first one."""


@dataclass(frozen=True, eq=False)
class PayloadState:
    """What is carried at the end of a search.

    Attributes:
        mass: Its mass, zero if nothing is carried [kg].
        half_width: Half-width of the 95 % interval of the mass; NaN if nothing is carried.
        least_mass: Smallest change of the mass that would be seen, infinite if none would [kg].
    """

    mass: float
    half_width: float
    least_mass: float


class PayloadStream:
    """Finds changes of a payload sample by sample.

    Attributes:
        state: What is carried; `None` before the first search that succeeds.
        failed: Why the last search failed; empty if it did not.
        searches: Searches that succeeded.
    """

    def __init__(self, detect: Detect) -> None:
        """Begin.

        Args:
            detect: The search.
        """
        self.state: PayloadState | None = None
        self.failed = ""
        self.searches = 0
        self._detect = detect
        self._kept: deque[tuple[float, Array]] = deque()
        self._due = FIRST
        self._candidates: list[PayloadEvent] = []
        self._reported: list[PayloadEvent] = []
        self._least: list[float] = []

    @property
    def least_mass(self) -> float | None:
        """Change of the mass that half of the searches would have seen [kg]; `None` without any."""
        return float(np.quantile(self._least, 0.5, method="higher")) if self._least else None

    def step(self, t: float, row: Array) -> tuple[PayloadEvent, ...]:
        """Take the next sample; the events that are certain with it.

        Args:
            t: Time from the first sample [s].
            row: As logged, shape `(columns,)`.
        """
        self._kept.append((t, row))
        if t < self._due:
            return ()
        self._due = t + PERIOD
        while self._kept[0][0] < t - SPAN:
            self._kept.popleft()
        try:
            found = self._detect(np.array([one for _, one in self._kept]))
        except SteelyardError as error:
            self.failed, self._candidates = error.wrong, []
            return ()
        self.failed, self.searches = "", self.searches + 1
        start = self._kept[0][0]
        self.state = _state(found, t - start)
        self._least.append(found.least_mass)
        events = [_later(event, start) for event in found.events]
        certain = [e for e in events if _known(e, self._candidates)]
        certain = [e for e in certain if not _known(e, self._reported)]
        self._candidates = events
        self._reported = [*self._reported, *certain][-100:]
        return tuple(certain)


def _known(event: PayloadEvent, others: list[PayloadEvent]) -> bool:
    return any(
        other.kind == event.kind and other.earliest - SAME <= event.time <= other.latest + SAME
        for other in others
    )


def _later(event: PayloadEvent, start: float) -> PayloadEvent:
    times = {name: getattr(event, name) + start for name in ("time", "earliest", "latest")}
    return replace(event, **times)


def _state(found: PayloadEvents, duration: float) -> PayloadState:
    """What is carried at the end of a stretch."""
    last = [one for one in found.carried if one.stop >= duration - SAME]
    if not last:
        return PayloadState(0.0, np.nan, found.least_mass)
    payload = last[-1].payload
    return PayloadState(payload.mass, float(payload.half_width[0]), found.least_mass)
