r"""Friction sweeps of one joint after another, and standstills at many postures for gravity.

A sweep is a joint that goes there and back at a constant speed $v$. It gets up to it with the speed
$v (3 \tau^2 - 2 \tau^3)$, whose largest acceleration is $3/2$ of $v$ over its time.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.constraints.motion_limits import MotionLimits
from steelyard.excite.trajectories.piecewise_polynomials import (
    SMOOTH,
    PiecewiseMotion,
    reach_seconds,
    through_postures,
)

_GAIN = 1.5  # largest acceleration of a change of speed, over the change per time
_STEADY = 0.5  # share of a sweep's way that is gone at constant speed, at least
_ROOM = 1.0 - 1e-9  # keeps the largest values below the limits, not on them, whatever rounding does


def friction_sweeps(
    limits: MotionLimits,
    posture: ArrayLike | None = None,
    *,
    speeds: int = 6,
    slowest: float = 0.05,
    fraction: float = 0.9,
    longest_s: float = 5.0,
) -> PiecewiseMotion:
    """One joint after another goes there and back at constant speeds; the others stand still.

    The ways lie around the posture, as long as `longest_s` and the position range let them be. A
    joint whose range is too short for its highest speed goes as fast as half of the range can be
    gone at. It changes all its speeds in the time that the fastest one needs.

    Speeds are geometrically spaced from the share `slowest` of the fastest on. A `fraction` of the
    speeds, accelerations and position ranges is used. The posture is the middle of the ranges if
    `None`.
    """
    lower, upper = _allowed(limits, _ROOM * fraction)
    posture = _inside(limits, fraction, posture)
    shares = np.geomspace(slowest, 1.0, speeds) if speeds > 1 else np.ones(1)
    rows: list[tuple[float, int, Array]] = []
    for joint, place in enumerate(posture):
        room = (float(lower[joint]), float(upper[joint]))
        fastest = fraction * _ROOM * limits.velocity[joint]
        acceleration = fraction * _ROOM * limits.acceleration[joint]
        reached = np.sqrt((1.0 - _STEADY) * (room[1] - room[0]) * acceleration / _GAIN)
        top, bounds = min(fastest, reached), (fastest, acceleration)
        for seconds, powers in _joint_sweeps(float(place), room, top * shares, bounds, longest_s):
            rows.append((seconds, joint, powers))
    coefficients = np.zeros((len(rows), 6, len(posture)))
    coefficients[:, 0] = posture
    for piece, (_, joint, powers) in enumerate(rows):
        coefficients[piece, :, joint] = powers
    return PiecewiseMotion(np.cumsum([0.0] + [row[0] for row in rows]), coefficients)


def _joint_sweeps(
    place: float,
    room: tuple[float, float],
    speeds: Array,
    bounds: tuple[float, float],
    longest_s: float,
) -> Iterator[tuple[float, Array]]:
    """Seconds and coefficients of one joint's pieces, from `place` back to it.

    The `room` is its lowest and highest position, `bounds` are its highest speed and acceleration.
    """
    at, change = place, _GAIN * speeds[-1] / bounds[1]
    for speed in speeds:
        way = min(speed * (change + longest_s), room[1] - room[0])
        low = float(np.clip(place - 0.5 * way, room[0], room[1] - way))
        yield from _reach(at, low, bounds, change)
        yield from _sweep(low, low + way, speed, change)
        yield from _sweep(low + way, low, -speed, change)
        at = low
    yield from _reach(at, place, bounds, change)


def _reach(
    start: float, end: float, bounds: tuple[float, float], least_s: float
) -> Iterator[tuple[float, Array]]:
    """A minimum-jerk move, unless there is no way to go; short ones are not hurried."""
    if start != end:
        powers = (end - start) * SMOOTH
        powers[0] = start
        yield max(reach_seconds([end - start], *bounds), least_s), powers


def _sweep(start: float, end: float, speed: float, change: float) -> Iterator[tuple[float, Array]]:
    """From rest up to the speed, along at it, and down to rest; `speed` has the way's sign."""
    half = 0.5 * speed * change
    steady = (end - start) / speed - change
    yield change, np.array([start, 0.0, 0.0, 2.0 * half, -half, 0.0])
    yield steady, np.array([start + half, steady * speed, 0.0, 0.0, 0.0, 0.0])
    yield change, np.array([end - half, 2.0 * half, 0.0, -2.0 * half, half, 0.0])


def static_postures(
    limits: MotionLimits, *, count: int, seed: int, dwell_s: float, fraction: float = 0.9
) -> PiecewiseMotion:
    """Stands still at postures that fill the ranges evenly, and comes back to their middle.

    The postures are the first ones of a scrambled Sobol sequence [Owen1998], in a `fraction` of the
    position ranges; moves between them use half of the speeds and accelerations.
    """
    from scipy.stats.qmc import Sobol

    lower, upper = _allowed(limits, fraction)
    sequence = Sobol(len(lower), seed=np.random.default_rng(seed))
    places = sequence.random_base2((count - 1).bit_length())[:count]
    middle = 0.5 * (lower + upper)
    postures = np.vstack([middle, lower + (upper - lower) * places, middle])
    share = 0.5 * _ROOM
    seconds = [
        reach_seconds(step, share * limits.velocity, share * limits.acceleration)
        for step in np.diff(postures, axis=0)
    ]
    return through_postures(postures, seconds, dwell_s)


def _allowed(limits: MotionLimits, fraction: float) -> tuple[Array, Array]:
    """The share of the position ranges, around their middle."""
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    return middle - fraction * half, middle + fraction * half


def _inside(limits: MotionLimits, fraction: float, posture: ArrayLike | None) -> Array:
    """The posture, or the middle of the ranges."""
    lower, upper = _allowed(limits, fraction)
    if posture is None:
        return 0.5 * (lower + upper)
    posture = frozen(posture, lower.shape)
    excess = np.maximum(lower - posture, posture - upper)
    joint = int(np.argmax(excess))
    if excess[joint] > 0.0:
        raise DataError(
            f"joint {joint + 1} is at {posture[joint]:.4g}, {excess[joint]:.2g} outside its "
            f"allowed range {lower[joint]:.4g} .. {upper[joint]:.4g}",
            where="posture",
            fix=f"move it inside, or allow more than {fraction:g} of the range",
        )
    return posture
