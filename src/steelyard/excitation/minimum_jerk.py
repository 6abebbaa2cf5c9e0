r"""Reaching between postures with the least jerk.

From rest to rest in the time $T$, with $\tau = t / T$,
$q = p_0 + (p_1 - p_0)(10 \tau^3 - 15 \tau^4 + 6 \tau^5)$ [Flash1985]: the fastest speed is
$15/8$ and the largest acceleration $10/\sqrt 3$ of what the distance gives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.linear_basis import LinearBasis, check_times, held_postures
from steelyard.excitation.piecewise import PiecewiseMotion

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


@dataclass(frozen=True, eq=False)
class ReachingBasis(LinearBasis):
    """Minimum-jerk moves between postures; the postures are the coefficients.

    Attributes:
        joints: Number of joints `n`.
        targets: Postures to choose `m`; without a `start`, the first of them is the start.
        move_s: Time of every move [s].
        dwell_s: Time to stand after every move [s].
        start: Posture at the start, shape `(n,)`, if it is not to be chosen.
        closed: Whether a last move leads back to the start.
    """

    joints: int
    targets: int
    move_s: float
    dwell_s: float = 0.0
    start: Array | None = None
    closed: bool = True

    def __post_init__(self) -> None:
        check_times(move_s=self.move_s)
        held_postures(self.joints, self.start)
        if self.targets < (fewest := 2 - len(self.held)):
            raise ValueError(f"{self.targets} targets are no motion, {fewest} or more are")
        self.made_of(np.zeros((1, self.count + len(self.held))))

    @property
    def count(self) -> int:
        """Functions per joint: one a target."""
        return self.targets

    @property
    def highest(self) -> float:
        """A move's acceleration is about one sine long [Hz]."""
        return 1.0 / self.move_s

    @property
    def held(self) -> tuple[Array, ...]:
        """The start, if it is given."""
        return held_postures(self.joints, self.start)

    def still(self, posture: Array) -> Array:
        """All targets at the posture, or at the start if it is given, shape `(n, m)`."""
        (place,) = self.held or (posture,)
        return np.repeat(frozen(place, (self.joints,))[:, None], self.targets, axis=1)

    def made_of(self, rows: Array) -> PiecewiseMotion:
        """The motion through the postures in the columns, shape `(k, m + held)`."""
        postures = np.roll(rows.T, len(self.held), axis=0)
        if self.closed:
            postures = np.vstack([postures, postures[:1]])
        return through_postures(postures, self.move_s, self.dwell_s)
