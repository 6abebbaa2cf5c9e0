r"""Friction that takes energy as a whole, in place of coefficients that do so one by one.

Along a coordinate all laws together give a curve $f(v)$ over speed. What physics requires of it is
$v f(v) \ge 0$, not that each coefficient be positive: friction that grows less than in proportion
to speed has a negative quadratic coefficient. The curve is linear in the coefficients, so a grid of
speeds gives rows of a convex program. Of laws that remember it is the energy of slow closed
cycles as well: whatever a hysteresis of elements that slip runs through decomposes into such cycles
[AlBender2005]. Nor may friction be a multiple of that of sliding on the way from one direction to
the other.
"""

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.knowledge import Row
from steelyard.kernel.equations.dynamics import JointState
from steelyard.model import Model
from steelyard.robot.robot import Robot
from steelyard.terms.acting import ActsOnAxes
from steelyard.terms.axes import Axis
from steelyard.terms.memory import Presliding
from steelyard.terms.term import Samples, StatefulTerm

REACH = 1.5
"""Speed up to which friction takes energy, over the greatest of the data."""

FARTHEST = 20.0
"""Limit of a joint's speed that is believed, over the greatest of the data."""

STILL = 1e-9
"""Speed that stands for one next to zero, over `REACH` times the greatest of the data."""

SPEEDS = np.concatenate([[STILL], np.geomspace(1e-4, 0.03, 6), np.linspace(0.05, 1.0, 20)])
"""Grid of speeds, over the same."""

BEYOND = np.linspace(0.1, 1.0, 10)
"""Grid of speeds that the data do not reach, over the limit of the joint."""

CYCLES = (STILL, 0.01, 0.1, 1.0)
"""Speeds of cycles, over the same as `SPEEDS`."""

OFTEN = 50.0
"""Cycles per second that no arm exceeds [Hz]."""

NOTHING = 1e-9
"""Length of a row below which it is rounding."""

SLID = 20.0
"""Travel at a speed until memory is that of steady sliding, in lengths."""

HALF = np.append(0.0, np.geomspace(1e-4, 1.0, 60))
"""Positions of half a cycle, over its range."""

TURNED = 30
"""Positions after a turn at which friction is bounded."""

PEAK = 2.0
"""Greatest friction on the way from one direction to the other, over that of slow sliding."""

RANGES = 2.0 ** np.arange(-8.0, 3.0)
"""Ranges of cycles, over the greatest length of a law."""


def friction_curves(model: Model, fastest: Sequence[float] | Array) -> tuple[Row, ...]:
    """Rows by which friction along every coordinate takes energy.

    Args:
        model: The model.
        fastest: Greatest speed of each joint in the data, shape `(n,)` [rad/s; m/s]; joints that
            loops determine have none.
    """
    laws = [
        term
        for term in model.terms
        if isinstance(term, ActsOnAxes) and term.dissipation != "none" and not term.per_run
    ]
    rows: list[Row] = []
    for axis in dict.fromkeys(axis for law in laws for axis in law.axes(model.robot)):
        n = len(fastest)
        top = REACH * float(np.abs(axis.row[:n]) @ np.asarray(fastest))
        if any(axis.row[n:]) or not 0.0 < top < np.inf:
            continue
        mine = [law for law in laws if axis in law.axes(model.robot)]
        limits = np.array([c.limits.velocity for c in model.robot.coordinates])
        limit = float(np.abs(axis.row[:n]) @ np.where(axis.row[:n], limits[:n], 0.0))
        if any(law.dissipation == "together" for law in mine):
            rows += _rows(mine, model.robot, axis, top, max(top, _believed(limit, top)))
    return tuple(rows)


def shaped(model: Model, rows: Sequence[Row]) -> frozenset[str]:
    """Names of coefficients in rows that may be negative, as their curve is bounded."""
    bounded = {name for row in rows for name in row.coefficients}
    return frozenset(
        p.name
        for term in model.terms
        if term.dissipation == "together"
        for p in term.parameters(model.robot)
        if p.name in bounded
    )


def _believed(limit: float, top: float) -> float:
    """A limit of speed; zero if it is a mere placeholder."""
    return limit if limit <= FARTHEST * top / REACH else 0.0


def _rows(
    laws: Sequence[ActsOnAxes], robot: Robot, axis: Axis, top: float, farthest: float
) -> list[Row]:
    """The rows of one coordinate, each once.

    Args:
        laws: Those that act along it.
        robot: The robot.
        axis: The coordinate.
        top: Speed that the data reach, and a little more.
        farthest: Speed up to which friction takes energy.
    """
    grid = np.append(top * SPEEDS, [v for v in farthest * BEYOND if v > top])
    speeds = np.concatenate([grid, -grid])
    ranges = _ranges(laws, robot)
    names: list[str] = []
    columns: list[Array] = []
    for law in laws:
        at = [
            k for k, p in enumerate(law.parameters(robot)) if p.name.partition(".")[2] == axis.name
        ]
        names += [law.parameters(robot)[k].name for k in at]
        steady = _along(law, robot, axis, *_sliding(law, robot, speeds))[at]
        sliding = np.sign(speeds) * steady[:, 2::2]
        cycles = [
            _work(law, robot, axis, reach, top * v)[at]
            for reach in ranges
            for v in CYCLES
            if top * v <= 2.0 * reach * OFTEN
        ]
        turns = _turned(law, robot, axis, ranges, top * STILL)[at]
        parts = (sliding, np.array(cycles).T.reshape(len(at), -1), turns)
        columns += list(np.concatenate(parts, axis=1))
    matrix = np.array(columns).T
    sizes = np.linalg.norm(matrix, axis=1)
    kept = sizes > NOTHING
    unit = np.unique(np.round(matrix[kept] / sizes[kept, None], 9), axis=0)
    label = f"friction of '{axis.name}' up to {farthest:.3g} {axis.speed_unit}"
    return [
        Row(label, {n: float(x) for n, x in zip(names, row, strict=True) if x}, lower=0.0)
        for row in unit
    ]


def _ranges(laws: Sequence[ActsOnAxes], robot: Robot) -> list[float]:
    """Ranges of cycles, around the lengths of the laws that remember."""
    found: set[float] = set()
    for law in laws:
        if isinstance(law, Presliding):
            lengths = law.lengths_of(law.axes(robot))
            found |= {2.0 * length for length in lengths}
            found |= {float(max(lengths) * r) for r in RANGES}
    return sorted(found)


def _sliding(law: ActsOnAxes, robot: Robot, speeds: Array) -> tuple[Array, Array]:
    """A motion that slides at one speed after the other: position and speed at two samples each."""
    far = 1.0
    if isinstance(law, StatefulTerm):
        far = SLID * max(float(np.max(law.warm_up(robot))), 1e-9)
    v = np.concatenate([speeds[:1], np.repeat(speeds, 2)])
    steps = np.sign(v) * far
    steps[0] = 0.0
    return np.cumsum(steps), v


def _work(law: ActsOnAxes, robot: Robot, axis: Axis, reach: float, speed: float) -> Array:
    """Energy of a closed cycle over its length, per unit of each parameter."""
    half = reach * HALF[1:]
    once = np.concatenate([half, reach - half])
    x = np.concatenate([[0.0], np.tile(once, 3)])
    steps = np.diff(x, prepend=-reach)
    force = _along(law, robot, axis, x, np.sign(steps) * speed)
    last = slice(len(x) - len(once), None)
    if not isinstance(law, StatefulTerm):
        return np.asarray(force[:, last] @ steps[last] / (2.0 * reach))
    before = force[:, len(x) - len(once) - 1 : -1]
    return np.asarray(0.5 * (force[:, last] + before) @ steps[last] / (2.0 * reach))


def _turned(
    law: ActsOnAxes, robot: Robot, axis: Axis, ranges: Sequence[float], speed: float
) -> Array:
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


def _along(law: ActsOnAxes, robot: Robot, axis: Axis, x: Array, v: Array) -> Array:
    """Force of every parameter along a coordinate that alone moves, shape `(parameters, N)`."""
    row = np.array(axis.row)
    direction = row / (row @ row)
    q, dq = np.outer(direction, x), np.outer(direction, v)
    channels = np.empty((0, len(x)))
    if isinstance(law, StatefulTerm):
        samples = Samples(q, dq, np.zeros_like(q), lambda tens: np.zeros_like(q))
        channels, _ = law.remember(robot, samples, None)
    state = JointState(list(q), list(dq), [np.zeros_like(x)] * len(q), list(channels))
    force = np.zeros((len(law.parameters(robot)), len(x)))
    for (joint, parameter), column in law.columns(robot, state).items():
        force[parameter] += direction[joint] * column
    return force
