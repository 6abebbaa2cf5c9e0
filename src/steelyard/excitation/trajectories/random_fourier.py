"""Random motions within the limits: no optimum, but rich enough to begin with."""

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.limits import MotionLimits, motion_limits
from steelyard.excitation.trajectories.fourier import FourierMotion, fourier_basis, rest_basis
from steelyard.robot.robot import Robot

_POINTS_PER_WAVE = 100
_GRID_MARGIN = 1e-3
"""A sine on 100 points a wave has its extremum between two of them, at most 0.05 % higher."""


def random_fourier(
    robot: Robot,
    *,
    seed: int,
    period: float = 10.0,
    harmonics: int = 5,
    periods: int = 1,
    limits_fraction: float = 0.9,
    limits: MotionLimits | None = None,
    start: ArrayLike | None = None,
) -> FourierMotion:
    """A random series per joint, as large as one of its limits allows.

    Args:
        robot: The robot.
        seed: Same seed, same motion.
        period: Base period [s].
        harmonics: Number of harmonics.
        periods: How often the period is run through.
        limits_fraction: Share of the speeds, accelerations and position ranges that may be used.
        limits: Bounds of the motion; by default `motion_limits(robot)`.
        start: Posture at both ends, shape `(n,)`; by default the middle of the ranges.
    """
    limits = motion_limits(robot) if limits is None else limits
    start = 0.5 * (limits.lower + limits.upper) if start is None else frozen(start, (robot.n,))
    free = np.random.default_rng(seed).standard_normal((robot.n, 2 * harmonics - 2))
    t = np.linspace(0.0, period, _POINTS_PER_WAVE * harmonics + 1)
    shapes = [
        basis @ rest_basis(harmonics) @ free.T for basis in fourier_basis(t, period, harmonics)
    ]
    scale = _largest_scale(shapes, start, limits, limits_fraction)
    return FourierMotion.from_free(start, scale[:, None] * free, period, periods)


def _largest_scale(
    shapes: list[Array], start: Array, limits: MotionLimits, fraction: float
) -> Array:
    """The factor per joint, shape `(n,)`, that brings it to the first of its limits.

    Args:
        shapes: `q - q_0`, `dq` and `ddq` on a dense grid, each `(N, n)`.
        start: Posture at both ends, shape `(n,)`.
        limits: Bounds of the motion.
        fraction: Share of every bound that may be used.
    """
    centre, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    room_up = centre + fraction * half - start
    room_down = start - centre + fraction * half
    if np.any(room_up <= 0.0) or np.any(room_down <= 0.0):
        raise ValueError("the start posture is outside the allowed share of the position ranges")
    q, dq, ddq = shapes
    needed = np.max(
        [
            q.max(axis=0) / room_up,
            -q.min(axis=0) / room_down,
            np.abs(dq).max(axis=0) / (fraction * limits.velocity),
            np.abs(ddq).max(axis=0) / (fraction * limits.acceleration),
        ],
        axis=0,
    )
    return np.asarray(1.0 / (needed * (1.0 + _GRID_MARGIN)))
