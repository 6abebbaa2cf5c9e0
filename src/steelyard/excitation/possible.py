"""What allows no motion is said before a search, with the smallest change that would work."""

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.constraint import Constraint
from steelyard.excitation.families import posture_of
from steelyard.excitation.limits import MotionLimits
from steelyard.excitation.minimum_jerk import reach_seconds
from steelyard.excitation.problem import Problem
from steelyard.excitation.starts import Standing, nearest_free, postures, standing
from steelyard.robot.robot import Robot
from steelyard.robot.robot_file import LoadedRobot

LEAST_SWING = {"revolute": 2e-3, "prismatic": 5e-4}
"""Amplitude [rad; m] of the highest harmonic below which a series shows next to nothing."""

_ROOM = 1e-6
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
    harmonics = getattr(section, "harmonics", None)
    if harmonics is not None:
        _refuse_short(robot, limits, getattr(section, "period", 0.0), harmonics)
    ends = [posture_of(getattr(section, key, None), robot, key) for key in ("start", "end")]
    for key, posture in zip(("start", "end"), ends, strict=True):
        if posture is not None:
            _refuse_outside(robot, limits, posture, key)
            _refuse_lacking(limits, problem.constraints, posture, key)
    start, end = ends
    if start is not None and end is not None:
        needed = reach_seconds(end - start, limits.velocity, limits.acceleration)
        if needed > problem.basis.duration:
            raise DataError(
                f"to get from the start to the end posture within the limits takes {needed:.3g} s, "
                f"the motion has {problem.basis.duration:.3g} s",
                where=_WHERE,
                mend=f"give it more than {_up(needed)} s, or postures that are nearer",
            )
    if start is None:
        _refuse_nowhere(limits, problem.constraints)


def _refuse_short(robot: Robot, limits: MotionLimits, period: float, harmonics: int) -> None:
    """A period so short that accelerations leave the highest harmonic next to nothing."""
    least = np.array([LEAST_SWING[joint.kind] for joint in robot.coordinates])

    def enough(rate: float) -> bool:
        swing = np.minimum(limits.velocity / rate, limits.acceleration / rate**2)
        return bool(np.any(swing >= least))

    if enough(2.0 * np.pi * harmonics / period):
        return
    fastest = float(
        np.max(np.minimum(limits.velocity / least, np.sqrt(limits.acceleration / least)))
    )
    longer = _up(2.0 * np.pi * harmonics / fastest)
    fewer = int(fastest * period / (2.0 * np.pi))
    other = f", or no more than {fewer} harmonics" if fewer >= 2 else ""
    raise DataError(
        f"a period of {period:g} s is too short for {harmonics} harmonics: at "
        f"{harmonics / period:.3g} Hz no joint may swing by even "
        f"{1e3 * least.min():.2g} mrad within its limits",
        where=f"{_WHERE} period",
        mend=f"give a period of {longer} s or more{other}",
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
        raise DataError(
            f"the {key} posture has joint '{joint.name}' at {at:.4g} {joint.unit}: that {how} "
            f"limit of {limit:.4g} {joint.unit}, which keeps the position margin",
            where=f"{_WHERE} {key}",
            mend=f"give it between {low + room:.4g} and {high - room:.4g} {joint.unit}, or less "
            "margin in [excitation.limits] position_margin",
        )


def _refuse_lacking(
    limits: MotionLimits, constraints: Sequence[Constraint], posture: Array, key: str
) -> None:
    """A posture at which something touches, or is outside its box."""
    here = standing(constraints, posture)
    if not here.lacks:
        return
    near = nearest_free(limits, constraints, posture)
    mend = "choose another posture"
    if not near.lacks:
        near = _between(constraints, posture, near)
        mend = f"near by, {_listed(near.posture)} keeps everything"
    raise DataError(
        f"the {key} posture does not keep: {told(here)}", where=f"{_WHERE} {key}", mend=mend
    )


def _refuse_nowhere(limits: MotionLimits, constraints: Sequence[Constraint]) -> None:
    """Constraints that no posture keeps."""
    if not constraints:
        return
    best: Standing | None = None
    for place in postures(limits, constraints, np.random.default_rng(0)):
        if not place.lacks:
            return
        if best is None or place.lacks[0][2] > best.lacks[0][2]:
            best = place
    assert best is not None
    raise DataError(
        f"no posture was found that keeps all constraints; the nearest lacks: {told(best)}",
        where="[excitation] " + " and ".join(dict.fromkeys(c.name for c, _, _ in best.lacks)),
        mend="widen "
        + " and ".join(
            f"'{label}' by {_up(1.02 * -value)} {constraint.unit} or more"
            for constraint, label, value in best.lacks
        )
        + ", with some room to move on top",
    )


def told(place: Standing) -> str:
    """What a posture lacks, in words."""
    return "; ".join(
        f"{label} (missed by {-value:.3g} {constraint.unit})"
        for constraint, label, value in place.lacks[:4]
    )


def _between(constraints: Sequence[Constraint], bad: Array, free: Standing) -> Standing:
    """The posture nearest to the bad one on the way to the free one."""
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        if standing(constraints, bad + middle * (free.posture - bad)).lacks:
            low = middle
        else:
            high = middle
    share = min(1.0, high + 0.02)
    tried = standing(constraints, bad + share * (free.posture - bad))
    return free if tried.lacks else tried


def _listed(posture: Array) -> str:
    return "[" + ", ".join(f"{x:.3f}" for x in posture) + "]"


def _up(value: float) -> str:
    """Three digits, rounded upwards."""
    digits = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return f"{np.ceil(value / digits) * digits:.3g}"
