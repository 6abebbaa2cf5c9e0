r"""Terms that need samples before: states along the position, channels of a motion, candidates.

Over every monotone step between samples a state becomes $\operatorname{clip}(a\,s + b, \pm c)$;
states are handed on from block to block. A law gives $a, b, c$ over arrays or symbols: along a log,
sample by sample, in the virtual robot and in exported C code it is the same step.

Columns of candidates for one term, such as fields that are compared, are channels as well: programs
over them do not know the values, so the next set of candidates needs no new machine code.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, Parameter, stretches
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars, inverse_dynamics
from steelyard.model.equations.passive_joints import Follower, all_joints, open_loop
from steelyard.model.terms.axes_and_fields import Axes
from steelyard.model.terms.term import (
    ActsOnAxes,
    Cause,
    Columns,
    Dissipation,
    StatefulTerm,
    Term,
    TermSamples,
    columns_at_rest,
)
from steelyard.robot.robot import Robot
from steelyard.symbolic.native.compiled_programs import recurrence

StateStep = tuple[Scalar, Scalar, Scalar]  # $a$, $b$ and $c$ of one state

RigidTorque = Callable[[Array], Iterable[Scalar]]
"""Torques of the rigid bodies, one per joint, for ten numbers per body, `(10 n_bodies,)`."""

SPEED_KEPT_BEFORE = 0.1  # time for which a motion is taken to have had the speed it begins with [s]
LENGTHS_TO_FORGET = 3.0  # travel in lengths after which the unknown start is forgotten


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
        states = [
            np.minimum(np.maximum(decay * state + drive, -bound), bound)
            for state, (decay, drive, bound) in zip(memory[len(axes) :], steps, strict=True)
        ]

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
        """Channels along the motion; the memory is positions along the axes, and states.

        A motion that begins at some speed is taken to have had it for `SPEED_KEPT_BEFORE`; one that
        begins at rest begins with states of zero.
        """
        axes = self.axes(robot)
        along = np.array([axis.row for axis in axes])
        q, speeds = along @ samples.q, along @ samples.dq
        begun = np.array(_begun(list(speeds[:, 0]), self.lengths_of(axes)))
        last, start = memory or (q[:, 0], begun)
        moved = np.diff(q, axis=1, prepend=last[:, None])
        steps = self.steps(axes, list(moved), list(speeds))
        rows = [
            [np.broadcast_to(x, q.shape[1:]) for x in part] for part in zip(*steps, strict=True)
        ]
        decay, drive, bound = np.array(rows)
        states, end = recurrence(decay, drive, bound, start)
        state = JointState(list(samples.q), list(samples.dq), list(samples.ddq), [])
        channels = self.channels(robot, state, list(states), samples.rigid_torque)
        return np.array(channels), (q[:, -1].copy(), end)


def _begun(speeds: Scalars, lengths: Sequence[float]) -> list[Scalar]:
    """States after a stretch of `SPEED_KEPT_BEFORE` at the first speed along each axis."""
    pairs = [(speeds[k % len(speeds)], length) for k, length in enumerate(lengths)]
    return [np.sign(v) * (1.0 - np.exp(-np.abs(v) * SPEED_KEPT_BEFORE / x)) for v, x in pairs]


def relaxed(moved: Scalar, length: float, level: Scalar = 1.0, bound: Scalar = 1.0) -> StateStep:
    r"""A state that approaches a level $g$ within a length, $a = e^{-|\Delta|/(\delta g)}$."""
    decay = np.exp(-np.abs(moved) / (length * level))
    return decay, np.sign(moved) * level * (1.0 - decay), bound


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


@dataclass(frozen=True)
class CandidateTerms(StatefulTerm):
    """Candidates for one term side by side; the parameters of number `c` are named `name@c`.

    `longest` is the term with the longest memory of all that will be compared, so that the same
    samples count for all; `names` are those of one candidate's parameters, `places` the rows and
    parameters of its columns.
    """

    law: ClassVar[str] = "dictionary"
    dissipation: ClassVar[Dissipation] = "none"
    state_only_fields: ClassVar[tuple[str, ...]] = ("candidates", "longest")
    candidates: tuple[Term, ...]
    longest: Term
    names: tuple[str, ...]
    places: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, robot: Robot, candidates: Sequence[Term], longest: Term) -> "CandidateTerms":
        """A dictionary of at least one candidate."""
        names = tuple(p.name for p in candidates[0].parameters(robot))
        return cls(tuple(candidates), longest, names, tuple(columns_at_rest(candidates[0], robot)))

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Those of all candidates."""
        one = self.longest.parameters(robot)
        return tuple(
            replace(p, name=f"{p.name}@{c}") for c in range(len(self.candidates)) for p in one
        )

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The channels."""
        size, width = len(self.places), len(self.names)
        return {
            (row, c * width + column): state.channels[c * size + k]
            for c in range(len(self.candidates))
            for k, (row, column) in enumerate(self.places)
        }

    def n_channels(self, robot: Robot) -> int:
        """One per candidate and entry."""
        return len(self.candidates) * len(self.places)

    def warm_up(self, robot: Robot) -> Array:
        """That of the longest memory."""
        longest = self.longest
        if isinstance(longest, StatefulTerm):
            return longest.warm_up(robot)
        return super().warm_up(robot)

    def remember(self, robot: Robot, samples: TermSamples, memory: Any) -> tuple[Array, Any]:
        """All candidates' columns along the motion."""
        count = samples.q.shape[1]
        memories = list(memory or [None] * len(self.candidates))
        result = np.empty((self.n_channels(robot), count))
        known: dict[bytes, Array] = {}

        def once(tens: Array, torque: Callable[[Array], Array] = samples.rigid_torque) -> Array:
            key = tens.tobytes()
            if key not in known:
                known[key] = torque(tens)
            return known[key]

        samples = replace(samples, rigid_torque=once)
        row = 0
        for c, term in enumerate(self.candidates):
            channels = np.empty((0, count))
            if isinstance(term, StatefulTerm):
                channels, memories[c] = term.remember(robot, samples, memories[c])
            seen = (list(x) for x in (samples.q, samples.dq, samples.ddq, channels))
            columns = term.columns(robot, JointState(*seen))
            for place in self.places:
                result[row] = columns[place]
                row += 1
        return result, memories
