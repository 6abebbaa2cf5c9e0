"""A Fourier series on top of a slow motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.excitation.trajectories.fourier import (
    TAYLOR,
    FourierMotion,
    smooth_extremes,
    wave_cells,
)
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion
from steelyard.excitation.trajectories.sampling import sampled
from steelyard.motion import Motion


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
