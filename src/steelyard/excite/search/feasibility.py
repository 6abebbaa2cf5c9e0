"""Feasible postures, random motions about them to start from, and why no motion was found."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint_and_limits import Constraint, MotionLimits
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.search.margins_barrier_and_newton import InequalityConstraints
from steelyard.excite.trajectories.exact_trajectories import stretch_within
from steelyard.excite.trajectories.motion_families import posture_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.robot import Robot

POSTURE_ATTEMPTS = 60  # random postures among which a free one is sought before none is reported

_MIDDLE_SHARE = 0.4
_EDGE_SHARE = 0.95
_FREE_ROOM_SHARE = 0.8
_SIZE_SHRINK = 0.7
_POWERS = 20  # times that a motion is shrunk before it is next to nothing, a thousandth
_WANTED_MARGIN = 0.05
_POSTURES = 30
_DRAWN_POSTURES = 180


class NoMotion(DataError):
    """No motion was found that keeps everything."""


class Lack(NamedTuple):
    """A margin of a constraint that is not positive."""

    constraint: Constraint
    label: str
    value: float

    def __str__(self) -> str:
        return f"{self.label} (violated by {-self.value:.3g} {self.constraint.unit})"


def lacks_at(constraints: Sequence[Constraint], posture: Array) -> tuple[Lack, ...]:
    """What standing still at a posture, `(n,)`, lacks, worst first."""
    still = np.zeros((1, len(posture)))
    lacks = _lacks(constraints, (posture[None], still, still))
    return tuple(sorted(lacks, key=lambda lack: lack.value))


def _lacks(constraints: Sequence[Constraint], state: tuple[Array, Array, Array]) -> list[Lack]:
    """Least margins at positions, speeds and accelerations, `(N, n)` each, if not positive."""
    found = []
    for constraint in constraints:
        least = constraint.margins(*state).values.min(axis=0)
        short = zip(constraint.labels, least, strict=True)
        found += [Lack(constraint, label, float(v)) for label, v in short if not v > 0.0]
    return found


def nearest_free(limits: MotionLimits, constraints: Sequence[Constraint], posture: Array) -> Array:
    """Where a descent of what is lacking ends that begins at a posture."""
    from scipy.optimize import minimize

    if not lacks_at(constraints, posture):
        return posture
    edge = (1.0 - _EDGE_SHARE) * 0.5 * (limits.upper - limits.lower)
    bounds = list(zip(limits.lower + edge, limits.upper - edge, strict=True))
    still = np.zeros((1, len(posture)))

    def lack(q: Array) -> tuple[float, Array]:
        value, slope = 0.0, np.zeros(len(q))
        for constraint in constraints:
            margins = constraint.margins(q[None], still, still)
            short = np.minimum(
                margins.values[0] / constraint.activation_distance - _WANTED_MARGIN, 0.0
            )
            value += float(short @ short)
            if margins.by_q is not None:
                slope += 2.0 * (short / constraint.activation_distance) @ margins.by_q[0]
        return value, slope

    found = minimize(lack, posture, jac=True, method="L-BFGS-B", bounds=bounds)
    return np.asarray(found.x)


def postures(
    limits: MotionLimits,
    constraints: Sequence[Constraint],
    random: np.random.Generator,
    attempts: int = POSTURE_ATTEMPTS,
) -> Iterator[Array]:
    """Postures that descents from random ones end at; the first half of them in the middle."""
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    for attempt in range(attempts):
        share = _MIDDLE_SHARE if attempt < attempts // 2 else _EDGE_SHARE
        yield nearest_free(
            limits, constraints, middle + share * half * random.uniform(-1.0, 1.0, len(middle))
        )


def each_start(
    inequalities: InequalityConstraints,
    random: np.random.Generator,
    count: int,
    limbs: Sequence[Sequence[int]] = (),
) -> Iterator[Array]:
    """Motions about random postures, as large as the constraints allow but for a fifth.

    As many as `count`, if so many postures are free; some of them, but one at least, if not. Limbs
    are joints that are given as much room as there is one after the other, in random order.
    """
    found = 0
    for posture in _free(inequalities, random, count):
        still = inequalities.basis.still(posture)
        if inequalities.smallest_margin(still) > 0.0:
            moved = _widened_in_turn(inequalities, still, random, limbs)
            if moved is not None:
                found += 1
                yield moved
        if found == count:
            return
    if not found:
        raise NoMotion(
            f"no motion about any of {count + _POSTURES} random postures keeps all limits and "
            "constraints",
            where="[excitation]",
            fix="widen the limits or the boxes, or give a start posture farther from the limits",
        )


def _free(
    inequalities: InequalityConstraints, random: np.random.Generator, count: int
) -> Iterator[Array]:
    """Random postures that are free, and where too few are, ends of descents from others."""
    limits = inequalities.limits
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    drawn = middle + _MIDDLE_SHARE * half * random.uniform(
        -1.0, 1.0, (max(3 * count, _DRAWN_POSTURES), len(middle))
    )
    still, free = np.zeros_like(drawn), np.ones(len(drawn), dtype=bool)
    for constraint in inequalities.constraints:
        free &= (constraint.margins(drawn, still, still).values > 0.0).all(axis=1)
    yield from drawn[free]
    if free.sum() < count:
        yield from postures(limits, inequalities.constraints, random, _POSTURES)


def _widened_in_turn(
    inequalities: InequalityConstraints,
    still: Array,
    random: np.random.Generator,
    limbs: Sequence[Sequence[int]],
) -> Array | None:
    """A random change of standing still, as much of it as the constraints allow each limb."""
    change = random.standard_normal(still.shape)
    if len(limbs) < 2:
        return widened(inequalities, still, change)
    moved, any_ = still, False
    for number in random.permutation(len(limbs)):
        part, joints = np.zeros_like(change), list(limbs[number])
        part[joints] = change[joints]
        wider = widened(inequalities, moved, part)
        if wider is not None:
            moved, any_ = wider, True
    return moved if any_ else None


def widened(inequalities: InequalityConstraints, still: Array, change: Array) -> Array | None:
    """Standing still plus as much of a change as the constraints allow; `None` if hardly any."""
    sized = _FREE_ROOM_SHARE * inequalities.room(still, change)[:, None] * change
    # the power of the shrinking at which the motion comes inside, by halving their range
    low, high = 0, _POWERS
    while low < high:
        middle = (low + high) // 2
        moved = still + _SIZE_SHRINK**middle * sized
        inside = inequalities.coarser.smallest_margin(moved) > 0.0
        low, high = (low, middle) if inside else (middle + 1, high)
    for power in range(low, _POWERS):
        moved = still + _SIZE_SHRINK**power * sized
        if inequalities.smallest_margin(moved) > 0.0:
            return np.asarray(moved)
    return None


WORTHY_MOTION_SIZE = 0.1  # size of a small motion, over the largest that the joints' limits allow

_WIDENING_POSTURES = 12
_WIDENING_TRIES = 4
_WIDENING_FACTOR = 1.05


def lacking(problem: Problem, places: Iterable[Array]) -> tuple[Lack, ...]:
    """What a small motion about one of `places`, `(n,)` each, lacks that lacks the least.

    A witness: with everything widened by that much, it is a motion that keeps all samples.
    """
    room, random = problem.inequalities.room, np.random.default_rng(0)
    tries = []
    for still in map(problem.basis.still, places):
        for _ in range(_WIDENING_TRIES):
            change = random.standard_normal(still.shape)
            x = still + WORTHY_MOTION_SIZE * room(still, change)[:, None] * change
            lacks = _lacks(problem.constraints, problem.inequalities.state(x))
            tries.append([lack for lack in lacks if lack.value < 0.0])
    fewest = min(tries, key=lambda lacks: sum(map(_share_of_room, lacks)), default=[])
    return tuple(sorted(fewest, key=lambda lack: -_share_of_room(lack)))


def explained_no_motion(problem: Problem, error: NoMotion) -> DataError:
    """An error that no motion was found, with what would have to be widened if that is known."""
    random = np.random.default_rng(0)
    drawn = postures(problem.limits, problem.constraints, random, _WIDENING_POSTURES)
    lacks = lacking(problem, drawn)
    if not lacks:
        return error
    return DataError(
        f"{error.wrong}; a motion of {WORTHY_MOTION_SIZE:.0%} of the joints' ranges violates: "
        + "; ".join(str(lack) for lack in lacks[:4]),
        where="[excitation] " + constraint_names(lacks),
        fix=widening_advice(lacks),
    )


def constraint_names(lacks: Sequence[Lack]) -> str:
    """Names of the constraints."""
    return " and ".join(dict.fromkeys(lack.constraint.name for lack in lacks))


def widening_advice(lacks: Sequence[Lack]) -> str:
    """What would be enough."""
    widened = " and ".join(
        f"'{x.label}' by {rounded_up(-_WIDENING_FACTOR * x.value)} {x.constraint.unit}"
        for x in lacks
    )
    return f"widen {widened}, or more"


def rounded_up(value: float) -> str:
    """Three digits, rounded upwards."""
    digits = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return f"{np.ceil(value / digits) * digits:.3g}"


def _share_of_room(lack: Lack) -> float:
    """How much is lacking, over the activation distance."""
    constraint = lack.constraint
    return -lack.value / float(constraint.activation_distance[constraint.labels.index(lack.label)])


LEAST_SWING = {"revolute": 2e-3, "prismatic": 5e-4}
"""Amplitude [rad; m] of the highest harmonic below which a series shows next to nothing."""

TIME_KEYS = ("period", "duration", "move", "blend", "ramp")  # that say how fast it is [s]

_RANGE_ROOM = 1e-6
_SPARE_SHARE = 0.02
_SEARCH_RADII = np.repeat([0.05, 0.1, 0.2, 0.4, 0.8], 3)
_WHERE = "[excitation.motion]"


def refuse_impossible(problem: Problem, loaded: LoadedRobot) -> None:
    """Refuse what can be seen to allow no motion.

    Raises:
        DataError: Says what is impossible, by how much, and the smallest change that would work.
    """
    section, robot, limits = loaded.excitation.motion, problem.robot, problem.limits
    _refuse_short(problem, section)
    ends = [posture_of(getattr(section, key, None), robot, key) for key in ("start", "end")]
    for key, posture in zip(("start", "end"), ends, strict=True):
        if posture is not None:
            _refuse_outside(robot, limits, posture, key)
            _refuse_lacking(limits, problem.constraints, posture, key)
    start, end = ends
    if start is not None and end is not None:
        _refuse_far(problem, start)
    if start is None:
        _refuse_nowhere(problem)


def _refuse_short(problem: Problem, section: Any) -> None:
    robot, highest = problem.robot, problem.basis.highest
    least = np.array([LEAST_SWING[joint.kind] for joint in robot.coordinates])
    sides = enumerate(problem.limits.greatest, start=1)
    rates = [(most / least) ** (1.0 / order) for order, most in sides]
    fastest = np.min(rates, axis=0) / (2.0 * np.pi)
    best = int(np.argmax(fastest))
    factor = highest / float(fastest[best])
    if factor <= 1.0:
        return
    joint = robot.coordinates[best]
    times = {key: getattr(section, key) for key in TIME_KEYS if hasattr(section, key)}
    waves = getattr(section, "harmonics", 0)
    if "blend" in times:
        own = {"period": waves / section.period, "blend": 1.0 / section.blend}
        times = {key: t for key, t in times.items() if own[key] > fastest[best]}
    longer = " and ".join(f"{key} = {rounded_up(factor * t)}" for key, t in times.items())
    fewer = int(waves / factor)
    other = f", or no more than {fewer} harmonics" if fewer >= 2 and "ramp" not in times else ""
    what = f"{waves} harmonics" if "period" in times else "the motion"
    raise DataError(
        f"{' and '.join(f'a {key} of {t:g} s' for key, t in times.items())} is too short for "
        f"{what}: at {highest:.3g} Hz no joint can move by even {least[best]:g} {joint.unit} "
        "within its limits",
        where=_WHERE,
        fix=f"give {longer} s or more{other}",
    )


def _refuse_far(problem: Problem, start: Array) -> None:
    motion = problem.basis.motion(problem.basis.still(start))
    ratio, _, _ = stretch_within(motion, problem.limits.greatest)
    if ratio >= 1.0:
        needed = ratio * motion.duration
        raise DataError(
            f"to get from the start to the end posture within the limits takes {needed:.3g} s, "
            f"the motion has {motion.duration:.3g} s",
            where=_WHERE,
            fix=f"give it more than {rounded_up(needed)} s, or closer postures",
        )


def _refuse_outside(robot: Robot, limits: MotionLimits, posture: Array, key: str) -> None:
    for j, joint in enumerate(robot.coordinates):
        at, low, high = posture[j], limits.lower[j], limits.upper[j]
        room = _RANGE_ROOM * (high - low)
        if low + room <= at <= high - room:
            continue
        beyond = max(low - at, at - high)
        side = "below its lower" if at < 0.5 * (low + high) else "above its upper"
        limit = low if at < 0.5 * (low + high) else high
        how = f"is {beyond:.3g} {joint.unit} {side}" if beyond > 0.0 else "is on its"
        inside = joint.limits.lower < at < joint.limits.upper
        less = ", or less margin in [excitation.limits] position_margin" if inside else ""
        raise DataError(
            f"the {key} posture has joint '{joint.name}' at {at:.4g} {joint.unit}: this {how} "
            f"limit of {limit:.4g} {joint.unit} (with the position margin)",
            where=f"{_WHERE} {key}",
            fix=f"give it between {_range_text(low, high)} {joint.unit}{less}",
        )


def _range_text(low: float, high: float) -> str:
    """Two numbers inside a range, rounded away from its ends."""
    digits = 3 - int(np.floor(np.log10(high - low)))
    step, room = 10.0**-digits, _RANGE_ROOM * (high - low)
    least, most = np.ceil((low + room) / step) * step, np.floor((high - room) / step) * step
    return f"{least:.{max(digits, 0)}f} and {most:.{max(digits, 0)}f}"


def _refuse_lacking(
    limits: MotionLimits, constraints: Sequence[Constraint], posture: Array, key: str
) -> None:
    here = lacks_at(constraints, posture)
    if not here:
        return
    near = _nearest_posture(limits, constraints, posture)
    fix = "choose another posture"
    if near is not None:
        places = ", ".join(f"{x:.3f}" for x in near)
        fix = f"nearby, [{places}] satisfies all constraints"
    lacks = "; ".join(str(lack) for lack in here[:4])
    raise DataError(f"the {key} posture violates: {lacks}", where=f"{_WHERE} {key}", fix=fix)


def _refuse_nowhere(problem: Problem) -> None:
    limits, constraints = problem.limits, problem.constraints
    if not constraints:
        return
    tries = list[tuple[tuple[Lack, ...], Array]]()
    for place in postures(limits, constraints, np.random.default_rng(0)):
        tries.append((lacks_at(constraints, place), place))
        if not tries[-1][0]:
            return
    fewest, nearest = max(tries, key=lambda one: one[0][0].value)
    lacks = lacking(problem, [nearest])
    raise DataError(
        "no posture was found that satisfies all constraints; the nearest violates: "
        + "; ".join(str(lack) for lack in fewest[:4]),
        where=f"[excitation] {constraint_names(lacks)}",
        fix=f"{widening_advice(lacks)}: this allows a motion of {WORTHY_MOTION_SIZE:.0%} of the "
        "joints' ranges about it",
    )


def _nearest_posture(
    limits: MotionLimits, constraints: Sequence[Constraint], bad: Array
) -> Array | None:
    """The nearest posture found that keeps everything, in shares of the joints' ranges."""
    random, half = np.random.default_rng(0), 0.5 * (limits.upper - limits.lower)
    found: list[Array] = []
    for size in (0.0, *_SEARCH_RADII):
        begin = bad + size * half * random.uniform(-1.0, 1.0, len(bad))
        inside = np.clip(begin, limits.lower + 0.05 * half, limits.upper - 0.05 * half)
        free = nearest_free(limits, constraints, inside)
        if not lacks_at(constraints, free):
            found.append(_posture_between(constraints, bad, free))
    return min(found, key=lambda q: float(np.linalg.norm((q - bad) / half)), default=None)


def _posture_between(constraints: Sequence[Constraint], bad: Array, free: Array) -> Array:
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        lacks = lacks_at(constraints, bad + middle * (free - bad))
        low, high = (middle, high) if lacks else (low, middle)
    tried = np.round(bad + min(1.0, high + _SPARE_SHARE) * (free - bad), 3)
    return free if lacks_at(constraints, tried) else tried
