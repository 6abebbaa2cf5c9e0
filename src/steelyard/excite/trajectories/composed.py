"""Trajectories composed of others: one after another, on a slow motion, with a rising amplitude."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import TAYLOR, FourierMotion, smooth_extremes, wave_cells
from steelyard.excite.trajectories.polynomials import SMOOTH, PiecewiseMotion, check_join
from steelyard.excite.trajectories.trajectory import ExactTrajectory, sampled


@dataclass(frozen=True, eq=False)
class ChainedMotion:
    """Parts one after another, each beginning where the one before ends.

    Attributes:
        parts: One or more, of the same joints.
        times: How often all parts are run through.
    """

    parts: Sequence[ExactTrajectory]
    times: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts or self.times < 1:
            raise ValueError(f"{self.times} times {len(self.parts)} parts are no motion")
        ends = [part.derivative([0.0, part.duration], 0) for part in self.parts]
        joints = {values.shape[1] for values in ends}
        if len(joints) > 1:
            raise ValueError(f"the parts move {sorted(joints)} joints, not all the same number")
        starts = np.array([start for start, _ in ends])
        following = np.roll(starts, -1, axis=0)[: len(ends) if self.times > 1 else -1]
        before = np.array([end for _, end in ends])[: len(following)]
        check_join(before, following, self._ends[: len(following)])

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.times * self._ends[-1])

    @cached_property
    def breaks(self) -> Array:
        """Those of the parts, and where they meet, shape `(k,)` [s]."""
        starts = self._ends - [part.duration for part in self.parts]
        once = [start + p.breaks[:-1] for start, p in zip(starts, self.parts, strict=True)]
        rounds = self._ends[-1] * np.arange(self.times)
        inner = (rounds[:, None] + np.concatenate(once)).ravel()
        return np.append(inner[inner < self.duration], self.duration)

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Order 0 (position) or higher at times from 0 to the duration, shape `(N, n)`."""
        clipped = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        rounds = np.clip(clipped // self._ends[-1], 0, self.times - 1)
        inside = clipped - rounds * self._ends[-1]
        which = np.searchsorted(self._ends[:-1], inside, side="right")
        values = np.empty((len(inside), self.parts[0].derivative([0.0], 0).shape[1]))
        for number in np.unique(which):
            here, part = which == number, self.parts[number]
            local = inside[here] - (self._ends[number] - part.duration)
            values[here] = part.derivative(np.clip(local, 0.0, part.duration), order)
        return values

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; both sides of a break count."""
        least, greatest = zip(*(part.extremes(order) for part in self.parts), strict=True)
        return np.min(least, axis=0), np.max(greatest, axis=0)

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        return sampled(self, t)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        parts = [part.to_dict() for part in self.parts]
        return {"kind": "chained", "times": self.times, "parts": parts}

    @cached_property
    def _ends(self) -> Array:
        """When each part ends for the first time, shape `(parts,)` [s]."""
        return np.cumsum([part.duration for part in self.parts])


def repeated(trajectory: ExactTrajectory, times: int) -> ExactTrajectory:
    """The trajectory several times without a stop.

    Raises:
        ValueError: It does not end where it starts.
    """
    if isinstance(trajectory, FourierMotion):
        return replace(trajectory, periods=times * trajectory.periods)
    if isinstance(trajectory, ChainedMotion):
        return replace(trajectory, times=times * trajectory.times)
    return trajectory if times == 1 else ChainedMotion((trajectory,), times)


@dataclass(frozen=True, eq=False)
class TrendedMotion:
    """The sum of a series and of polynomials of degree 13 or less.

    Attributes:
        series: Of `n` joints.
        trend: Of the same joints and the same duration.
    """

    series: FourierMotion
    trend: PiecewiseMotion

    def __post_init__(self) -> None:
        if self.trend.coefficients.shape[2] != len(self.series.start):
            raise ValueError("series and trend move different numbers of joints")
        if not np.isclose(self.trend.duration, self.series.duration, rtol=1e-12, atol=0.0):
            raise ValueError("series and trend do not last equally long")
        if self.trend.coefficients.shape[1] > TAYLOR + 1:
            raise ValueError(f"the trend's polynomials are of a degree above {TAYLOR}")

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.trend.duration

    @property
    def breaks(self) -> Array:
        """Those of the trend, shape `(k,)` [s]."""
        return self.trend.breaks

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Any order, 0 for the position, at times from 0 to the duration, shape `(N, n)`."""
        return self.series.derivative(t, order) + self.trend.derivative(t, order)

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; both sides of a break count."""
        count = wave_cells(self.series.harmonics) * self.series.periods
        even = np.linspace(0.0, self.duration, count + 1)
        cells = np.union1d(even, self.breaks)
        return smooth_extremes(self, cells, order, self.series.slack(order, even[1]))

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        return sampled(self, t)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        return {
            "kind": "trended",
            "series": self.series.to_dict(),
            "trend": self.trend.to_dict(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "TrendedMotion":
        """The inverse of `to_dict`."""
        series, trend = values["series"], values["trend"]
        return cls(FourierMotion.from_dict(series), PiecewiseMotion.from_dict(trend))


@dataclass(frozen=True, eq=False)
class WindowedMotion:
    r"""$q(t) = p + w(t)\, s(t)$, where $w$ rises from 0 to 1 and falls back like a smooth step.

    Attributes:
        posture: Posture at both ends $p$, shape `(n,)` [rad; m].
        series: $s$, as a displacement from the posture.
        ramp: How long $w$ rises, and how long it falls [s]; half of the duration at most.
    """

    posture: Array
    series: FourierMotion
    ramp: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "posture", frozen(self.posture, self.series.start.shape))
        if not np.isfinite(self.posture).all():
            raise ValueError("the posture at the ends of the motion is not finite")
        if not 0.0 < self.ramp <= 0.5 * self.duration:
            raise ValueError(
                f"a ramp of {self.ramp:g} s does not fit twice into {self.duration:g} s"
            )

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.series.duration

    @property
    def breaks(self) -> Array:
        """Where the ramps begin and end, shape `(3,)` or `(4,)` [s]."""
        return self._window.breaks

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Any order, 0 for the position, at times from 0 to the duration, shape `(N, n)`."""
        low = range(min(order, len(SMOOTH) - 1) + 1)
        values = sum(
            comb(order, i) * self._window.derivative(t, i) * self.series.derivative(t, order - i)
            for i in low
        )
        return np.asarray(values + self.posture if order == 0 else values)

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; both sides of a break count."""
        wave = self.series.period / wave_cells(self.series.harmonics)
        count = np.ceil(np.diff(self.breaks) / min(wave, self.ramp / 16.0)).astype(int)
        inner = [
            np.linspace(start, end, n, endpoint=False)
            for start, end, n in zip(self.breaks, self.breaks[1:], count, strict=False)
        ]
        cells = np.append(np.concatenate(inner), self.duration)
        return smooth_extremes(self, cells, order, self._slack(order, float(np.diff(cells).max())))

    def _slack(self, order: int, width: float) -> Array:
        """Bound of what Taylor polynomials of cells of that width leave out, and of rounding.

        By Leibniz' rule, from the bounds of the window's and of the series' derivatives.
        """
        series = self.series
        rate = 2.0 * np.pi / series.period * np.arange(series.harmonics + 1.0)
        size = np.abs(np.column_stack([series.start - series.cosine.sum(axis=1), series.sine]))
        size[:, 1:] += np.abs(series.cosine)
        window = [np.abs(self._window.extremes(i)).max() for i in range(len(SMOOTH))]

        def bound(k: int) -> Array:
            low = range(min(k, len(SMOOTH) - 1) + 1)
            return np.asarray(sum(comb(k, i) * window[i] * size @ rate ** (k - i) for i in low))

        left_out = bound(order + TAYLOR + 1) * width ** (TAYLOR + 1) / factorial(TAYLOR + 1)
        fastest = rate[-1] + 1.0 / self.ramp
        rounding = 8.0 * np.finfo(np.float64).eps * (2.0 + fastest * self.duration)
        return np.asarray(left_out + rounding * bound(order))

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        return sampled(self, t)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        return {
            "kind": "windowed",
            "posture": self.posture.tolist(),
            "ramp_s": self.ramp,
            "series": self.series.to_dict(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "WindowedMotion":
        """The inverse of `to_dict`."""
        series = FourierMotion.from_dict(values["series"])
        return cls(values["posture"], series, float(values["ramp_s"]))

    @cached_property
    def _window(self) -> PiecewiseMotion:
        """The factor `w`, as a motion of one joint."""
        flat = np.eye(len(SMOOTH))[0]
        pieces = [SMOOTH, flat, flat - SMOOTH]
        breaks = np.array([0.0, self.ramp, self.duration - self.ramp, self.duration])
        if self.ramp >= self.duration - self.ramp:
            pieces, breaks = [SMOOTH, flat - SMOOTH], breaks[[0, 1, 3]]
        return PiecewiseMotion(breaks, np.array(pieces)[:, :, None])
