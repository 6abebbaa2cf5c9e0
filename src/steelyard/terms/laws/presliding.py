r"""Friction with memory: what a contact does before it slides, and how it gives way.

All laws here follow states $s$ along the position, exactly over every monotone step $\Delta$
between samples, and hand them on from block to block. Where a motion is sampled more finely,
states at the old samples stay as they were; only LuGre, whose steady state depends on the
velocity, takes the velocity of a step's end for the whole step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.kernel.equations.dynamics import JointState
from steelyard.kernel.native.recurrence import recurrence
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Acting, Axis, Dissipation, each, per_axis, spread
from steelyard.terms.direction import Field, refuse_not_positive
from steelyard.terms.term import Columns, Samples

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


@dataclass(frozen=True)
class OneState(Acting):
    """A law whose torque is one channel per coordinate, which a presliding state makes.

    Attributes:
        length: Presliding length, one for all or one per coordinate [rad; m].
    """

    law: ClassVar[str]
    aside: ClassVar[tuple[str, ...]] = ("length",)
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {"length": (1e-5, 3e-2)}
    length: Field = 3e-4

    def __post_init__(self) -> None:
        refuse_not_positive(self.law, length=self.length)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The channel."""
        return spread(self.axes(robot), lambda k, _: state.channels[k])

    def n_channels(self, robot: Robot) -> int:
        """One per coordinate."""
        return len(self.axes(robot))

    def warm_up(self, robot: Robot) -> Array:
        """Three lengths."""
        axes = self.axes(robot)
        return forgotten(axes, per_axis(self.length, axes, self.law), robot)


@dataclass(frozen=True)
class Dahl(OneState):
    r"""Dahl friction, $f = f_c\,s$ with $ds/dq = (1 - s\,\mathrm{sign}\,\dot q)/\delta$ [Dahl1968].

    A reversal turns the friction round within some lengths $\delta$; a resting joint keeps what it
    had. Over a step $\Delta$, $s \leftarrow \pm 1 + (s \mp 1)\,e^{-|\Delta|/\delta}$.

    Attributes:
        length: Presliding length $\delta$, one for all or one per coordinate [rad; m].
    """

    law: ClassVar[str] = "dahl"
    dissipation: ClassVar[Dissipation] = "each"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, not negative."""
        return each(self.axes(robot), self.law, lambda axis: axis.effort_unit, lower=0.0)

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """The states along the motion."""
        axes = self.axes(robot)
        return dahl_states(axes, per_axis(self.length, axes, self.law), samples, memory)


@dataclass(frozen=True)
class MaxwellSlip(Acting):
    r"""Generalised Maxwell slip, $f = \sum_i f_i\,s_i$: elastic elements that slip [AlBender2005].

    An element stretches by the position and slips at the end of its length,
    $s_i \leftarrow \operatorname{clip}(s_i + \Delta/\delta_i, \pm 1)$; with `relaxing` it gives way
    gradually, as a Dahl state of length $\delta_i$ does.

    Attributes:
        lengths: Lengths $\delta_i$ of the elements [rad; m].
        relaxing: Whether elements give way gradually.
    """

    law: ClassVar[str] = "maxwell_slip"
    dissipation: ClassVar[Dissipation] = "together"
    aside: ClassVar[tuple[str, ...]] = ("lengths", "relaxing")
    lengths: tuple[float, ...] = (3e-4, 1e-3, 3e-3, 1e-2)
    relaxing: bool = False

    def __post_init__(self) -> None:
        if not _are_lengths(self.lengths):
            raise ModelError(
                f"Maxwell slip with lengths {self.lengths!r}",
                where="list of terms",
                mend="give one length above zero per element: lengths = [3e-4, 1e-3]",
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate and element, not negative."""
        return tuple(
            parameter
            for k in range(len(self.lengths))
            for parameter in each(
                self.axes(robot), f"{self.law}{k + 1}", lambda axis: axis.effort_unit, lower=0.0
            )
        )

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The states of the elements."""
        axes = self.axes(robot) * len(self.lengths)
        return spread(axes, lambda k, _: state.channels[k])

    def n_channels(self, robot: Robot) -> int:
        """One state per coordinate and element."""
        return len(self.lengths) * len(self.axes(robot))

    def warm_up(self, robot: Robot) -> Array:
        """Three times the largest length."""
        axes = self.axes(robot)
        return forgotten(axes, [max(self.lengths)] * len(axes), robot)

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """The states along the motion."""
        axes = self.axes(robot)
        lengths = np.repeat(self.lengths, len(axes))
        steps, start = stepped(axes, samples, memory, lengths)
        relative = np.concatenate([steps / length for length in self.lengths])
        if self.relaxing:
            decay = np.exp(-np.abs(relative))
            drive = np.sign(relative) * (1.0 - decay)
        else:
            decay, drive = np.ones_like(relative), relative
        states, last = recurrence(decay, drive, np.ones_like(decay), start.states)
        return states, Memory(start.q, last)


@dataclass(frozen=True)
class LuGre(Acting):
    r"""LuGre friction, $f = f_c\,s + f_1\,\dot s$ with bristles bent by $s$ [CanudasDeWit1995].

    $$ \dot s = \frac{v}{\delta} - \frac{|v|}{\delta\,g(v)}\,s, \qquad
       g = 1 + (r - 1)\,e^{-(v / v_s)^2} $$

    In the customary form $\sigma_0 = f_c/\delta$ and $\sigma_1 = f_1/\delta$; its viscous part is
    the term `viscous`. $|s|$ never exceeds $r$. The velocity at a sample holds for the step into
    it: sample so that it changes by little, against $v_s$, from sample to sample.

    Attributes:
        length: Bristle deflection $\delta$ at which Coulomb friction is reached [rad; m].
        breakaway: Ratio $r$ of breakaway to Coulomb friction, at least 1.
        speed: Stribeck speed $v_s$ [rad/s; m/s].
    """

    law: ClassVar[str] = "lugre"
    dissipation: ClassVar[Dissipation] = "each"
    aside: ClassVar[tuple[str, ...]] = ("length", "breakaway", "speed")
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {
        "length": (1e-5, 3e-2),
        "speed": (1e-3, 1.0),
    }
    length: Field = 3e-4
    breakaway: float | tuple[float, ...] = 1.3
    speed: Field = 0.02

    def __post_init__(self) -> None:
        refuse_not_positive(
            self.law, length=self.length, breakaway=self.breakaway, speed=self.speed
        )
        ratios = self.breakaway if isinstance(self.breakaway, tuple) else (self.breakaway,)
        if min(ratios, default=1.0) < 1.0:
            raise ModelError(
                f"LuGre friction breaks away at {min(ratios):g} times its Coulomb friction",
                where="list of terms",
                mend="give `breakaway` as a ratio of at least 1, one for all or a list",
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Coulomb friction and bristle damping per coordinate."""
        axes = self.axes(robot)
        return (
            *each(axes, self.law, lambda axis: axis.effort_unit, lower=0.0),
            *each(axes, f"{self.law}_damping", lambda axis: axis.effort_per("Hz"), lower=0.0),
        )

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The state and its rate."""
        axes = self.axes(robot)
        count = len(axes)
        return {
            **spread(axes, lambda k, _: state.channels[k]),
            **spread(axes, lambda k, _: state.channels[count + k], count),
        }

    def n_channels(self, robot: Robot) -> int:
        """State and rate per coordinate."""
        return 2 * len(self.axes(robot))

    def warm_up(self, robot: Robot) -> Array:
        """Three lengths."""
        axes = self.axes(robot)
        return forgotten(axes, per_axis(self.length, axes, self.law), robot)

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """States and rates along the motion."""
        axes = self.axes(robot)
        length, ratio, speed = (
            np.array(per_axis(values, axes, self.law))[:, None]
            for values in (self.length, self.breakaway, self.speed)
        )
        dq = along(axes, samples.dq)
        level = 1.0 + (ratio - 1.0) * np.exp(-np.square(dq / speed))
        steps, start = stepped(axes, samples, memory, length[:, 0])
        decay = np.exp(-np.abs(steps) / (length * level))
        drive = np.sign(steps) * level * (1.0 - decay)
        bound = np.broadcast_to(np.maximum(ratio, 1.0), decay.shape)
        states, last = recurrence(decay, drive, bound, start.states)
        rate = (dq - np.abs(dq) * states / level) / length
        return np.concatenate((states, rate)), Memory(start.q, last)


def dahl_states(
    axes: Sequence[Axis], lengths: Sequence[float], samples: Samples, memory: Any
) -> tuple[Array, Memory]:
    """Dahl states along the axes, `(axes, N)`, and where they stand at the end."""
    steps, start = stepped(axes, samples, memory, np.array(lengths))
    decay = np.exp(-np.abs(steps) / np.array(lengths)[:, None])
    drive = np.sign(steps) * (1.0 - decay)
    states, last = recurrence(decay, drive, np.ones_like(decay), start.states)
    return states, Memory(start.q, last)


def _are_lengths(values: Any) -> bool:
    return (
        isinstance(values, tuple)
        and bool(values)
        and all(isinstance(x, float | int) and 0.0 < x < float("inf") for x in values)
    )


def along(axes: Sequence[Axis], values: Array) -> Array:
    """Values of all joints, `(n_joints, N)`, along the axes, `(axes, N)`."""
    return np.array([axis.row for axis in axes]) @ values


def stepped(
    axes: Sequence[Axis], samples: Samples, memory: Any, lengths: Array
) -> tuple[Array, Memory]:
    """Steps of position into every sample, and the memory with the last position.

    A motion that begins at some speed is taken to have had it for `BEFORE`; one that begins at
    rest begins with states of zero.

    Args:
        axes: The coordinates.
        samples: The motion.
        memory: From the samples before; `None` at a start.
        lengths: Length of every state, those of all axes one after another, shape `(states,)`.

    Returns:
        Steps, shape `(axes, N)`, and the memory before them, but with the last position.
    """
    q = along(axes, samples.q)
    if memory is None:
        speed = np.resize(along(axes, samples.dq[:, :1])[:, 0], len(lengths))
        states = np.sign(speed) * (1.0 - np.exp(-np.abs(speed) * BEFORE / lengths))
        memory = Memory(q[:, 0], states)
    before, states = memory.q, memory.states
    return np.diff(q, axis=1, prepend=before[:, None]), Memory(q[:, -1].copy(), states)


def forgotten(axes: Sequence[Axis], lengths: Sequence[float], robot: Robot) -> Array:
    """Travel per joint after which all axes that load it have forgotten their start."""
    travel = np.zeros(robot.n_joints)
    for axis, length in zip(axes, lengths, strict=True):
        row = np.abs(axis.row)
        touched = row > 0.0
        travel[touched] = np.maximum(travel[touched], FORGOTTEN * length / row[touched])
    return travel
