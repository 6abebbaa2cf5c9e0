"""One step of friction with memory, over symbols: what the plant's machine code runs.

The same exact step as the terms' own scans take along a log. A law that is not listed here is
stepped by its scan, which is slower.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import Scalar
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Axis, per_axis
from steelyard.terms.laws.load_dependent import LoadDependent, shares
from steelyard.terms.laws.presliding import Dahl, LuGre, MaxwellSlip
from steelyard.terms.term import Term

Scalars = Sequence[Scalar]
Found = tuple[list[Scalar], list[Scalar]]
Loads = Callable[[Array], Scalars]
"""Torques of the rigid bodies, one per joint, for ten numbers per body."""


@dataclass(frozen=True)
class Stepping:
    """How a law's memory goes on by one step.

    Attributes:
        axes: Coordinates that it follows.
        n_states: Number of states, zero at the start.
        advance: From the steps of position along the axes, the speeds, the states and the loads of
            the joints by given bodies, to the states and the channels after the step.
    """

    axes: tuple[Axis, ...]
    n_states: int
    advance: Callable[[Scalars, Scalars, Scalars, Loads], Found]


@singledispatch
def stepping(term: Term, robot: Robot) -> Stepping | None:
    """The step of a law; `None` for a law without memory or without a step of this kind."""
    return None


@stepping.register
def _(term: Dahl, robot: Robot) -> Stepping:
    axes = term.axes(robot)
    lengths = per_axis(term.length, axes, term.law)

    def advance(moved: Scalars, _: Scalars, states: Scalars, __: Loads) -> Found:
        new = [_relaxed(*x) for x in zip(states, moved, lengths, strict=True)]
        return new, new

    return Stepping(axes, len(axes), advance)


@stepping.register
def _(term: MaxwellSlip, robot: Robot) -> Stepping:
    axes = term.axes(robot)
    count = len(axes)
    lengths = [length for length in term.lengths for _ in axes]

    def advance(moved: Scalars, _: Scalars, states: Scalars, __: Loads) -> Found:
        steps = [moved[k % count] for k in range(len(lengths))]
        law = _relaxed if term.relaxing else _slipped
        new = [law(*x) for x in zip(states, steps, lengths, strict=True)]
        return new, new

    return Stepping(axes, len(lengths), advance)


@stepping.register
def _(term: LuGre, robot: Robot) -> Stepping:
    axes = term.axes(robot)
    lengths, ratios, speeds = (
        per_axis(values, axes, term.law) for values in (term.length, term.breakaway, term.speed)
    )

    def advance(moved: Scalars, dq: Scalars, states: Scalars, _: Loads) -> Found:
        new, rates = [], []
        for k, length in enumerate(lengths):
            relative = dq[k] / speeds[k]
            level = 1.0 + (ratios[k] - 1.0) * np.exp(-(relative * relative))
            state = _relaxed(states[k], moved[k], length, level)
            bound = max(ratios[k], 1.0)
            new.append(np.minimum(np.maximum(state, -bound), bound))
            rates.append((dq[k] - np.abs(dq[k]) * new[k] / level) / length)
        return new, [*new, *rates]

    return Stepping(axes, len(axes), advance)


@stepping.register
def _(term: LoadDependent, robot: Robot) -> Stepping:
    axes = term.axes(robot)
    lengths = per_axis(term.length, axes, term.law)

    def advance(moved: Scalars, _: Scalars, states: Scalars, loads: Loads) -> Found:
        new = [_relaxed(*x) for x in zip(states, moved, lengths, strict=True)]
        torques = loads(term.reference_of(robot))
        channels = []
        for share, state in zip(shares(robot, axes), new, strict=True):
            parts = [float(c) * x for c, x in zip(share, torques, strict=True) if c]
            channels.append(np.abs(sum(parts[1:], parts[0])) * state)
        return new, channels

    return Stepping(axes, len(axes), advance)


def _relaxed(state: Scalar, moved: Scalar, length: float, level: Scalar = 1.0) -> Scalar:
    """A state that gives way gradually, towards the level, within a length."""
    decay = np.exp(-np.abs(moved) / (length * level))
    return decay * state + np.sign(moved) * level * (1.0 - decay)


def _slipped(state: Scalar, moved: Scalar, length: float) -> Scalar:
    """A state that follows and slips at one."""
    return np.minimum(np.maximum(state + moved / length, -1.0), 1.0)
