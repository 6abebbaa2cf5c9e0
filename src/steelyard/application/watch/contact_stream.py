"""Contacts as their samples arrive: the events of `contacts_in`, each at its start and its end."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.application.contact import (
    APART,
    RELEASE,
    ContactEvent,
    JointLoad,
    links_carried_by,
    place_of,
)
from steelyard.arrays import Array
from steelyard.robot.robot import Robot

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
        if self._loads and not held.any() and t - self._end > APART:
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
