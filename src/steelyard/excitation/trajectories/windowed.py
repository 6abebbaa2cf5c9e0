"""A Fourier series whose amplitude rises from zero and falls back to it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.trajectories.fourier import (
    TAYLOR,
    FourierMotion,
    smooth_extremes,
    wave_cells,
)
from steelyard.excitation.trajectories.minimum_jerk import SMOOTH
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion
from steelyard.excitation.trajectories.sampling import sampled
from steelyard.motion import Motion


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
