r"""Reaching between postures with the least jerk.

From rest to rest in the time $T$, with $\tau = t / T$,
$q = p_0 + (p_1 - p_0)(10 \tau^3 - 15 \tau^4 + 6 \tau^5)$ [Flash1985]: the fastest speed is
$15/8$ and the largest acceleration $10/\sqrt 3$ of what the distance gives.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion

SMOOTH = frozen([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
"""From 0 to 1, at rest at both ends: coefficients of the powers of the time's share."""


def through_postures(
    postures: ArrayLike, move_s: ArrayLike, dwell_s: float = 0.0
) -> PiecewiseMotion:
    """The motion that reaches posture after posture, and stands at each for a while.

    Args:
        postures: Two or more, the first of them the start, shape `(k, n)` [rad; m].
        move_s: Time of every move, or one per move, shape `(k - 1,)` [s].
        dwell_s: Time to stand after every move [s].
    """
    postures = frozen(postures, (None, None))
    if len(postures) < 2:
        raise ValueError(f"a motion through postures needs 2 of them or more, not {len(postures)}")
    moves = np.broadcast_to(np.asarray(move_s, dtype=np.float64), (len(postures) - 1,))
    if not (np.all(moves > 0.0) and dwell_s >= 0.0 and np.isfinite(moves).all()):
        raise ValueError("moves take more than 0 s, and dwells 0 s or more")
    reach = np.diff(postures, axis=0)[:, None, :] * SMOOTH[:, None]
    reach[:, 0] = postures[:-1]
    if dwell_s == 0.0:
        return PiecewiseMotion(np.cumsum([0.0, *moves]), reach)
    stand = np.zeros_like(reach)
    stand[:, 0] = postures[1:]
    pieces = np.stack([reach, stand], axis=1).reshape(-1, *reach.shape[1:])
    seconds = np.column_stack([moves, np.full_like(moves, dwell_s)]).ravel()
    return PiecewiseMotion(np.cumsum([0.0, *seconds]), pieces)


def reach_seconds(distance: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> float:
    """The shortest time of a minimum-jerk move within limits [s]; zero for no distance.

    Args:
        distance: Of every joint, any sign, shape `(n,)` [rad; m].
        velocity: Highest speeds, shape `(n,)`.
        acceleration: Highest accelerations, shape `(n,)`.
    """
    way = np.abs(np.asarray(distance, dtype=np.float64))
    by_speed = 15.0 / 8.0 * way / np.asarray(velocity, dtype=np.float64)
    by_acceleration = np.sqrt(10.0 / sqrt(3.0) * way / np.asarray(acceleration, dtype=np.float64))
    return float(np.max(np.maximum(by_speed, by_acceleration), initial=0.0))


def quintic(start: Sequence[Array], end: Sequence[Array], seconds: float) -> Array:
    r"""The polynomials of degree 5 with given position, velocity and acceleration at both ends.

    Args:
        start: The three at the start, each of shape `(n,)`.
        end: The three at the end.
        seconds: Time between both [s].

    Returns:
        Coefficients of the powers of the time's share, shape `(1, 6, n)`.
    """
    p, v, a = (value * seconds**k for k, value in enumerate(start))
    end_p, end_v, end_a = (value * seconds**k for k, value in enumerate(end))
    dp, dv, da = end_p - p - v - 0.5 * a, end_v - v - a, end_a - a
    high = [10.0 * dp - 4.0 * dv + 0.5 * da, -15.0 * dp + 7.0 * dv - da]
    return np.array([[p, v, 0.5 * a, *high, 6.0 * dp - 3.0 * dv + 0.5 * da]])
