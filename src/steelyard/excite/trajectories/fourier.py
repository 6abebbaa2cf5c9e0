r"""Finite Fourier series, at rest at their ends where wanted, and random ones within the limits.

Per joint, with $\omega = 2\pi / T$ and $H$ harmonics,

$$q(t) = q_0 + \sum_{k=1}^{H} a_k \sin k\omega t + b_k (\cos k\omega t - 1).$$

It leaves $q_0$ at rest and without acceleration if and only if $\sum k a_k = 0$ and
$\sum k^2 b_k = 0$: two linear conditions, so the admissible coefficients are a null space, and
position, velocity and acceleration are linear in its coordinates [Swevers1997].
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.motion import Motion, sample_times
from steelyard.excite.constraints.constraint import MotionLimits, motion_limits
from steelyard.excite.trajectories.polynomials import polynomial_extremes
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.robot.robot import Robot

TAYLOR = 13
"""Degree of the Taylor polynomials."""


def rest_basis(harmonics: int) -> Array:
    """Orthonormal basis of the coefficients `(a_1..a_H, b_1..b_H)` that start and end at rest.

    Args:
        harmonics: Number of harmonics `H`, at least 2.

    Returns:
        Shape `(2H, 2H - 2)`.
    """
    if harmonics < 2:
        raise ValueError(f"a motion from rest to rest needs 2 harmonics or more, not {harmonics}")
    basis = np.zeros((2 * harmonics, 2 * harmonics - 2))
    for half, power in enumerate((1, 2)):
        condition = np.arange(1.0, harmonics + 1.0)[None, :] ** power
        null = np.linalg.svd(condition)[2][1:].T
        rows = slice(half * harmonics, (half + 1) * harmonics)
        basis[rows, half * (harmonics - 1) : (half + 1) * (harmonics - 1)] = null
    return basis


def fourier_basis(t: ArrayLike, period: float, harmonics: int) -> tuple[Array, Array, Array]:
    """Values of the series' functions and of their first two derivatives.

    Args:
        t: Times, shape `(N,)` [s].
        period: Base period [s].
        harmonics: Number of harmonics `H`.

    Returns:
        Three arrays of shape `(N, 2H)`; times `(a, b)` they give `q - q_0`, `dq` and `ddq`.
    """
    position, velocity, acceleration = (fourier_shapes(t, period, harmonics, o) for o in range(3))
    return position, velocity, acceleration


def fourier_shapes(t: ArrayLike, period: float, harmonics: int, order: int) -> Array:
    """One derivative of the series' functions, of any order, shape `(N, 2H)`.

    Args:
        t: Times, shape `(N,)` [s].
        period: Base period [s].
        harmonics: Number of harmonics `H`.
        order: 0 for the functions themselves.
    """
    rate = 2.0 * np.pi / period * np.arange(1.0, harmonics + 1.0)
    angle = np.asarray(t, dtype=np.float64)[:, None] * rate
    sin, cos = np.sin(angle), np.cos(angle)
    cycle = (sin, cos, -sin, -cos)
    of_sine, of_cosine = cycle[order % 4], cycle[(order + 1) % 4]
    if order == 0:
        return np.hstack([of_sine, of_cosine - 1.0])
    return np.hstack([of_sine * rate**order, of_cosine * rate**order])


@dataclass(frozen=True, eq=False)
class FourierMotion:
    """A periodic motion of all joints; at rest at both ends unless `rests` says otherwise.

    Attributes:
        start: Posture at both ends, shape `(n,)` [rad; m].
        sine: Coefficients `a`, shape `(n, H)` [rad; m].
        cosine: Coefficients `b`, shape `(n, H)` [rad; m].
        period: Base period [s].
        periods: How often the period is run through.
        rests: Whether velocity and acceleration are zero at both ends; it is checked.
    """

    start: Array
    sine: Array
    cosine: Array
    period: float
    periods: int = 1
    rests: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen(self.start, (None,)))
        object.__setattr__(self, "sine", frozen(self.sine, (len(self.start), None)))
        object.__setattr__(self, "cosine", frozen(self.cosine, self.sine.shape))
        if not (self.period > 0.0 and np.isfinite(self.period) and self.periods >= 1):
            raise ValueError(f"{self.periods} periods of {self.period} s are no motion")
        if not all(np.isfinite(values).all() for values in (self.start, self.sine, self.cosine)):
            raise ValueError("a posture or a coefficient of the series is not finite")
        if self.rests:
            self._check_rest()

    def _check_rest(self) -> None:
        k = np.arange(1.0, self.harmonics + 1.0)
        for weight, series, what in ((k, self.sine, "velocity"), (k**2, self.cosine, "accel.")):
            residual = np.abs(series @ weight)
            if not np.all(residual <= 1e-9 * (np.abs(series) @ weight) + 1e-15):
                raise ValueError(f"the series does not start at rest: its {what} is not zero")

    @classmethod
    def from_free(
        cls, start: ArrayLike, free: ArrayLike, period: float, periods: int = 1
    ) -> "FourierMotion":
        """From coordinates in the null space of the conditions of rest.

        Args:
            start: Posture at both ends, shape `(n,)`.
            free: Shape `(n, 2H - 2)`, coordinates in `rest_basis(H)`.
            period: Base period [s].
            periods: How often the period is run through.
        """
        free = frozen(free, (None, None))
        harmonics = free.shape[1] // 2 + 1
        both = free @ rest_basis(harmonics).T
        sine, cosine = both[:, :harmonics], both[:, harmonics:]
        return cls(frozen(start), sine, cosine, period, periods)

    @property
    def harmonics(self) -> int:
        """Number of harmonics."""
        return int(self.sine.shape[1])

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.period * self.periods

    @property
    def breaks(self) -> Array:
        """Start and end, shape `(2,)` [s]."""
        return np.array([0.0, self.duration])

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Any order, 0 for the position, at times from 0 to the duration, shape `(N, n)`."""
        t = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        shapes = fourier_shapes(t, self.period, self.harmonics, order)
        values = shapes @ np.hstack([self.sine, self.cosine]).T
        return values + self.start if order == 0 else values

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`."""
        cells = np.linspace(0.0, self.period, wave_cells(self.harmonics) + 1)
        return smooth_extremes(self, cells, order, self.slack(order, cells[1]))

    def slack(self, order: int, width: float) -> Array:
        """Bound of what `taylor_pieces` of that width leave out and rounding adds, shape `(n,)`."""
        rate = 2.0 * np.pi / self.period * np.arange(1.0, self.harmonics + 1.0)
        left_out = (rate * width) ** (TAYLOR + 1) / factorial(TAYLOR + 1)
        rounding = 8.0 * np.finfo(np.float64).eps * (2.0 + rate * self.duration)
        size = np.abs(self.sine) + np.abs(self.cosine)
        return np.asarray(size @ (rate**order * (left_out + rounding)))

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        t = sample_times(t)
        coefficients = np.hstack([self.sine, self.cosine]).T
        inside = ((t >= 0.0) & (t <= self.duration))[:, None]
        values = fourier_basis(np.clip(t, 0.0, self.duration), self.period, self.harmonics)
        q, dq, ddq = (np.where(inside, value @ coefficients, 0.0) for value in values)
        return Motion(t, self.start + q, dq, ddq)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        return {
            "kind": "fourier",
            "period_s": self.period,
            "periods": self.periods,
            "rests": self.rests,
            "start": self.start.tolist(),
            "sine": self.sine.tolist(),
            "cosine": self.cosine.tolist(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "FourierMotion":
        """The inverse of `to_dict`."""
        return cls(
            start=values["start"],
            sine=values["sine"],
            cosine=values["cosine"],
            period=float(values["period_s"]),
            periods=int(values["periods"]),
            rests=bool(values.get("rests", True)),
        )


def wave_cells(harmonics: int) -> int:
    """Cells of a period that are short enough for `taylor_pieces`."""
    return 16 * max(harmonics, 1)


def smooth_extremes(
    trajectory: ExactTrajectory, cells: Array, order: int, slack: Array
) -> tuple[Array, Array]:
    """Least and greatest value of a derivative, each `(n,)`.

    Args:
        trajectory: As `taylor_pieces` needs it.
        cells: Ascending times, shape `(p + 1,)` [s]; it is smooth between two of them.
        order: Which derivative.
        slack: Bound of what the Taylor polynomials leave out, shape `(n,)`.
    """
    least, greatest = polynomial_extremes(taylor_pieces(trajectory, cells, order))
    return least - slack, greatest + slack


def taylor_pieces(trajectory: ExactTrajectory, cells: Array, order: int) -> Array:
    r"""A derivative as Taylor polynomials in the share of each cell's time.

    Sixteen cells a wave at degree 13 leave out $(2\pi/16)^{14} / 14! < 3 \cdot 10^{-17}$ of it.

    Args:
        trajectory: Its `derivative` is taken from the right, and knows orders as high as needed.
        cells: Ascending times, shape `(p + 1,)` [s]; it is smooth between two of them.
        order: Which derivative.

    Returns:
        Shape `(p, TAYLOR + 1, n)`.
    """
    width = np.diff(cells)[:, None]
    pieces = [
        trajectory.derivative(cells[:-1], order + i) * (width**i / factorial(i))
        for i in range(TAYLOR + 1)
    ]
    return np.stack(pieces, axis=1)


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
