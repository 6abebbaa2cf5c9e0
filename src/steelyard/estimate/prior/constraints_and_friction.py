r"""Priors and constraints of a robot file; friction that takes energy as a whole.

Along a coordinate all laws together give a curve $f(v)$ over speed. What physics requires of it is
$v f(v) \ge 0$, not that each coefficient be positive: friction that grows less than in proportion
to speed has a negative quadratic coefficient. The curve is linear in the coefficients, so a grid of
speeds gives rows of a convex program. Of laws that remember it is the energy of slow closed
cycles as well: whatever a hysteresis of elements that slip runs through decomposes into such cycles
[AlBender2005]. Nor may friction be a multiple of that of sliding on the way from one direction to
the other.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import ClassVar, NoReturn, Protocol

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError, advice
from steelyard.estimate.prior.body_priors import (
    Knowledge,
    PriorBody,
    Row,
    assumed_body,
    assumed_mass,
    box,
    capsule,
    corrected_body,
    knowledge_with,
    model_prior,
    rigid_bodies,
)
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.model import Model
from steelyard.model.terms.axes import Axis
from steelyard.model.terms.friction_memory import LENGTHS_TO_FORGET, Presliding
from steelyard.model.terms.term import ActsOnAxes, StatefulTerm, TermSamples
from steelyard.robot.file.effort_units_and_gears import Locate
from steelyard.robot.file.sections import LinkPriorSection, PriorSection
from steelyard.robot.inertia_and_placement import Inertia, symmetric
from steelyard.robot.robot import Robot


def given_knowledge(model: Model, section: PriorSection, where: Locate) -> Knowledge:
    """What model file and section `[prior]` say: bodies, and bounds of the terms' parameters."""
    bodies = rigid_bodies(model)
    for name in section.links:
        body_index(model.robot, name, where("prior", "links", name))
    corrected = {
        body.name: one
        for k, body in bodies.items()
        if (one := _prior(model.robot, k, section, where)) is not None
    }
    return replace(knowledge_with(model, corrected), uncertainty=section.uncertainty)


def body_index(robot: Robot, name: str, where: str) -> int:
    """Which moving body a link's name means; a `ModelError` says which one carries a fixed link."""
    names = [body.name for body in robot.bodies]
    if name in names and not robot.bodies[names.index(name)].massless:
        return names.index(name)
    carrier = next((f.body for f in robot.frames if f.name == name), None)
    if name in names:
        wrong = f"link '{name}' is a frame between two joints of one body, and has no mass"
        fix = "name the body itself"
    elif carrier is None:
        wrong, fix = f"the robot has no moving link '{name}'", advice(name, names, "moving links")
    elif carrier < 0:
        wrong, fix = f"link '{name}' does not move", advice(name, names, "moving links")
    else:
        wrong = f"link '{name}' moves with link '{names[carrier]}', whose numbers include it"
        fix = f"name '{names[carrier]}', and give the properties of both together in its frame"
    raise ModelError(wrong, where=where, fix=fix)


def _prior(robot: Robot, index: int, section: PriorSection, where: Locate) -> PriorBody | None:
    body = robot.bodies[index]
    given = section.links.get(body.name, LinkPriorSection(source=section.source))
    _refuse_unclear(body.name, given, where("prior", "links", body.name))
    if given.source == "none":
        return None
    if given.model_fields_set <= {"source"}:
        return model_prior(robot, index)
    known = body.known and body.inertia.mass > 0.0
    guess = body.inertia.mass if known else assumed_mass(robot)
    mass = guess if given.mass is None else given.mass
    if given.box is not None:
        solid = box(mass, given.box.centre, given.box.size)
    elif given.capsule is not None:
        solid = capsule(mass, given.capsule.start, given.capsule.end, given.capsule.radius)
    else:  # what the table leaves out is the model's, scaled to the mass
        scaled = Inertia.from_ten(body.inertia.ten * (mass / guess)) if known else None
        model = assumed_body(robot, index, mass) if scaled is None else scaled
        com, six = model.com if given.com is None else given.com, given.inertia_com
        around = model.inertia_com if six is None else symmetric(six)
        solid = Inertia.about_com(mass, com, around)
    corrected = corrected_body(solid)
    if given.mass is not None or known:
        return corrected
    reason = f"its mass is not known; {mass:.3g} kg are assumed"
    return replace(corrected, why=f"{reason}; {corrected.why}" if corrected.why else reason)


def _refuse_unclear(name: str, given: LinkPriorSection, where: str) -> None:
    shapes = [key for key in ("box", "capsule") if getattr(given, key) is not None]
    points = [key for key in ("com", "inertia_com") if getattr(given, key) is not None]
    if not given.model_fields_set:
        wrong = ""
        fix = 'give mass = ..., a box, a capsule, or com and inertia_com; or source = "none"'
    elif given.source == "none" and len(given.model_fields_set) > 1:
        wrong = " is none, but properties are given"
        fix = 'leave out source = "none", or the other keys'
    elif len(shapes) == 2 or (shapes and points):
        one, other, *_ = (*shapes, *points)
        wrong = f" has {one} and {other} at once"
        fix = "keep one of them: a box, a capsule, or com and inertia_com"
    else:
        return
    raise ModelError(f"the prior of link '{name}'{wrong}", where=where, fix=fix)


@dataclass(frozen=True, eq=False)
class ConstraintContext:
    """A model's parameters and a constraint's place; what is not there is a `ModelError`."""

    model: Model
    where: str

    def body(self, name: str) -> str:
        """The name, if a moving link with parameters has it."""
        body_index(self.model.robot, name, self.where)
        if not rigid_bodies(self.model):
            self.refuse(
                f"the model has no mass properties of link '{name}'",
                'add "rigid_body" to the terms, or remove the constraint',
            )
        return name

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all moving links."""
        return tuple(body.name for body in rigid_bodies(self.model).values())

    def parameters(self, pattern: str) -> tuple[str, ...]:
        """Parameters that a name means; `*` in it stands for anything."""
        found = tuple(n for n in self.model.names if n == pattern or fnmatchcase(n, pattern))
        if not found:
            fix = advice(pattern, self.model.names, "parameters")
            self.refuse(f"the model has no parameter '{pattern}'", fix)
        return found

    def parameter(self, name: str) -> str:
        """The name, if a parameter has it."""
        if name not in self.model.names:
            fix = advice(name, self.model.names, "parameters")
            self.refuse(f"the model has no parameter '{name}'", fix)
        return name

    def refuse(self, wrong: str, fix: str) -> NoReturn:
        """Refuse this constraint."""
        raise ModelError(wrong, where=self.where, fix=fix)

    def row(
        self, label: str, coefficients: Mapping[str, float], interval: "Interval | float"
    ) -> Row:
        """A row with the constraint in words, and its place in the file."""
        low, high = (interval, interval) if isinstance(interval, float) else interval
        return Row(f"{label} ({self.where})", coefficients, low, high)


Interval = tuple[float, float]  # lower and upper bound


class PriorConstraint(Protocol):
    """One kind of knowledge, with what a table of the robot file says of it."""

    kind: ClassVar[str]

    def rows(self, scope: ConstraintContext) -> list[Row]:
        """The constraint over a model's standard parameters, if that has them."""


@dataclass(frozen=True, kw_only=True)
class Bounded:
    """A quantity that is known, or lies between bounds.

    Attributes:
        lower: Least value; none if `None`.
        upper: Greatest value; none if `None`.
        value: The value itself, instead of bounds.
    """

    lower: float | None = None
    upper: float | None = None
    value: float | None = None

    def interval(self, scope: ConstraintContext) -> Interval:
        """Lower and upper bound, in this order; or one value, not beside bounds."""
        bounds = self.lower is not None or self.upper is not None
        if bounds == (self.value is not None):
            scope.refuse(
                "a value and bounds are given" if bounds else "neither value nor bounds are given",
                "give value = ..., or lower = ... and upper = ..., or one of these",
            )
        if self.value is not None:
            return self.value, self.value
        low = -np.inf if self.lower is None else self.lower
        high = np.inf if self.upper is None else self.upper
        if low > high:
            scope.refuse(
                f"the lower bound {low:g} is above the upper bound {high:g}", "exchange them"
            )
        return low, high


def in_words(interval: Interval, unit: str = "") -> str:
    """A bound as people say it: `at least 3 kg`, `between 3 and 5 kg`, `3 kg`."""
    low, high = interval
    if low == high:
        text = f"{low:g}"
    elif not np.isfinite(high):
        text = f"at least {low:g}"
    elif not np.isfinite(low):
        text = f"at most {high:g}"
    else:
        text = f"between {low:g} and {high:g}"
    return f"{text} {unit}".rstrip()


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


def friction_curves(model: Model, fastest: Sequence[float] | Array) -> tuple[Row, ...]:
    """Rows by which friction takes energy up to the joints' greatest speeds in the data, `(n,)`."""
    laws = [
        term
        for term in model.terms
        if isinstance(term, ActsOnAxes) and term.dissipation != "none" and not term.per_run
    ]
    found = list(_coordinates(model, laws, np.asarray(fastest)))
    rows, robot = dict[Coordinate, list[Row]](), model.robot
    for group in _groups(found):
        ranges = _ranges(group[0].laws, robot)
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
    if isinstance(law, Presliding):
        far = SLID * (LENGTHS_TO_FORGET * max(law.lengths_of(law.axes(robot))))
    v = np.concatenate([speeds[:1], np.repeat(speeds, 2)])
    steps = np.sign(v) * far
    steps[0] = 0.0
    return np.cumsum(steps), v


def _works(
    law: ActsOnAxes, robot: Robot, axes: Sequence[Axis], tops: Array, ranges: Sequence[float]
) -> Array:
    """Energies of closed cycles over their lengths, per unit of each parameter of a law.

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
    works = [_work(f, s, remembers) for f, s in zip(forces, steps, strict=True)]
    return np.array(works).T / (2.0 * np.array([reach for reach, _ in cycles]))


def _work(force: Array, steps: Array, remembers: bool) -> Array:
    """Energy of the last of three cycles, per unit of each parameter.

    Forces are of shape `(parameters, N)`, steps of the position up to each sample `(N,)`. Of a law
    that remembers forces change within a step; they are constant along it otherwise.
    """
    once = 2 * (len(HALF) - 1)
    last = force[:, -once:]
    if remembers:
        last = 0.5 * (last + force[:, -once - 1 : -1])
    return np.asarray(last @ steps[-once:])


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
