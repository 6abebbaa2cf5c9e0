r"""Finite Fourier series, at rest at their ends where wanted, and random ones within the limits.

Per joint, with $\omega = 2\pi / T$ and $H$ harmonics,

$$q(t) = q_0 + \sum_{k=1}^{H} a_k \sin k\omega t + b_k (\cos k\omega t - 1).$$

It leaves $q_0$ at rest and without acceleration if and only if $\sum k a_k = 0$ and
$\sum k^2 b_k = 0$: two linear conditions, so the admissible coefficients are a null space, and
position, velocity and acceleration are linear in its coordinates [Swevers1997].
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.excite.constraints.constraint_and_limits import motion_limits
from steelyard.excite.trajectories.exact_trajectories import (
    SMOOTH,
    ChainedMotion,
    ExactTrajectory,
    PiecewiseMotion,
    divided,
    polynomial_extremes,
)
from steelyard.robot.robot import Robot

TAYLOR = 13  # degree of the Taylor polynomials
_CELLS_PER_WAVE = 16  # short enough for `taylor_pieces`


def rest_basis(harmonics: int) -> Array:
    """Orthonormal basis of coefficients `(a_1..a_H, b_1..b_H)` at rest, shape `(2H, 2H - 2)`.

    There are two harmonics or more.
    """
    basis = np.zeros((2 * harmonics, 2 * harmonics - 2))
    for half, power in enumerate((1, 2)):
        condition = np.arange(1.0, harmonics + 1.0)[None, :] ** power
        null = np.linalg.svd(condition)[2][1:].T
        rows = slice(half * harmonics, (half + 1) * harmonics)
        basis[rows, half * (harmonics - 1) : (half + 1) * (harmonics - 1)] = null
    return basis


def fourier_shapes(t: ArrayLike, period: float, harmonics: int, order: int) -> Array:
    """A derivative of any order of the series' functions at times `(N,)` [s], shape `(N, 2H)`."""
    rate = 2.0 * np.pi / period * np.arange(1.0, harmonics + 1.0)
    angle = np.asarray(t, dtype=np.float64)[:, None] * rate
    sin, cos = np.sin(angle), np.cos(angle)
    cycle = (sin, cos, -sin, -cos)
    of_sine, of_cosine = cycle[order % 4], cycle[(order + 1) % 4]
    if order == 0:
        return np.hstack([of_sine, of_cosine - 1.0])
    return np.hstack([of_sine * rate**order, of_cosine * rate**order])


@dataclass(frozen=True, eq=False)
class FourierMotion(ExactTrajectory):
    r"""A series of all joints $s(t)$, with a trend and amplitude ramps if wanted.

    $q(t) = p(t) + w(t)\,s(t)$ with a trend $p$ of polynomials of degree 13 or less, of the same
    duration, with ramps a constant; and $w$ rising from 0 to 1 within `ramp` [s] at the start, and
    falling back at the end, like a smooth step. The posture of the series at both ends is `start`,
    `(n,)`, its coefficients $a$ and $b$, `(n, H)` [rad; m]. If it `rests`, velocity and
    acceleration of the series are checked to be zero at both ends.
    """

    start: Array
    sine: Array
    cosine: Array
    period: float
    periods: int = 1
    rests: bool = True
    trend: PiecewiseMotion | None = None
    ramp: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen(self.start, (None,)))
        object.__setattr__(self, "sine", frozen(self.sine, (len(self.start), None)))
        object.__setattr__(self, "cosine", frozen(self.cosine, self.sine.shape))
        if not (self.period > 0.0 and np.isfinite(self.period) and self.periods >= 1):
            raise ValueError(f"{self.periods} periods of {self.period} s are no motion")
        if not all(np.isfinite(values).all() for values in (self.start, self.sine, self.cosine)):
            raise ValueError("a posture or a coefficient of the series is not finite")
        k = np.arange(1.0, self.harmonics + 1.0)
        for weight, series, what in ((k, self.sine, "velocity"), (k**2, self.cosine, "accel.")):
            residual, rounding = np.abs(series @ weight), 1e-9 * (np.abs(series) @ weight) + 1e-15
            if self.rests and not np.all(residual <= rounding):
                raise ValueError(f"the series does not start at rest: its {what} is not zero")
        if self.ramp is not None and not 0.0 < self.ramp <= 0.5 * self.duration:
            raise ValueError(
                f"a ramp of {self.ramp:g} s does not fit twice into {self.duration:g} s"
            )
        if self.ramp is not None and (
            self.trend is None or self.trend.coefficients.size != len(self.start)
        ):
            raise ValueError("a series with ramps has one posture at both ends as its trend")
        if self.trend is None:
            return
        if self.trend.coefficients.shape[2] != len(self.start):
            raise ValueError("series and trend move different numbers of joints")
        if not np.isclose(self.trend.duration, self.duration, rtol=1e-12, atol=0.0):
            raise ValueError("series and trend do not last equally long")
        if self.trend.coefficients.shape[1] > TAYLOR + 1:
            raise ValueError(f"the trend's polynomials are of a degree above {TAYLOR}")

    @classmethod
    def from_free(
        cls, start: ArrayLike, free: ArrayLike, period: float, periods: int = 1
    ) -> "FourierMotion":
        """From coordinates `free` in `rest_basis(H)`, shape `(n, 2H - 2)`."""
        free = frozen(free, (None, None))
        harmonics = free.shape[1] // 2 + 1
        both = free @ rest_basis(harmonics).T
        return cls(frozen(start), both[:, :harmonics], both[:, harmonics:], period, periods)

    def ramped(self, posture: ArrayLike, ramp: float) -> "FourierMotion":
        """The series as a displacement from a posture at both ends, `(n,)`, with ramps [s]."""
        posture = frozen(posture, self.start.shape)
        trend = PiecewiseMotion(np.array([0.0, self.duration]), posture[None, None])
        return replace(self, trend=trend, ramp=ramp)

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
        """Start and end, those of the trend, and where ramps begin and end."""
        parts = [part.breaks for part in (self.trend, self._window) if part is not None]
        return np.unique(np.concatenate(parts)) if parts else np.array([0.0, self.duration])

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """See `ExactTrajectory`; any order."""
        values = self._series(t, order)
        if self._window is not None:
            window = self._window
            values = np.asarray(
                sum(
                    comb(order, i) * window.derivative(t, i) * self._series(t, order - i)
                    for i in range(min(order, len(SMOOTH) - 1) + 1)
                )
            )
        return values if self.trend is None else values + self.trend.derivative(t, order)

    def _series(self, t: ArrayLike, order: int) -> Array:
        t = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        shapes = fourier_shapes(t, self.period, self.harmonics, order)
        values = shapes @ np.hstack([self.sine, self.cosine]).T
        return values + self.start if order == 0 else values

    @cached_property
    def _window(self) -> PiecewiseMotion | None:
        """The factor $w$, as a motion of one joint."""
        if self.ramp is None:
            return None
        flat = np.eye(len(SMOOTH))[0]
        pieces = [SMOOTH, flat, flat - SMOOTH]
        breaks = np.array([0.0, self.ramp, self.duration - self.ramp, self.duration])
        if self.ramp >= self.duration - self.ramp:
            pieces, breaks = [SMOOTH, flat - SMOOTH], breaks[[0, 1, 3]]
        return PiecewiseMotion(breaks, np.array(pieces)[:, :, None])

    def extremes(self, order: int) -> tuple[Array, Array]:
        """See `ExactTrajectory`."""
        wave = self.period / (_CELLS_PER_WAVE * max(self.harmonics, 1))
        if self.ramp is not None:
            wave = min(wave, self.ramp / 16.0)
        once = np.array([0.0, self.period]) if self.trend is None else self.breaks
        cells = divided(once, wave)
        least, greatest = polynomial_extremes(taylor_pieces(self, cells, order))
        slack = self._slack(order, float(np.diff(cells).max()))
        return least - slack, greatest + slack

    def _slack(self, order: int, width: float) -> Array:
        """Bound of what Taylor polynomials of cells of that width leave out, and of rounding.

        With ramps by Leibniz' rule, from bounds of the window's and of the series' derivatives.
        """
        rate = 2.0 * np.pi / self.period * np.arange(self.harmonics + 1.0)
        size = np.abs(np.column_stack([self.start - self.cosine.sum(axis=1), self.sine]))
        size[:, 1:] += np.abs(self.cosine)
        eps = 8.0 * np.finfo(np.float64).eps
        if self._window is None:
            rate, size = rate[1:], size[:, 1:]
            left_out = (rate * width) ** (TAYLOR + 1) / factorial(TAYLOR + 1)
            return np.asarray(
                size @ (rate**order * (left_out + eps * (2.0 + rate * self.duration)))
            )
        window = [np.abs(self._window.extremes(i)).max() for i in range(len(SMOOTH))]

        def bound(k: int) -> Array:
            low = range(min(k, len(SMOOTH) - 1) + 1)
            return np.asarray(sum(comb(k, i) * window[i] * size @ rate ** (k - i) for i in low))

        left_out = bound(order + TAYLOR + 1) * width ** (TAYLOR + 1) / factorial(TAYLOR + 1)
        fastest = rate[-1] + 1.0 / float(self.ramp or np.inf)
        return np.asarray(left_out + eps * (2.0 + fastest * self.duration) * bound(order))

    def to_dict(self) -> dict[str, Any]:
        """See `ExactTrajectory`."""
        series = {
            "kind": "fourier",
            "period_s": self.period,
            "periods": self.periods,
            "rests": self.rests,
            "start": self.start.tolist(),
            "sine": self.sine.tolist(),
            "cosine": self.cosine.tolist(),
        }
        if self.trend is None:
            return series
        if self.ramp is None:
            return {"kind": "trended", "series": series, "trend": self.trend.to_dict()}
        posture = self.trend.coefficients[0, 0].tolist()
        return {"kind": "windowed", "posture": posture, "ramp_s": self.ramp, "series": series}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "FourierMotion":
        """The inverse of `to_dict`, of a series alone."""
        return cls(
            start=values["start"],
            sine=values["sine"],
            cosine=values["cosine"],
            period=float(values["period_s"]),
            periods=int(values["periods"]),
            rests=bool(values.get("rests", True)),
        )


def repeated(trajectory: ExactTrajectory, times: int) -> ExactTrajectory:
    """The trajectory several times without a stop; `ValueError` if it ends elsewhere."""
    if isinstance(trajectory, FourierMotion) and trajectory.trend is None:
        return replace(trajectory, periods=times * trajectory.periods)
    if isinstance(trajectory, ChainedMotion):
        return replace(trajectory, times=times * trajectory.times)
    return trajectory if times == 1 else ChainedMotion((trajectory,), times)


def taylor_pieces(trajectory: ExactTrajectory, cells: Array, order: int) -> Array:
    r"""A derivative as Taylor polynomials in the share of each cell's time, `(p, TAYLOR + 1, n)`.

    Sixteen cells a wave at degree 13 leave out $(2\pi/16)^{14} / 14! < 3 \cdot 10^{-17}$ of it. The
    trajectory is smooth between two of the ascending times `cells`, `(p + 1,)` [s]; its derivatives
    are taken from the right.
    """
    width = np.diff(cells)[:, None]
    pieces = [
        trajectory.derivative(cells[:-1], order + i) * (width**i / factorial(i))
        for i in range(TAYLOR + 1)
    ]
    return np.stack(pieces, axis=1)


_POINTS_PER_WAVE = 100
_GRID_MARGIN = 1e-3  # a sine on 100 points a wave has its extremum at most 0.05 % higher between


def random_fourier(
    robot: Robot,
    *,
    seed: int,
    period: float = 10.0,
    harmonics: int = 5,
    periods: int = 1,
    limits_fraction: float = 0.9,
) -> FourierMotion:
    """A random series per joint, as large as one of its limits allows; same seed, same motion.

    It begins in the middle of the ranges, and uses a share of the speeds, accelerations and ranges.
    """
    limits = motion_limits(robot)
    free = np.random.default_rng(seed).standard_normal((robot.n, 2 * harmonics - 2))
    t = np.linspace(0.0, period, _POINTS_PER_WAVE * harmonics + 1)
    series = rest_basis(harmonics) @ free.T
    q, dq, ddq = (fourier_shapes(t, period, harmonics, order) @ series for order in range(3))
    half = 0.5 * (limits.upper - limits.lower)
    needed = np.max(
        [
            np.abs(q).max(axis=0) / (limits_fraction * half),
            np.abs(dq).max(axis=0) / (limits_fraction * limits.velocity),
            np.abs(ddq).max(axis=0) / (limits_fraction * limits.acceleration),
        ],
        axis=0,
    )
    scale = 1.0 / (needed * (1.0 + _GRID_MARGIN))
    start = 0.5 * (limits.lower + limits.upper)
    return FourierMotion.from_free(start, scale[:, None] * free, period, periods)
