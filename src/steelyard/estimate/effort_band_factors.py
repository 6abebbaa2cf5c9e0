"""Half-widths of 95 % bands in standard deviations, by joint and speed: what left-out motion shows.

Noise gives a predicted effort the standard deviation $s$. What a model lacks adds to it, and only
motion that was not fitted shows how much: the 95 % quantile of $|e| / s$ over left-out samples, per
joint and per range of its speed, takes the place of 1.96 (split conformal prediction, every run
left out in turn [Vovk2005] [Barber2021]).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.estimate.external.contact_thresholds import ResidualPeaks

Kind = Literal["runs", "stretches"]

EDGES = (0.25, 1.0)  # where slow, medium, fast meet, in rms of a joint's speed while fitting
BINS = 2 + len(EDGES)  # ranges of speed: at rest, slow, medium, fast


@dataclass(frozen=True, eq=False)
class Calibration:
    """Half-widths of 95 % bands in standard deviations, by joint and speed.

    What parameters leave open counts with 1.96 at least.
    """

    kind: Kind  # whether whole runs were left out, or stretches of one motion
    count: int  # how many of them
    edges: Array  # speeds at which slow, medium and fast meet, shape `(n, 2)` [rad/s; m/s]
    factors: Array  # at rest, slow, medium, fast, `(n, 4)`; 1.96 where nothing left out tests
    peaks: ResidualPeaks | None = None  # left-out, for thresholds of contact; none in old models
    correlation: Array | None = None  # of left-out errors between joints, `(n, n)`

    def __post_init__(self) -> None:
        n = len(self.edges)
        set_fields(self, edges=frozen(self.edges, (n, len(EDGES))))
        set_fields(self, factors=frozen(self.factors, (n, BINS)))
        if self.correlation is not None:
            set_fields(self, correlation=frozen(self.correlation, (n, n)))

    @property
    def text(self) -> str:
        """What it rests on, for people to read."""
        if self.kind == "runs":
            return f"calibrated on {self.count} left-out runs"
        return f"calibrated on {self.count} left-out segments of one motion"

    def factor(self, speed: Array, moving: NDArray[np.bool_]) -> Array:
        """Half-width in standard deviations, shape `(n, B)`, as `speed` and `moving` are."""
        return np.take_along_axis(self.factors, bins(speed, moving, self.edges), axis=1)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "left_out": self.kind,
            "count": self.count,
            "speed_edges": self.edges.tolist(),
            "factors": self.factors.tolist(),
            "peaks": None if self.peaks is None else self.peaks.to_dict(),
            "correlation": None if self.correlation is None else self.correlation.tolist(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Calibration":
        """The calibration that `to_dict` wrote."""
        factors = np.array(data["factors"], dtype=np.float64)
        if not (np.isfinite(factors).all() and (factors > 0.0).all()):
            raise ValueError("a factor of the band's calibration is not a number above zero")
        if data["left_out"] not in ("runs", "stretches"):
            raise ValueError(f"a band cannot be calibrated on left-out '{data['left_out']}'")
        peaks, correlation = data.get("peaks"), data.get("correlation")
        if correlation is not None:
            correlation = np.array(correlation, dtype=np.float64)
            if not (np.linalg.eigvalsh(correlation) > 0.0).all():
                raise ValueError("the correlation of left-out errors is not positive definite")
        return cls(
            data["left_out"],
            int(data["count"]),
            np.array(data["speed_edges"]),
            factors,
            None if peaks is None else ResidualPeaks.from_dict(peaks),
            correlation,
        )


def bins(speed: Array, moving: NDArray[np.bool_], edges: Array) -> NDArray[np.intp]:
    """Range of speed of every sample: 0 at rest, then 1 to 3, shape `(n, B)`."""
    found = 1 + np.sum(np.abs(speed)[:, None, :] > edges[:, :, None], axis=1)
    return np.asarray(np.where(moving, found, 0), dtype=np.intp)
