r"""Friction with memory: states that follow the position, a step at a time.

Over every monotone step between samples a state becomes $\operatorname{clip}(a\,s + b, \pm c)$;
states are handed on from block to block. A law gives $a, b, c$ over arrays or symbols: along a log,
sample by sample, in the virtual robot and in exported C code it is the same step.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState, Scalar, inverse_dynamics
from steelyard.kernel.native.recurrence import recurrence
from steelyard.robot.robot import Robot
from steelyard.terms.acting import ActsOnAxes
from steelyard.terms.axes import Axis
from steelyard.terms.term import Samples, StatefulTerm

Step = tuple[Scalar, Scalar, Scalar]
"""$a$, $b$ and $c$ of one state."""

RigidTorque = Callable[[Array], Iterable[Scalar]]
"""Torques of the rigid bodies, one per joint, for ten numbers per body, `(10 n_bodies,)`."""

BEFORE = 0.1
"""Time for which a motion is taken to have had the speed it begins with [s]."""

FORGOTTEN = 3.0
"""Travel in lengths after which the unknown start is forgotten."""


@dataclass(frozen=True)
class Memory:
    """Where a scan stands.

    Attributes:
        q: Position along every axis, shape `(axes,)`.
        states: State of every channel, shape `(channels,)`.
    """

    q: Array
    states: Array


class Presliding(ActsOnAxes, StatefulTerm):
    """Friction whose states follow the position along its coordinates."""

    @abstractmethod
    def lengths_of(self, axes: Sequence[Axis]) -> list[float]:
        """Length over which each state turns round, those of all axes one after another."""

    @abstractmethod
    def steps(
        self, axes: Sequence[Axis], moved: Sequence[Scalar], speeds: Sequence[Scalar]
    ) -> list[Step]:
        """One step of every state.

        Args:
            axes: The coordinates.
            moved: Change of position along each.
            speeds: Speed along each, at the end of the step.
        """

    def channels(
        self, robot: Robot, state: JointState, states: Sequence[Scalar], torque: RigidTorque
    ) -> list[Scalar]:
        """Channels after a step; by default the states.

        Args:
            robot: The robot.
            state: All joints.
            states: After the step.
            torque: Of the rigid bodies.
        """
        return list(states)

    def n_channels(self, robot: Robot) -> int:
        """One per state."""
        return len(self.lengths_of(self.axes(robot)))

    def n_memory(self, robot: Robot) -> int:
        """Entries of the memory between two steps: positions along the axes, then states."""
        axes = self.axes(robot)
        return len(axes) + len(self.lengths_of(axes))

    def started(self, robot: Robot, state: JointState) -> list[Scalar]:
        """Memory before the first step of a motion, see `remember`.

        Args:
            robot: The robot.
            state: All joints at the first sample.
        """
        axes = self.axes(robot)
        here, speeds = ([axis.of(x) for axis in axes] for x in (state.q, state.dq))
        return [*here, *_begun(speeds, self.lengths_of(axes))]

    def stepped(
        self, robot: Robot, state: JointState, memory: Sequence[Scalar]
    ) -> tuple[list[Scalar], list[Scalar]]:
        """Memory and channels after one step.

        Args:
            robot: The robot.
            state: All joints at the step's end.
            memory: Before the step.
        """
        axes = self.axes(robot)
        here, speeds = ([axis.of(x) for axis in axes] for x in (state.q, state.dq))
        moved = [x - last for x, last in zip(here, memory[: len(axes)], strict=True)]
        steps = self.steps(axes, moved, speeds)
        states = [after(*x) for x in zip(memory[len(axes) :], steps, strict=True)]

        def torque(tens: Array) -> Iterable[Scalar]:
            return inverse_dynamics(robot, state, tens.reshape(-1, 10).tolist())

        return [*here, *states], self.channels(robot, state, states, torque)

    def warm_up(self, robot: Robot) -> Array:
        """Three lengths, the longest of all axes that load a joint."""
        axes = self.axes(robot)
        travel = np.zeros(robot.n_joints)
        for k, length in enumerate(self.lengths_of(axes)):
            row = np.abs(axes[k % len(axes)].row)
            touched = row > 0.0
            travel[touched] = np.maximum(travel[touched], FORGOTTEN * length / row[touched])
        return travel

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """Channels along the motion.

        A motion that begins at some speed is taken to have had it for `BEFORE`; one that begins at
        rest begins with states of zero.
        """
        axes = self.axes(robot)
        rows = np.array([axis.row for axis in axes])
        q, speeds = rows @ samples.q, rows @ samples.dq
        if memory is None:
            memory = Memory(q[:, 0], np.array(_begun(list(speeds[:, 0]), self.lengths_of(axes))))
        moved = np.diff(q, axis=1, prepend=memory.q[:, None])
        steps = self.steps(axes, list(moved), list(speeds))
        parts = np.empty((3, len(steps), q.shape[1]))
        for k, step in enumerate(steps):
            for part, values in zip(parts, step, strict=True):
                part[k] = values
        decay, drive, bound = parts
        states, last = recurrence(decay, drive, bound, memory.states)
        state = JointState(list(samples.q), list(samples.dq), list(samples.ddq), [])
        channels = self.channels(robot, state, list(states), samples.rigid_torque)
        return np.array(channels), Memory(q[:, -1].copy(), last)


def _begun(speeds: Sequence[Scalar], lengths: Sequence[float]) -> list[Scalar]:
    """States after a stretch of `BEFORE` at the first speed along each axis."""
    pairs = [(speeds[k % len(speeds)], length) for k, length in enumerate(lengths)]
    return [np.sign(v) * (1.0 - np.exp(-np.abs(v) * BEFORE / x)) for v, x in pairs]


def relaxed(moved: Scalar, length: float, level: Scalar = 1.0, bound: Scalar = 1.0) -> Step:
    r"""A state that approaches a level $g$ within a length, $a = e^{-|\Delta|/(\delta g)}$."""
    decay = np.exp(-np.abs(moved) / (length * level))
    return decay, np.sign(moved) * level * (1.0 - decay), bound


def after(state: Scalar, step: Step) -> Scalar:
    """A state after a step."""
    decay, drive, bound = step
    return np.minimum(np.maximum(decay * state + drive, -bound), bound)
