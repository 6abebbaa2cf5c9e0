r"""Friction takes energy as a whole: rows for a convex program, over a grid of speeds.

Along a coordinate all laws together give a curve $f(v)$ over speed. What physics requires of it is
$v f(v) \ge 0$, not that each coefficient be positive: friction that grows less than in proportion
to speed has a negative quadratic coefficient. The curve is linear in the coefficients, so a grid of
speeds gives rows of a convex program. Of laws that remember it is the energy of slow closed
cycles as well: whatever a hysteresis of elements that slip runs through decomposes into such cycles
[AlBender2005]. Nor may friction be a multiple of that of sliding on the way from one direction to
the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.prior.body_priors import Row
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Axis
from steelyard.model.terms.stateful_terms import LENGTHS_TO_FORGET, Presliding
from steelyard.model.terms.term import ActsOnAxes, StatefulTerm, TermSamples
from steelyard.robot.robot import Robot

REACH = 1.5  # speed up to which friction takes energy, over the greatest of the data
FARTHEST = 20.0  # limit of a joint's speed that is believed, over the greatest of the data
STILL = 1e-9  # speed that stands for one next to zero, over `REACH` times the greatest of the data

SPEEDS = np.concatenate([[STILL], np.geomspace(1e-4, 0.03, 6), np.linspace(0.05, 1.0, 20)])
"""Grid of speeds, over the same."""

UNREACHED_SPEEDS = np.linspace(0.1, 1.0, 10)  # of those beyond the data, over the joint's limit
CYCLES = (STILL, 0.01, 0.1, 1.0)  # speeds of cycles, over the same as `SPEEDS`
OFTEN = 50.0  # cycles per second that no arm exceeds [Hz]
NOTHING = 1e-9  # length of a row below which it is rounding

SLID = 20.0
"""Travel at a speed until memory is that of steady sliding, over that after which the start is
forgotten, and over the largest range of a cycle."""

HALF = np.append(0.0, np.geomspace(1e-4, 1.0, 60))  # positions of half a cycle, over its range
TURNED = 30  # positions after a turn at which friction is bounded
PEAK = 2.0  # greatest friction between two directions, over that of slow sliding
RANGES = 2.0 ** np.arange(-8.0, 3.0)  # ranges of cycles, over the greatest length of a law


@dataclass(frozen=True)
class Coordinate:
    """A coordinate whose friction is bounded as a whole, and the laws that act along it."""

    axis: Axis
    laws: tuple[ActsOnAxes, ...]
    top: float  # speed that the data reach, and a little more [rad/s; m/s]
    farthest: float  # speed up to which friction takes energy [rad/s; m/s]


def dissipation_rows(model: Model, fastest: Sequence[float] | Array) -> tuple[Row, ...]:
    """Rows by which friction takes energy up to the joints' greatest speeds in the data, `(n,)`."""
    laws = [
        term
        for term in model.terms
        if isinstance(term, ActsOnAxes) and term.dissipation != "none" and not term.per_run
    ]
    found = list(_coordinates(model, laws, np.asarray(fastest)))
    rows, robot = dict[Coordinate, list[Row]](), model.robot
    for group in _groups(found):
        cycles: set[float] = set()  # around the lengths of the laws that remember
        for law in group[0].laws:
            if isinstance(law, Presliding):
                lengths = law.lengths_of(law.axes(robot))
                cycles |= {2.0 * length for length in lengths}
                cycles |= {float(max(lengths) * r) for r in RANGES}
        ranges = sorted(cycles)
        axes, tops = [part.axis for part in group], np.array([part.top for part in group])
        works = [_works(law, robot, axes, tops, ranges) for law in group[0].laws]
        rows |= {part: _rows_of(part, robot, ranges, works) for part in group}
    return tuple(row for part in found for row in rows[part])


def _coordinates(model: Model, laws: Sequence[ActsOnAxes], fastest: Array) -> Iterator[Coordinate]:
    """The coordinates that move in the data, along which laws take energy together only."""
    n = len(fastest)
    limits = np.array([c.limits.velocity for c in model.robot.coordinates])
    for axis in dict.fromkeys(axis for law in laws for axis in law.axes(model.robot)):
        top = REACH * float(np.abs(axis.row[:n]) @ fastest)
        if any(axis.row[n:]) or not 0.0 < top < np.inf:
            continue
        mine = tuple(law for law in laws if axis in law.axes(model.robot))
        limit = float(np.abs(axis.row[:n]) @ np.where(axis.row[:n], limits[:n], 0.0))
        if any(law.dissipation == "together" for law in mine):
            # a limit that is much higher is a mere placeholder
            believed = limit if limit <= FARTHEST * top / REACH else 0.0
            yield Coordinate(axis, mine, top, max(top, believed))


def _groups(found: Sequence[Coordinate]) -> list[list[Coordinate]]:
    """Coordinates with the same laws and without a joint in common, which may move at once."""
    groups: list[list[Coordinate]] = []
    for part in found:
        joints = np.array(part.axis.row) != 0.0
        for group in groups:
            taken = np.any([other.axis.row for other in group], axis=0)
            if group[0].laws == part.laws and not np.any(joints & taken):
                group.append(part)
                break
        else:
            groups.append([part])
    return groups


def shaped(model: Model, rows: Sequence[Row]) -> frozenset[str]:
    """Names of coefficients in rows that may be negative, as their curve is bounded."""
    bounded = {name for row in rows for name in row.coefficients}
    names = model.names_where(lambda term: term.dissipation == "together")
    return frozenset(bounded.intersection(names))


def _rows_of(
    part: Coordinate, robot: Robot, ranges: Sequence[float], works: Sequence[Array]
) -> list[Row]:
    """The rows of one coordinate, each once, from energies of the cycles per law, see `_works`."""
    axis, top, farthest = part.axis, part.top, part.farthest
    grid = np.append(top * SPEEDS, [v for v in farthest * UNREACHED_SPEEDS if v > top])
    speeds = np.concatenate([grid, -grid])
    slow = np.array([top * v <= 2.0 * reach * OFTEN for reach in ranges for v in CYCLES], bool)
    names: list[str] = []
    columns: list[Array] = []
    for law, work in zip(part.laws, works, strict=True):
        at = [
            k for k, p in enumerate(law.parameters(robot)) if p.name.partition(".")[2] == axis.name
        ]
        names += [law.parameters(robot)[k].name for k in at]
        steady = _along(law, robot, [axis], *_sliding(law, robot, speeds))[at]
        sliding = np.sign(speeds) * steady[:, 2::2]
        turns = _turned(law, robot, axis, ranges, top * STILL)[at]
        columns += list(np.concatenate((sliding, work[at][:, slow], turns), axis=1))
    matrix = np.array(columns).T
    sizes = np.linalg.norm(matrix, axis=1)
    kept = sizes > NOTHING
    unit = np.unique(np.round(matrix[kept] / sizes[kept, None], 9), axis=0)
    label = f"friction of '{axis.name}' up to {farthest:.3g} {axis.speed_unit}"
    return [
        Row(label, {n: float(x) for n, x in zip(names, row, strict=True) if x}, lower=0.0)
        for row in unit
    ]


def _sliding(law: ActsOnAxes, robot: Robot, speeds: Array) -> tuple[Array, Array]:
    """A motion that slides at one speed after the other: position and speed at two samples each."""
    far = 1.0
    if isinstance(law, Presliding):
        far = SLID * (LENGTHS_TO_FORGET * max(law.lengths_of(law.axes(robot))))
    v = np.concatenate([speeds[:1], np.repeat(speeds, 2)])
    steps = np.sign(v) * far
    steps[0] = 0.0
    return np.cumsum(steps), v


def _works(
    law: ActsOnAxes, robot: Robot, axes: Sequence[Axis], tops: Array, ranges: Sequence[float]
) -> Array:
    """Energies of the last of three cycles over their lengths, per unit of each parameter of a law.

    The coordinates move at once, with the speeds `tops` that `CYCLES` refers to, `(axes,)`. Shape
    `(parameters, len(ranges) * len(CYCLES))`.
    """
    cycles = [(reach, v) for reach in ranges for v in CYCLES]
    if not cycles:
        return np.zeros((len(law.parameters(robot)), 0))
    there = np.concatenate([HALF[1:], 1.0 - HALF[1:]])
    once = np.concatenate([[0.0], np.tile(there, 3)])  # a closed cycle, three times over
    paths = [reach * once for reach, _ in cycles]
    steps = [np.diff(x, prepend=-x.max()) for x in paths]
    speeds = [np.sign(s) * (tops[:, None] * v) for s, (_, v) in zip(steps, cycles, strict=True)]
    remembers = isinstance(law, StatefulTerm)
    if remembers:
        forces = [_along(law, robot, axes, x, v) for x, v in zip(paths, speeds, strict=True)]
    else:
        every = _along(law, robot, axes, np.concatenate(paths), np.concatenate(speeds, axis=1))
        forces = np.split(every, len(cycles), axis=1)
    works = []
    for force, step in zip(forces, steps, strict=True):
        last = force[:, -len(there) :]
        if remembers:  # forces change within a step; they are constant along it otherwise
            last = 0.5 * (last + force[:, -len(there) - 1 : -1])
        works.append(last @ step[-len(there) :])
    return np.array(works).T / (2.0 * np.array([reach for reach, _ in cycles]))


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
    force = _along(law, robot, [axis], x, v)[:, 2:]
    sliding = PEAK * force[:, -1:]
    return np.concatenate([sliding - force[:, :-1], sliding + force[:, :-1]], axis=1)


def _along(law: ActsOnAxes, robot: Robot, axes: Sequence[Axis], x: Array, v: Array) -> Array:
    """Force of every parameter along coordinates without a joint in common, which alone move.

    Positions along each are of shape `(N,)`, speeds `(N,)` or `(axes, N)`; the force
    `(parameters, N)`.
    """
    directions = np.array([np.array(axis.row) / np.dot(axis.row, axis.row) for axis in axes])
    direction = directions.sum(axis=0)
    q, dq = np.outer(direction, x), directions.T @ np.broadcast_to(v, (len(axes), len(x)))
    channels = np.empty((0, len(x)))
    if isinstance(law, StatefulTerm):
        samples = TermSamples(q, dq, np.zeros_like(q), lambda tens: np.zeros_like(q))
        channels, _ = law.remember(robot, samples, None)
    state = JointState(list(q), list(dq), [np.zeros_like(x)] * len(q), list(channels))
    force = np.zeros((len(law.parameters(robot)), len(x)))
    for (joint, parameter), column in law.columns(robot, state).items():
        force[parameter] += direction[joint] * column
    return force
