r"""Friction that takes energy as a whole, in place of coefficients that do so one by one.

Along a coordinate all laws together give a curve $f(v)$ over speed. What physics asks of it is
$v f(v) \ge 0$, not that each coefficient be positive: friction that grows less than in proportion
to speed has a negative quadratic coefficient. The curve is linear in the coefficients, so a grid of
speeds gives rows of a convex program. Laws that remember are asked for the energy of slow closed
cycles as well: whatever a hysteresis of elements that slip runs through decomposes into such cycles
[AlBender2005]. Nor may friction be a multiple of that of sliding on the way from one direction to
the other.
"""

from collections.abc import Sequence
from typing import ClassVar, Protocol, cast

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.knowledge import Row
from steelyard.kernel.dynamics import JointState
from steelyard.model import Model
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Acting, Axis, Dissipation
from steelyard.terms.term import Remembering, Samples, Term

REACH = 1.5
"""Speed up to which friction takes energy, over the greatest of the data."""

SPEEDS = np.concatenate([np.geomspace(1e-4, 0.03, 6), np.linspace(0.05, 1.0, 20)])
"""Grid of speeds, over the greatest."""

SLOW = 0.05
"""Speed of cycles, over the greatest of the data."""

SLID = 20.0
"""Travel at a speed until memory is that of steady sliding, in lengths."""

STEPS = 100
"""Steps of half a cycle."""

TURNED = 30
"""Positions after a turn at which friction is bounded."""

PEAK = 2.0
"""Greatest friction on the way from one direction to the other, over that of slow sliding."""

RANGES = 2.0 ** np.arange(-8.0, 3.0)
"""Ranges of cycles, over the greatest length of a law."""


class Law(Term, Protocol):
    """A friction law along coordinates."""

    dissipation: ClassVar[Dissipation]

    def axes(self, robot: Robot) -> tuple[Axis, ...]:
        """The coordinates it acts along."""
        ...


def friction_curves(model: Model, fastest: Sequence[float] | Array) -> tuple[Row, ...]:
    """Rows that ask the friction along every coordinate to take energy.

    Args:
        model: The model.
        fastest: Greatest speed of each joint in the data, shape `(n,)` [rad/s; m/s]; joints that
            loops determine have none.
    """
    laws = [
        cast(Law, term)
        for term in model.terms
        if isinstance(term, Acting) and term.dissipation != "none" and not term.per_run
    ]
    rows: list[Row] = []
    for axis in dict.fromkeys(axis for law in laws for axis in law.axes(model.robot)):
        n = len(fastest)
        top = REACH * float(np.abs(axis.row[:n]) @ np.asarray(fastest))
        if any(axis.row[n:]) or not 0.0 < top < np.inf:
            continue
        mine = [law for law in laws if axis in law.axes(model.robot)]
        if any(law.dissipation == "together" for law in mine):
            rows += _rows(mine, model.robot, axis, top)
    return tuple(rows)


def shaped(model: Model, rows: Sequence[Row]) -> frozenset[str]:
    """Names of coefficients in rows that may be negative, as their curve is bounded."""
    bounded = {name for row in rows for name in row.coefficients}
    return frozenset(
        p.name
        for term in model.terms
        if isinstance(term, Acting) and term.dissipation == "together"
        for p in term.parameters(model.robot)
        if p.name in bounded
    )


def _rows(laws: Sequence[Law], robot: Robot, axis: Axis, top: float) -> list[Row]:
    """The rows of one coordinate, each once."""
    speeds = np.concatenate([top * SPEEDS, -top * SPEEDS])
    ranges = _ranges(laws, robot)
    names: list[str] = []
    columns: list[Array] = []
    for law in laws:
        at = [
            k for k, p in enumerate(law.parameters(robot)) if p.name.partition(".")[2] == axis.name
        ]
        names += [law.parameters(robot)[k].name for k in at]
        slow = SLOW * top / REACH
        steady = _along(law, robot, axis, *_sliding(law, robot, speeds))[at]
        sliding = np.sign(speeds) * steady[:, 2::2]
        cycles = [_work(law, robot, axis, reach, slow)[at] for reach in ranges]
        turns = _turned(law, robot, axis, ranges, slow)[at]
        parts = (sliding, np.array(cycles).T.reshape(len(at), -1), turns)
        columns += list(np.concatenate(parts, axis=1))
    matrix = np.array(columns).T
    sizes = np.linalg.norm(matrix, axis=1)
    unit = np.unique(np.round(matrix[sizes > 0.0] / sizes[sizes > 0.0, None], 9), axis=0)
    label = f"friction of '{axis.name}' up to {top:.3g} {axis.speed_unit}"
    return [
        Row(label, {n: float(x) for n, x in zip(names, row, strict=True) if x}, lower=0.0)
        for row in unit
    ]


def _ranges(laws: Sequence[Law], robot: Robot) -> list[float]:
    """Ranges of cycles, where a law that remembers shapes the curve."""
    found: set[float] = set()
    for law in laws:
        if isinstance(law, Remembering) and law.dissipation == "together":
            lengths = getattr(law, "lengths", ())
            found |= {2.0 * length for length in lengths}
            found |= {float(max(lengths) * r) for r in RANGES}
    return sorted(found)


def _sliding(law: Law, robot: Robot, speeds: Array) -> tuple[Array, Array]:
    """A motion that slides at one speed after the other: position and speed at two samples each."""
    far = 1.0
    if isinstance(law, Remembering):
        far = SLID * max(float(np.max(law.warm_up(robot))), 1e-9)
    v = np.concatenate([speeds[:1], np.repeat(speeds, 2)])
    steps = np.sign(v) * far
    steps[0] = 0.0
    return np.cumsum(steps), v


def _work(law: Law, robot: Robot, axis: Axis, reach: float, speed: float) -> Array:
    """Energy of a closed cycle over its length, per unit of each parameter."""
    half = np.linspace(0.0, reach, STEPS + 1)
    once = np.concatenate([half[1:], half[-2::-1]])
    x = np.concatenate([[0.0], np.tile(once, 3)])
    steps = np.diff(x, prepend=-reach / STEPS)
    force = _along(law, robot, axis, x, np.sign(steps) * speed)
    last = slice(len(x) - 2 * STEPS, None)
    if not isinstance(law, Remembering):
        return np.asarray(force[:, last] @ steps[last] / (2.0 * reach))
    before = force[:, len(x) - 2 * STEPS - 1 : -1]
    return np.asarray(0.5 * (force[:, last] + before) @ steps[last] / (2.0 * reach))


def _turned(law: Law, robot: Robot, axis: Axis, ranges: Sequence[float], speed: float) -> Array:
    """What is left below `PEAK` after a turn from sliding, on both sides, per parameter."""
    if not ranges:
        return np.zeros((len(law.parameters(robot)), 0))
    far = SLID * ranges[-1]
    travel = np.append(np.geomspace(0.05 * ranges[0], ranges[-1], TURNED), far)
    x = np.concatenate([[far, 0.0], travel])
    v = np.where(np.arange(len(x)) < 2, -speed, speed)
    force = _along(law, robot, axis, x, v)[:, 2:]
    sliding = PEAK * force[:, -1:]
    return np.concatenate([sliding - force[:, :-1], sliding + force[:, :-1]], axis=1)


def _along(law: Law, robot: Robot, axis: Axis, x: Array, v: Array) -> Array:
    """Force of every parameter along a coordinate that alone moves, shape `(parameters, N)`."""
    row = np.array(axis.row)
    direction = row / (row @ row)
    q, dq = np.outer(direction, x), np.outer(direction, v)
    channels = np.empty((0, len(x)))
    if isinstance(law, Remembering):
        samples = Samples(q, dq, np.zeros_like(q), lambda tens: np.zeros_like(q))
        channels, _ = law.remember(robot, samples, None)
    state = JointState(list(q), list(dq), [np.zeros_like(x)] * len(q), list(channels))
    force = np.zeros((len(law.parameters(robot)), len(x)))
    for (joint, parameter), column in law.columns(robot, state).items():
        force[parameter] += direction[joint] * column
    return force
