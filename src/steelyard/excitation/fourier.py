r"""Finite Fourier series that start and end at rest.

Per joint, with $\omega = 2\pi / T$ and $H$ harmonics,

$$q(t) = q_0 + \sum_{k=1}^{H} a_k \sin k\omega t + b_k (\cos k\omega t - 1).$$

It leaves $q_0$ at rest and without acceleration if and only if $\sum k a_k = 0$ and
$\sum k^2 b_k = 0$: two linear conditions, so the admissible coefficients are a null space, and
position, velocity and acceleration are linear in its coordinates [Swevers1997].
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.motion import Motion


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
    rate = 2.0 * np.pi / period * np.arange(1.0, harmonics + 1.0)
    angle = np.asarray(t, dtype=np.float64)[:, None] * rate
    sin, cos = np.sin(angle), np.cos(angle)
    position = np.hstack([sin, cos - 1.0])
    velocity = np.hstack([cos * rate, -sin * rate])
    acceleration = np.hstack([-sin * rate**2, -cos * rate**2])
    return position, velocity, acceleration


@dataclass(frozen=True, eq=False)
class FourierMotion:
    """A periodic motion of all joints that starts and ends at rest.

    Attributes:
        start: Posture at both ends, shape `(n,)` [rad; m].
        sine: Coefficients `a`, shape `(n, H)` [rad; m].
        cosine: Coefficients `b`, shape `(n, H)` [rad; m].
        period: Base period [s].
        periods: How often the period is run through.
    """

    start: Array
    sine: Array
    cosine: Array
    period: float
    periods: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen(self.start, (None,)))
        object.__setattr__(self, "sine", frozen(self.sine, (len(self.start), None)))
        object.__setattr__(self, "cosine", frozen(self.cosine, self.sine.shape))
        if not (self.period > 0.0 and np.isfinite(self.period) and self.periods >= 1):
            raise ValueError(f"{self.periods} periods of {self.period} s are no motion")
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

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` [s]; at rest before its start and after its end."""
        t = frozen(t, (None,))
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
        )
