r"""Friction with memory: what a contact does before it slides, and how it gives way.

All laws here follow a state $s$ along the position alone, exactly over every monotone step
$\Delta$ between samples, so the split of a motion into samples or blocks does not matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.kernel.dynamics import JointState
from steelyard.kernel.recurrence import recurrence
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Acting, Axis, each, per_axis, spread
from steelyard.terms.term import Columns, Samples

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
class Dahl(Acting):
    r"""Dahl friction, $f = f_c\,s$ with $ds/dq = (1 - s\,\mathrm{sign}\,\dot q)/\delta$ [Dahl1968].

    A reversal turns the friction round within some lengths $\delta$; a resting joint keeps what it
    had. Over a step $\Delta$, $s \leftarrow \pm 1 + (s \mp 1)\,e^{-|\Delta|/\delta}$.

    Attributes:
        length: Presliding length $\delta$, one for all or one per coordinate [rad; m].
    """

    law: ClassVar[str] = "dahl"
    aside: ClassVar[tuple[str, ...]] = ("length",)
    length: float | tuple[float, ...] = 3e-4

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, not negative."""
        return each(self.axes(robot), self.law, lambda axis: axis.effort_unit, lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The state."""
        return spread(self.axes(robot), lambda k, _: state.channels[k])

    def n_channels(self, robot: Robot) -> int:
        """One state per coordinate."""
        return len(self.axes(robot))

    def warm_up(self, robot: Robot) -> Array:
        """Three lengths."""
        axes = self.axes(robot)
        return forgotten(axes, per_axis(self.length, axes, self.law), robot)

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """The states along the motion."""
        axes = self.axes(robot)
        lengths = np.array(per_axis(self.length, axes, self.law))[:, None]
        steps, start = stepped(axes, samples, memory, len(axes))
        decay = np.exp(-np.abs(steps) / lengths)
        drive = np.sign(steps) * (1.0 - decay)
        states, last = recurrence(decay, drive, np.ones_like(decay), start.states)
        return states, Memory(start.q, last)


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
    aside: ClassVar[tuple[str, ...]] = ("lengths", "relaxing")
    lengths: tuple[float, ...] = (3e-4, 1e-3, 3e-3, 1e-2)
    relaxing: bool = False

    def __post_init__(self) -> None:
        if not self.lengths or not all(length > 0.0 for length in self.lengths):
            raise ModelError(
                f"Maxwell slip with lengths {list(self.lengths)}",
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
        axes = self.axes(robot)
        columns: dict[tuple[int, int], Any] = {}
        for first in range(0, len(self.lengths) * len(axes), len(axes)):
            part = state.channels[first : first + len(axes)]
            columns.update(spread(axes, lambda k, _, part=part: part[k], first))
        return columns

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
        steps, start = stepped(axes, samples, memory, self.n_channels(robot))
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
    r"""LuGre friction, $f = f_c\,(s + \tau_1 \dot s)$-like bristles, linear in three parameters.

    $$ \dot s = \frac{\dot q}{\delta} - \frac{|\dot q|}{\delta\,g(\dot q)}\,s, \qquad
       g = 1 + (r - 1)\,e^{-(\dot q / v_s)^2}, \qquad f = f_c\,s + f_1\,\dot s + f_v\,\dot q $$

    with $\sigma_0 = f_c/\delta$ and $\sigma_1 = f_1/\delta$ of the customary form
    [CanudasDeWit1995]; the viscous part is the term `viscous`.

    Attributes:
        length: Bristle deflection $\delta$ at which Coulomb friction is reached [rad; m].
        breakaway: Ratio $r$ of breakaway to Coulomb friction, at least 1.
        speed: Stribeck speed $v_s$ [rad/s; m/s].
    """

    law: ClassVar[str] = "lugre"
    aside: ClassVar[tuple[str, ...]] = ("length", "breakaway", "speed")
    length: float | tuple[float, ...] = 3e-4
    breakaway: float | tuple[float, ...] = 1.3
    speed: float | tuple[float, ...] = 0.02

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
        steps, start = stepped(axes, samples, memory, len(axes))
        decay = np.exp(-np.abs(steps) / (length * level))
        drive = np.sign(steps) * level * (1.0 - decay)
        bound = np.broadcast_to(np.maximum(ratio, 1.0), decay.shape)
        states, last = recurrence(decay, drive, bound, start.states)
        rate = (dq - np.abs(dq) * states / level) / length
        return np.concatenate((states, rate)), Memory(start.q, last)


def along(axes: Sequence[Axis], values: Array) -> Array:
    """Values of all joints, `(n_joints, N)`, along the axes, `(axes, N)`."""
    return np.array([axis.row for axis in axes]) @ values


def stepped(
    axes: Sequence[Axis], samples: Samples, memory: Any, n_states: int
) -> tuple[Array, Memory]:
    """Steps of position into every sample, `(axes, N)`; the memory with the last position."""
    q = along(axes, samples.q)
    before = q[:, 0] if memory is None else memory.q
    states = np.zeros(n_states) if memory is None else memory.states
    return np.diff(q, axis=1, prepend=before[:, None]), Memory(q[:, -1].copy(), states)


def forgotten(axes: Sequence[Axis], lengths: Sequence[float], robot: Robot) -> Array:
    """Travel per joint after which all axes that load it have forgotten their start."""
    travel = np.zeros(robot.n_joints)
    for axis, length in zip(axes, lengths, strict=True):
        row = np.abs(axis.row)
        touched = row > 0.0
        travel[touched] = np.maximum(travel[touched], FORGOTTEN * length / row[touched])
    return travel
