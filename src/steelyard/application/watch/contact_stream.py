"""Contacts as their samples arrive: the events of `contacts_in`, each at its start and its end."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

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


@dataclass(frozen=True)
class ContactStart:
    """A residual exceeds its threshold, and none did just before.

    Attributes:
        time: When [s].
        joint: What the joint with the largest ratio shows.
        links: Links that the contact may be on.
    """

    time: float
    joint: JointLoad
    links: tuple[str, ...]

    @property
    def place(self) -> str:
        """Where the contact is, for people to read."""
        return place_of(self.links)


class ContactStream:
    """Finds contacts sample by sample."""

    def __init__(self, robot: Robot, sigma: Array) -> None:
        """Begin.

        Args:
            robot: The robot.
            sigma: Standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
        """
        self._robot, self._sigma = robot, sigma
        self._released = np.full(robot.n, np.nan)
        self._loads: dict[int, JointLoad] = {}
        self._start = self._end = -np.inf

    @property
    def active(self) -> bool:
        """Whether there is a contact now."""
        return bool(self._loads)

    def step(
        self, t: float, residual: Array, limits: Array, gap: bool
    ) -> Iterator[ContactStart | ContactEvent]:
        """Take the next sample.

        Args:
            t: Time [s].
            residual: Measured minus predicted effort, shape `(n,)` [Nm; N].
            limits: Thresholds, likewise; NaN of a joint without.
            gap: Whether samples are missing before this one.
        """
        size = np.abs(residual)
        held = ~np.isnan(self._released) & ~(size < self._released) & (not gap)
        exceeds = size > limits
        touched = held | exceeds
        if self._loads and not held.any() and t - self._end > APART:
            yield self.ended()
        self._released = np.where(held, self._released, np.where(exceeds, RELEASE * limits, np.nan))
        if not touched.any():
            return
        begins = not self._loads
        for j in np.flatnonzero(touched):
            self._add(int(j), float(residual[j]), float(size[j] / limits[j]))
        self._end = t
        if begins:
            self._start = t
            event = self._event()
            yield ContactStart(t, event.joints[0], event.links)

    def ended(self) -> ContactEvent:
        """The contact that ends, now or with the stream; there must be one."""
        event = self._event()
        self._loads.clear()
        self._released[:] = np.nan
        return event

    def _add(self, j: int, residual: float, ratio: float) -> None:
        coordinate, known = self._robot.coordinates[j], self._loads.get(j)
        peak = residual
        if known is not None:
            peak = max(residual, known.peak, key=abs)
            ratio = max(ratio, known.ratio)
        sigmas = abs(peak) / float(self._sigma[j])
        self._loads[j] = JointLoad(coordinate.name, coordinate.effort_unit, peak, sigmas, ratio)

    def _event(self) -> ContactEvent:
        links = links_carried_by(self._robot, list(self._loads))
        joints: Sequence[JointLoad] = sorted(self._loads.values(), key=lambda load: -load.ratio)
        return ContactEvent(self._start, self._end, tuple(joints), links)
