"""What allows no motion is reported before a search, with the smallest change that would work."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.barrier import bounds
from steelyard.excitation.bases.families import posture_of
from steelyard.excitation.constraints.constraint import Constraint
from steelyard.excitation.limits import MotionLimits
from steelyard.excitation.problem import Problem
from steelyard.excitation.search.starts import Standing, nearest_free, postures, standing
from steelyard.excitation.search.widening import SIZE, lacking, names, rounded_up, widen
from steelyard.robot.robot import Robot
from steelyard.robot_file.loaded import LoadedRobot

LEAST_SWING = {"revolute": 2e-3, "prismatic": 5e-4}
"""Amplitude [rad; m] of the highest harmonic below which a series shows next to nothing."""

TIMES = ("period", "duration", "move", "blend", "ramp")
"""Keys of the motion's table that say how fast it is [s]."""

_ROOM = 1e-6
_SPARE = 0.02
_AROUND = np.repeat([0.05, 0.1, 0.2, 0.4, 0.8], 3)
_WHERE = "[excitation.motion]"


def refuse_impossible(problem: Problem, loaded: LoadedRobot) -> None:
    """Whatever can be seen to allow no motion.

    Args:
        problem: What is designed.
        loaded: The robot and its tables.

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
    """Times so short that the limits leave the highest frequency next to nothing."""
    robot, limits, highest = problem.robot, problem.limits, problem.basis.highest
    least = np.array([LEAST_SWING[joint.kind] for joint in robot.coordinates])
    rates = [limits.velocity / least, np.sqrt(limits.acceleration / least)]
    if limits.jerk is not None:
        rates.append(np.cbrt(limits.jerk / least))
    fastest = np.min(rates, axis=0) / (2.0 * np.pi)
    best = int(np.argmax(fastest))
    factor = highest / float(fastest[best])
    if factor <= 1.0:
        return
    joint = robot.coordinates[best]
    times = {key: getattr(section, key) for key in TIMES if hasattr(section, key)}
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
    """An end that the time does not allow to be gone to."""
    motion = problem.basis.motion(problem.basis.still(start))
    ratio = 0.0
    for order, (_, most) in enumerate(bounds(problem.limits)[1:], start=1):
        size = np.maximum(*np.abs(motion.extremes(order)))
        ratio = max(ratio, float(np.max(size / most)) ** (1.0 / order))
    if ratio >= 1.0:
        needed = ratio * motion.duration
        raise DataError(
            f"to get from the start to the end posture within the limits takes {needed:.3g} s, "
            f"the motion has {motion.duration:.3g} s",
            where=_WHERE,
            fix=f"give it more than {rounded_up(needed)} s, or closer postures",
        )


def _refuse_outside(robot: Robot, limits: MotionLimits, posture: Array, key: str) -> None:
    """A posture beyond the position limits, or on them."""
    for j, joint in enumerate(robot.coordinates):
        at, low, high = posture[j], limits.lower[j], limits.upper[j]
        room = _ROOM * (high - low)
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
            fix=f"give it between {_inside(low, high)} {joint.unit}{less}",
        )


def _inside(low: float, high: float) -> str:
    """Two numbers inside a range, rounded away from its ends."""
    digits = 3 - int(np.floor(np.log10(high - low)))
    step, room = 10.0**-digits, _ROOM * (high - low)
    least, most = np.ceil((low + room) / step) * step, np.floor((high - room) / step) * step
    return f"{least:.{max(digits, 0)}f} and {most:.{max(digits, 0)}f}"


def _refuse_lacking(
    limits: MotionLimits, constraints: Sequence[Constraint], posture: Array, key: str
) -> None:
    """A posture at which something touches, or is outside its box."""
    here = standing(constraints, posture)
    if not here.lacks:
        return
    near = _near(limits, constraints, posture)
    fix = "choose another posture"
    if near is not None:
        fix = f"nearby, {_listed(near)} satisfies all constraints"
    raise DataError(
        f"the {key} posture violates: {lacks_text(here)}", where=f"{_WHERE} {key}", fix=fix
    )


def _refuse_nowhere(problem: Problem) -> None:
    """Constraints that no posture keeps."""
    limits, constraints = problem.limits, problem.constraints
    if not constraints:
        return
    best: Standing | None = None
    for place in postures(limits, constraints, np.random.default_rng(0)):
        if not place.lacks:
            return
        if best is None or place.lacks[0][2] > best.lacks[0][2]:
            best = place
    assert best is not None
    lacks = lacking(problem, [best.posture])
    raise DataError(
        "no posture was found that satisfies all constraints; "
        f"the nearest violates: {lacks_text(best)}",
        where=f"[excitation] {names(lacks)}",
        fix=f"{widen(lacks)}: this allows a motion of {SIZE:.0%} of the joints' ranges about it",
    )


def lacks_text(place: Standing) -> str:
    """The constraints that a posture violates, as text."""
    return "; ".join(
        f"{label} (violated by {-value:.3g} {constraint.unit})"
        for constraint, label, value in place.lacks[:4]
    )


def _near(limits: MotionLimits, constraints: Sequence[Constraint], bad: Array) -> Array | None:
    """The nearest posture found that keeps everything, in shares of the joints' ranges."""
    random, half = np.random.default_rng(0), 0.5 * (limits.upper - limits.lower)
    found: list[Array] = []
    for size in (0.0, *_AROUND):
        begin = bad + size * half * random.uniform(-1.0, 1.0, len(bad))
        inside = np.clip(begin, limits.lower + 0.05 * half, limits.upper - 0.05 * half)
        free = nearest_free(limits, constraints, inside)
        if not free.lacks:
            found.append(_between(constraints, bad, free.posture))
    return min(found, key=lambda q: float(np.linalg.norm((q - bad) / half)), default=None)


def _between(constraints: Sequence[Constraint], bad: Array, free: Array) -> Array:
    """The posture nearest to the bad one on the way to the free one."""
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        if standing(constraints, bad + middle * (free - bad)).lacks:
            low = middle
        else:
            high = middle
    tried = np.round(bad + min(1.0, high + _SPARE) * (free - bad), 3)
    return free if standing(constraints, tried).lacks else tried


def _listed(posture: Array) -> str:
    return "[" + ", ".join(f"{x:.3f}" for x in posture) + "]"
