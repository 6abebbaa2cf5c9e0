"""Contacts and changes of the payload, as the samples of a stream arrive.

Every `PERIOD` the events of the last `SPAN` are sought. One that is found twice in a row, at about
the same time and of the same kind, is an event of the stream: it is reported once.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.robot.robot import Robot
from steelyard.uses.contact.contact_events import (
    LEAST_TIME_APART,
    RELEASE,
    ContactEvent,
    JointLoad,
    links_carried_by,
    place_of,
)
from steelyard.uses.payload.payload_events import PayloadEvent, PayloadEvents

LEVEL, CHANGE = 0, 1
"""Tests of a residual: its size, and its change at rest."""


@dataclass(frozen=True)
class ContactStart:
    """A residual exceeds its threshold, and none did just before.

    Attributes:
        time: When [s].
        known: When that is known [s]: a change at rest is decided a little later.
        joint: What the joint with the largest ratio shows.
        links: Links that the contact may be on.
    """

    time: float
    known: float
    joint: JointLoad
    links: tuple[str, ...]

    @property
    def place(self) -> str:
        """Where the contact is, for people to read."""
        return place_of(self.links)


@dataclass(frozen=True, eq=False)
class ContactTest:
    """A test of all joints.

    Attributes:
        time: Of the sample that is tested [s].
        signal: What is compared with thresholds, shape `(n,)` [Nm; N]; NaN where nothing is.
        limits: Thresholds, likewise; NaN of a joint without.
    """

    time: float
    signal: Array
    limits: Array


class ContactStream:
    """Finds contacts sample by sample."""

    def __init__(self, robot: Robot, sigma: Array, lasting: float = 0.0) -> None:
        """Begin.

        Args:
            robot: The robot.
            sigma: Standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
            lasting: Time for which a residual must exceed its threshold, sample after sample, to
                be contact [s].
        """
        self._robot, self._sigma, self._lasting = robot, sigma, lasting
        self._released = np.full((2, robot.n), np.nan)
        self._since = np.full((2, robot.n), np.nan)
        self._loads: dict[int, JointLoad] = {}
        self._start = self._end = self._known = -np.inf

    @property
    def active(self) -> bool:
        """Whether there is a contact now."""
        return bool(self._loads)

    def step(
        self, t: float, level: ContactTest, change: ContactTest, gap: bool
    ) -> Iterator[ContactStart | ContactEvent]:
        """Take the next sample.

        Args:
            t: Time [s].
            level: The residual, measured minus predicted effort, at this sample.
            change: Its change at rest, at the sample that is decided now.
            gap: Whether samples are missing before this one.
        """
        tests = level, change
        size = np.abs([test.signal for test in tests])
        limits = np.array([test.limits for test in tests])
        held = (size >= self._released) & (not gap)
        times = np.array([test.time for test in tests])
        exceeds = self._lasts(size > limits, times, gap)
        if self._loads and not held.any() and t - self._end > LEAST_TIME_APART:
            yield self.ended()
        self._released = np.where(held, self._released, np.where(exceeds, RELEASE * limits, np.nan))
        touched = held | exceeds
        if not touched.any():
            return
        begins = not self._loads
        for k, j in np.argwhere(touched):
            ratio = float(size[k, j] / limits[k, j])
            self._add(int(j), float(tests[k].signal[j]), ratio, bool(k == CHANGE))
        latest = float(times[touched.any(axis=1)].max())
        self._end = latest if begins else max(self._end, latest)
        if begins:
            self._start, self._known = float(self._since[touched].min()), t
            event = self._event()
            yield ContactStart(event.start, t, event.joints[0], event.links)

    def _lasts(self, exceeds: NDArray[np.bool_], times: Array, gap: bool) -> NDArray[np.bool_]:
        """What exceeds its threshold for long enough, shape `(2, n)` like `exceeds`."""
        begins = exceeds & (np.isnan(self._since) | gap)
        self._since = np.where(begins, times[:, None], np.where(exceeds, self._since, np.nan))
        return np.asarray(exceeds & (times[:, None] - self._since >= self._lasting))

    def ended(self) -> ContactEvent:
        """The contact that ends, now or with the stream; there must be one."""
        event = self._event()
        self._loads.clear()
        self._released[:] = np.nan
        return event

    def _add(self, j: int, signal: float, ratio: float, change: bool) -> None:
        known = self._loads.get(j)
        if known is not None and known.ratio >= ratio:
            return
        coordinate, sigmas = self._robot.coordinates[j], abs(signal) / float(self._sigma[j])
        self._loads[j] = JointLoad(
            coordinate.name, coordinate.effort_unit, signal, sigmas, ratio, change
        )

    def _event(self) -> ContactEvent:
        links = links_carried_by(self._robot, list(self._loads))
        joints = sorted(self._loads.values(), key=lambda load: -load.ratio)
        return ContactEvent(self._start, self._end, self._known, tuple(joints), links)


SEARCH_PERIOD = 2.0
"""Time between two searches [s]."""

SEARCHED_SPAN = 40.0
"""Latest samples that are searched [s]."""

FIRST_SEARCH = 10.0
"""Time of samples before the first search [s]."""

SAME_EVENT_TIME = 3.0
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
    """

    def __init__(self, detect: Detect) -> None:
        """Begin."""
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
        """Take the next sample; the events that are certain with it.

        Args:
            t: Time from the first sample [s].
            row: As logged, shape `(columns,)`.
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
        other.kind == event.kind
        and other.earliest - SAME_EVENT_TIME <= event.time <= other.latest + SAME_EVENT_TIME
        for other in others
    )


def _later(event: PayloadEvent, start: float) -> PayloadEvent:
    times = {name: getattr(event, name) + start for name in ("time", "earliest", "latest")}
    return replace(event, **times)


def _state(found: PayloadEvents, duration: float) -> PayloadState:
    """What is carried at the end of a stretch."""
    last = [one for one in found.carried if one.stop >= duration - SAME_EVENT_TIME]
    if not last:
        return PayloadState(0.0, np.nan, found.least_mass)
    payload = last[-1].payload
    return PayloadState(payload.mass, float(payload.half_width[0]), found.least_mass)
