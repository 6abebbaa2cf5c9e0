r"""What laws with memory share: states along the position, and what samples need of earlier ones.

Over every monotone step between samples a state becomes $\operatorname{clip}(a\,s + b, \pm c)$;
states are handed on from block to block. A law gives $a, b, c$ over arrays or symbols: along a log,
sample by sample, in the virtual robot and in exported C code it is the same step.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars, inverse_dynamics
from steelyard.model.terms.axes_and_fields import Axes
from steelyard.model.terms.term import ActsOnAxes, Cause, StatefulTerm, TermSamples
from steelyard.robot.robot import Robot
from steelyard.symbolic.native.compiled_programs import recurrence

StateStep = tuple[Scalar, Scalar, Scalar]  # $a$, $b$ and $c$ of one state


RigidTorque = Callable[[Array], Iterable[Scalar]]
"""Torques of the rigid bodies, one per joint, for ten numbers per body, `(10 n_bodies,)`."""


SPEED_KEPT_BEFORE = 0.1  # time for which a motion is taken to have had the speed it begins with [s]
LENGTHS_TO_FORGET = 3.0  # travel in lengths after which the unknown start is forgotten


@dataclass(frozen=True)
class Memory:
    """Where a scan stands: positions along the axes `(axes,)`, states of channels `(channels,)`."""

    q: Array
    states: Array


class Presliding(ActsOnAxes, StatefulTerm):
    """Friction whose states follow the position along its coordinates."""

    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "reversals of"

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The channels."""
        return state.channels

    @abstractmethod
    def lengths_of(self, axes: Axes) -> list[float]:
        """Length over which each state turns round, those of all axes one after another."""

    @abstractmethod
    def steps(self, axes: Axes, moved: Scalars, speeds: Scalars) -> list[StateStep]:
        """One step of every state, from changes of position and speeds at its end along axes."""

    def channels(
        self, robot: Robot, state: JointState, states: Scalars, torque: RigidTorque
    ) -> list[Scalar]:
        """Channels after a step; by default the states after it."""
        return list(states)

    def n_channels(self, robot: Robot) -> int:
        """One per state."""
        return len(self.lengths_of(self.axes(robot)))

    def n_memory(self, robot: Robot) -> int:
        """Entries of the memory between two steps: positions along the axes, then states."""
        axes = self.axes(robot)
        return len(axes) + len(self.lengths_of(axes))

    def started(self, robot: Robot, state: JointState) -> list[Scalar]:
        """Memory before the first step of a motion, see `remember`, from the state of joints."""
        axes = self.axes(robot)
        here, speeds = ([axis.of(x) for axis in axes] for x in (state.q, state.dq))
        return [*here, *_begun(speeds, self.lengths_of(axes))]

    def stepped(
        self, robot: Robot, state: JointState, memory: Scalars
    ) -> tuple[list[Scalar], list[Scalar]]:
        """Memory and channels after one step, from all joints at its end and the memory before."""
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
            travel[touched] = np.maximum(travel[touched], LENGTHS_TO_FORGET * length / row[touched])
        return travel

    def remember(self, robot: Robot, samples: TermSamples, memory: Any) -> tuple[Array, Any]:
        """Channels along the motion.

        A motion that begins at some speed is taken to have had it for `SPEED_KEPT_BEFORE`; one that
        begins at rest begins with states of zero.
        """
        axes = self.axes(robot)
        along = np.array([axis.row for axis in axes])
        q, speeds = along @ samples.q, along @ samples.dq
        if memory is None:
            memory = Memory(q[:, 0], np.array(_begun(list(speeds[:, 0]), self.lengths_of(axes))))
        moved = np.diff(q, axis=1, prepend=memory.q[:, None])
        steps = self.steps(axes, list(moved), list(speeds))
        rows = [
            [np.broadcast_to(x, q.shape[1:]) for x in part] for part in zip(*steps, strict=True)
        ]
        decay, drive, bound = np.array(rows)
        states, last = recurrence(decay, drive, bound, memory.states)
        state = JointState(list(samples.q), list(samples.dq), list(samples.ddq), [])
        channels = self.channels(robot, state, list(states), samples.rigid_torque)
        return np.array(channels), Memory(q[:, -1].copy(), last)


def _begun(speeds: Scalars, lengths: Sequence[float]) -> list[Scalar]:
    """States after a stretch of `SPEED_KEPT_BEFORE` at the first speed along each axis."""
    pairs = [(speeds[k % len(speeds)], length) for k, length in enumerate(lengths)]
    return [np.sign(v) * (1.0 - np.exp(-np.abs(v) * SPEED_KEPT_BEFORE / x)) for v, x in pairs]


def relaxed(moved: Scalar, length: float, level: Scalar = 1.0, bound: Scalar = 1.0) -> StateStep:
    r"""A state that approaches a level $g$ within a length, $a = e^{-|\Delta|/(\delta g)}$."""
    decay = np.exp(-np.abs(moved) / (length * level))
    return decay, np.sign(moved) * level * (1.0 - decay), bound


def after(state: Scalar, step: StateStep) -> Scalar:
    """A state after a step."""
    decay, drive, bound = step
    return np.minimum(np.maximum(decay * state + drive, -bound), bound)
