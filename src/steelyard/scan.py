"""Along a motion: what the columns of a sample need of the samples before it."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.kernel.loops import Follower, all_joints, open_loop
from steelyard.robot.robot import Robot
from steelyard.terms.term import Remembering, Samples, Term

RigidTorque = Callable[[Array, Array, Array, Array], Array]
"""`q`, `dq`, `ddq` of all joints, `(n_joints, N)`, and ten numbers per body, to torques."""


class Scan:
    """Channels along a motion: what a sample's columns need of the samples before it.

    Attributes:
        robot: The robot.
        closed: Whether the robot's loops closed at each sample of the last call, shape `(N,)`.
    """

    def __init__(
        self, robot: Robot, terms: Sequence[Term], rigid_torque: RigidTorque, drop: bool = False
    ) -> None:
        """Begin.

        Args:
            robot: The robot.
            terms: All terms of the model.
            rigid_torque: Torques of the bodies as a tree, for terms with a reference.
            drop: Whether a loop that cannot close is passed over.
        """
        self.robot = robot
        self.closed: NDArray[np.bool_] = np.ones(0, dtype=bool)
        self._drop, self._terms, self._rigid_torque = drop, tuple(terms), rigid_torque
        self._follower = Follower(robot) if robot.passive else None
        self._memories: list[Any] = [None] * len(terms)
        self._travel: Array | None = None
        self._last: Array | None = None
        warm = [t.warm_up(robot) for t in terms if isinstance(t, Remembering)]
        self._warm_up = np.max([np.zeros(robot.n_joints), *warm], axis=0)

    def __call__(self, q: Array, dq: Array, ddq: Array, t: Array | None = None) -> Array:
        """Channels of consecutive samples.

        Args:
            q: Independent joints, shape `(n, N)`.
            dq: Their velocities.
            ddq: Their accelerations.
            t: Their times, for messages, shape `(N,)` [s].

        Returns:
            Shape `(n_channels, N)`; of a sample that is not closed, those of passive joints are
            those of the sample before.

        Raises:
            DataError: A loop cannot close at a sample, and is not to be passed over.
        """
        passive = self._passive(q, t)
        if not any(isinstance(term, Remembering) for term in self._terms):
            return passive
        q, dq, ddq = all_joints(self.robot, q, dq, ddq, passive)
        samples = Samples(q, dq, ddq, lambda tens: self._rigid_torque(q, dq, ddq, tens))
        found = [passive]
        for k, term in enumerate(self._terms):
            if isinstance(term, Remembering):
                part, self._memories[k] = term.remember(self.robot, samples, self._memories[k])
                found.append(part)
        return np.ascontiguousarray(np.concatenate(found))

    def warm(self, q: Array) -> NDArray[np.bool_]:
        """Whether the start is forgotten, per independent joint, shape `(n, N)`.

        Args:
            q: Independent joints, shape `(n, N)`, every sample once and in order.
        """
        n = self.robot.n
        if not self._warm_up.any():
            return np.ones(q.shape, dtype=bool)
        if self._last is None:
            self._last, self._travel = q[:, :1], np.zeros((n, 1))
        steps = np.abs(np.diff(q, axis=1, prepend=self._last))
        travelled = self._travel + np.cumsum(steps, axis=1)
        self._last, self._travel = q[:, -1:], travelled[:, -1:]
        return np.asarray(travelled >= self._warm_up[:n, None])

    def _passive(self, q: Array, t: Array | None) -> Array:
        """Positions of the passive joints, shape `(n_passive, N)`."""
        if self._follower is None:
            self.closed = np.ones(q.shape[1], dtype=bool)
            return np.empty((0, q.shape[1]))
        passive, self.closed = self._follower(q, stop=not self._drop)
        if not self._drop and not self.closed.all():
            raise open_loop(self._follower, q, self.closed, t)
        return passive
