"""Changes of a payload on rows as they arrive.

Every `SEARCH_PERIOD` changes are sought in the last `SEARCHED_SPAN`. One that is found twice in a
row, at about the same time and of the same kind, is an event of the stream: it is reported once.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvent, PayloadEvents

SEARCH_PERIOD = 2.0  # time between two searches [s]
SEARCHED_SPAN = 40.0  # latest samples that are searched [s]
FIRST_SEARCH = 10.0  # time of samples before the first search [s]
SAME_EVENT_TIME = 3.0  # difference of the times of one event in two searches, at most [s]

Detect = Callable[[Array], PayloadEvents]
"""Finds the events of consecutive rows as logged; times count from the first one."""


@dataclass(frozen=True, eq=False)
class PayloadState:
    """What is carried at the end of a search."""

    mass: float  # its mass, zero if nothing is carried [kg]
    half_width: float
    least_mass: float  # smallest change of the mass that would be seen, infinite if none would [kg]


class PayloadStream:
    """Finds changes of a payload sample by sample.

    Attributes:
        state: What is carried; `None` before the first search that succeeds.
        failed: Why the last search failed; empty if it did not.
    """

    def __init__(self, detect: Detect) -> None:
        self.state: PayloadState | None = None
        self.failed = ""
        self.searches = 0
        self._detect = detect
        self._kept: deque[tuple[float, Array]] = deque()
        self._due = FIRST_SEARCH
        self._candidates: list[PayloadEvent] = []
        self._reported: list[PayloadEvent] = []
        self._least: list[float] = []

    @property
    def least_mass(self) -> float | None:
        """Change of the mass that half of the searches would have seen [kg]; `None` without any."""
        return float(np.quantile(self._least, 0.5, method="higher")) if self._least else None

    def step(self, t: float, row: Array) -> tuple[PayloadEvent, ...]:
        """Take the next sample, a row as logged; the events that are certain with it.

        Its time counts from the first sample [s].
        """
        self._kept.append((t, row))
        if t < self._due:
            return ()
        self._due = t + SEARCH_PERIOD
        while self._kept[0][0] < t - SEARCHED_SPAN:
            self._kept.popleft()
        try:
            found = self._detect(np.array([one for _, one in self._kept]))
        except SteelyardError as error:
            self.failed, self._candidates = error.wrong, []
            return ()
        self.failed, self.searches = "", self.searches + 1
        start = self._kept[0][0]
        last = [one for one in found.carried if one.stop >= t - start - SAME_EVENT_TIME]
        mass, half_width = 0.0, np.nan
        if last:
            mass, half_width = last[-1].payload.mass, float(last[-1].payload.half_width[0])
        self.state = PayloadState(mass, half_width, found.least_mass)
        self._least.append(found.least_mass)
        events = [
            replace(e, time=e.time + start, earliest=e.earliest + start, latest=e.latest + start)
            for e in found.events
        ]
        certain = [
            e for e in events if _known(e, self._candidates) and not _known(e, self._reported)
        ]
        self._candidates = events
        self._reported = [*self._reported, *certain][-100:]
        return tuple(certain)


def _known(event: PayloadEvent, others: list[PayloadEvent]) -> bool:
    return any(
        other.kind == event.kind
        and other.earliest - SAME_EVENT_TIME <= event.time <= other.latest + SAME_EVENT_TIME
        for other in others
    )
