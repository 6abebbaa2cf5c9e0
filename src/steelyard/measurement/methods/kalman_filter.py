r"""The method `kalman_filter`: the Kalman filter alone, which looks at no later sample.

What a controller could know of the motion at every time: estimates are late, where the smoother of
`kalman` is not. With constant acceleration and the cut-off $\omega_c$ of that smoother,
$\omega_c^6 = s / (r T)$, positions are estimated through

$$\frac{2 \omega_c p^2 + 2 \omega_c^2 p + \omega_c^3}{p^3 + 2 \omega_c p^2 + 2 \omega_c^2 p +
\omega_c^3}$$

for steps that are short against $1/\omega_c$, velocities without its first term and accelerations
without its first two: slow accelerations are $2/\omega_c$ late, of logged velocities
$\sqrt 2/\omega_c$.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.measurement.methods.auto import FASTEST
from steelyard.measurement.methods.kalman import filtered, likeliest_ratio

Cutoffs = tuple[float, ...]


@dataclass(frozen=True)
class CausalKalman:
    """Motion by the Kalman filter: of positions, and of logged velocities if there are any.

    Attributes:
        choose: Whether the cut-offs are found by maximum `"likelihood"`, joint by joint, or are the
            `"cutoff"` of the motion.
        cutoffs: Cut-off of each position [Hz]; found in the log if not given.
        velocity_cutoffs: Of each logged velocity [Hz], likewise.
    """

    name: ClassVar[str] = "kalman_filter"
    choose: Literal["likelihood", "cutoff"] = "likelihood"
    cutoffs: Cutoffs | None = None
    velocity_cutoffs: Cutoffs | None = None

    def designed(self, cutoff: float, rate: float) -> "DesignedFilter":
        """The filter for a cut-off [Hz], where none is found, and a rate [Hz]."""
        return DesignedFilter(self, cutoff, rate)

    def chosen(
        self, q: Array, dq: Array | None, rate: float, band: float, *, whole: bool
    ) -> "CausalKalman":
        """The same with the likeliest cut-offs of a log, no lower than its motion."""
        if self.choose == "cutoff":
            return self
        velocity = self.velocity_cutoffs
        if dq is not None and velocity is None:
            velocity = _likeliest(dq, 2, rate, band)
        position = self.cutoffs or _likeliest(q, 3, rate, band)
        return replace(self, cutoffs=position, velocity_cutoffs=velocity)

    def lateness(self, cutoff: float) -> float:
        """How late slow accelerations are [s]: those of the joint with the lowest cut-off.

        Args:
            cutoff: Of the motion [Hz].
        """
        if self.velocity_cutoffs is not None:
            return float(np.sqrt(2.0) / (2.0 * np.pi * min(self.velocity_cutoffs)))
        return 1.0 / (np.pi * min(self.cutoffs or (cutoff,)))


def _likeliest(x: Array, order: int, rate: float, band: float) -> Cutoffs:
    """The likeliest cut-off of every channel `(n, N)` [Hz]."""
    steps = np.ones(x.shape[1])
    ratios = np.array([likeliest_ratio(channel, steps, order) for channel in x])
    found = np.clip(ratios ** (0.5 / order) * rate / (2.0 * np.pi), band, FASTEST * rate)
    return tuple(float(f"{cutoff:.3g}") for cutoff in found)


@dataclass(frozen=True)
class DesignedFilter:
    """The filter for one rate; a sample depends on all before.

    Attributes:
        method: Its cut-offs.
        cutoff: Cut-off where it has none [Hz].
        rate: [Hz].
    """

    method: CausalKalman
    cutoff: float
    rate: float

    @property
    def halo(self) -> None:
        """None: a sample depends on all before."""
        return

    def __call__(self, q: Array, dq: Array | None) -> Array:
        """Positions and logged velocities, `(n, N)`, to `q, dq, ddq`, `(3, n, N)`."""
        position = self._states(q, self.method.cutoffs, 3)
        if dq is None:
            return position
        velocity = self._states(dq, self.method.velocity_cutoffs, 2)
        return np.stack((position[0], velocity[0], velocity[1]))

    def _states(self, x: Array, cutoffs: Cutoffs | None, order: int) -> Array:
        """Channels `(n, N)` and their derivatives as known at each sample, `(3, n, N)`."""
        given = (self.cutoff,) * len(x) if cutoffs is None else cutoffs
        if len(given) != len(x):
            raise LogError(
                f"there are {len(given)} cut-offs for {len(x)} joints",
                where="method 'kalman_filter' of [processing]",
                fix="give one per joint, or leave them out",
            )
        steps, result = np.ones(x.shape[1]), np.empty((3, *x.shape))
        for j, (channel, cutoff) in enumerate(zip(x, given, strict=True)):
            ratio = (2.0 * np.pi * cutoff / self.rate) ** (2 * order)
            kept = filtered(np.ascontiguousarray(channel), steps, ratio, order)
            gains = kept[:, 3:6] / kept[:, 10:]
            result[:, j] = (kept[:, :3] + gains * kept[:, 9:10]).T
        return result * (self.rate ** np.arange(3.0))[:, None, None]
