"""Channels of a motion, passive joints of loops included, along which states are handed on."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, stretches
from steelyard.model.equations.passive_joints import Follower, all_joints, open_loop
from steelyard.model.terms.term import StatefulTerm, Term, TermSamples
from steelyard.robot.robot import Robot

RigidTorqueAlongMotion = Callable[[Array, Array, Array, Array], Array]
"""`q`, `dq`, `ddq` of all joints, `(n_joints, N)`, and ten numbers per body, to torques."""


class Scan:
    """Channels along a motion: what a sample's columns need of the samples before it.

    After each call, `closed` `(N,)` is whether the loops closed at each sample, `warm` `(n, N)`
    whether the start was forgotten per independent joint. That is after a travel of `warm_up`,
    `(n_joints, 1)` [rad; m].
    """

    def __init__(
        self,
        robot: Robot,
        terms: Sequence[Term],
        rigid_torque: RigidTorqueAlongMotion,
        drop: bool = False,
    ) -> None:
        """Begin.

        `rigid_torque` are torques of the bodies as a tree, for terms with a reference. With `drop`
        a loop that cannot close is passed over; what is remembered ends there.
        """
        self.robot = robot
        self.closed: NDArray[np.bool_] = np.ones(0, dtype=bool)
        self.warm: NDArray[np.bool_] = np.ones((robot.n, 0), dtype=bool)
        self._begin = (robot, terms, rigid_torque, drop)
        self._drop, self._rigid_torque = drop, rigid_torque
        self._terms = [term for term in terms if isinstance(term, StatefulTerm)]
        self._follower = Follower(robot) if robot.passive else None
        warm = [term.warm_up(robot) for term in self._terms]
        self.warm_up = np.max([np.zeros(robot.n_joints), *warm], axis=0)[:, None]
        self._forget()

    def __call__(self, q: Array, dq: Array, ddq: Array, t: Array | None = None) -> Array:
        """Channels `(n_channels, N)` of consecutive samples of independent joints, `(n, N)` each.

        Times are for messages [s]. Of a sample that is not closed, those of passive joints are
        those of the sample before, and others are zero. It is a `DataError` if a loop cannot close
        at a sample, and is not to be passed over.
        """
        passive = self._passive(q, t)
        self.warm = np.ones(q.shape, dtype=bool)
        if not self._terms:
            return passive
        q, dq, ddq = all_joints(self.robot, q, dq, ddq, passive)
        if self.closed.all():
            return np.concatenate((passive, self._channels(q, dq, ddq, slice(None))))
        count = sum(term.n_channels(self.robot) for term in self._terms)
        found = np.zeros((count, q.shape[1]))
        for start, stop in stretches(self.closed):
            if start > 0:
                self._forget()
            stretch = slice(start, stop)
            part = q[:, stretch], dq[:, stretch], ddq[:, stretch]
            found[:, stretch] = self._channels(*part, stretch)
        if not self.closed[-1]:
            self._forget()
        return np.concatenate((passive, found))

    def again(self) -> "Scan":
        """A scan of the same terms that remembers nothing."""
        return Scan(*self._begin)

    def _forget(self) -> None:
        self._memories: list[Any] = [None] * len(self._terms)
        self._travelled = np.zeros((self.robot.n_joints, 1))
        self._last: Array | None = None

    def _channels(self, q: Array, dq: Array, ddq: Array, place: slice) -> Array:
        samples = TermSamples(q, dq, ddq, lambda tens: self._rigid_torque(q, dq, ddq, tens))
        found = []
        for k, term in enumerate(self._terms):
            part, self._memories[k] = term.remember(self.robot, samples, self._memories[k])
            found.append(part)
        steps = np.abs(np.diff(q, axis=1, prepend=q[:, :1] if self._last is None else self._last))
        travelled = self._travelled + np.cumsum(steps, axis=1)
        self._last, self._travelled = q[:, -1:].copy(), travelled[:, -1:]
        warm, n = travelled >= self.warm_up, self.robot.n
        self.warm[:, place] = warm[:n] & warm[n:].all(axis=0)
        return np.ascontiguousarray(np.concatenate(found))

    def _passive(self, q: Array, t: Array | None) -> Array:
        if self._follower is None:
            self.closed = np.ones(q.shape[1], dtype=bool)
            return np.empty((0, q.shape[1]))
        passive, self.closed = self._follower(q, stop=not self._drop)
        if not self._drop and not self.closed.all():
            raise open_loop(self._follower, q, self.closed, t)
        return passive
