"""Motions of polynomials, one after another."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import factorial, perm
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.trajectories.bernstein import differentiated, polynomial_extremes
from steelyard.excitation.trajectories.sampling import sampled
from steelyard.motion import Motion

JOIN = 1e-9
"""Positions that differ by less than this are one [rad; m], relative to values above 1."""


@dataclass(frozen=True, eq=False)
class PiecewiseMotion:
    r"""Polynomials of all joints between shared times.

    Between `breaks` $t_p$ and $t_{p+1}$, with $\tau = (t - t_p) / (t_{p+1} - t_p)$, joint `j` is at
    $\sum_i c_{pij} \tau^i$. At a break, derivatives are those of the piece that begins.

    Attributes:
        breaks: Ascending from 0, shape `(p + 1,)` [s].
        coefficients: Shape `(p, d + 1, n)` [rad; m].
    """

    breaks: Array
    coefficients: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "breaks", frozen(self.breaks, (None,)))
        pieces = len(self.breaks) - 1
        if pieces < 1 or self.breaks[0] != 0.0 or not np.all(np.diff(self.breaks) > 0.0):
            raise ValueError("the breaks of a motion rise from 0, and there are two or more")
        object.__setattr__(self, "coefficients", frozen(self.coefficients, (pieces, None, None)))
        if not (np.isfinite(self.breaks).all() and np.isfinite(self.coefficients).all()):
            raise ValueError("a break or a coefficient of the motion is not finite")
        if self.coefficients.shape[1] == 0:
            raise ValueError("the pieces of the motion have no coefficients")
        ends, starts = self.coefficients[:-1].sum(axis=1), self.coefficients[1:, 0]
        check_join(ends, starts, self.breaks[1:-1])

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.breaks[-1])

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Any order, 0 for the position, at times from 0 to the duration, shape `(N, n)`."""
        t = np.asarray(t, dtype=np.float64)
        last = len(self.coefficients) - 1
        piece = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, last)
        width = np.diff(self.breaks)[piece]
        share = np.clip((t - self.breaks[piece]) / width, 0.0, 1.0)[:, None]
        values = np.zeros((len(t), self.coefficients.shape[2]))
        for power in range(self.coefficients.shape[1] - 1, order - 1, -1):
            values = values * share + perm(power, order) * self.coefficients[piece, power]
        return np.asarray(values / width[:, None] ** order)

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; both sides of a break count."""
        return polynomial_extremes(differentiated(self.coefficients, np.diff(self.breaks), order))

    def sample(self, t: ArrayLike) -> Motion:
        """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
        return sampled(self, t)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; numbers keep all their digits."""
        return {
            "kind": "piecewise",
            "breaks_s": self.breaks.tolist(),
            "coefficients": self.coefficients.tolist(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "PiecewiseMotion":
        """The inverse of `to_dict`."""
        return cls(values["breaks_s"], values["coefficients"])


def check_join(ends: Array, starts: Array, times: Array) -> None:
    """Postures before and after each of the times, both `(k, n)`, are the same.

    Raises:
        ValueError: A joint jumps; says which, when and how far.
    """
    jump = np.abs(starts - ends)
    excess = jump - JOIN * np.maximum(1.0, np.abs(ends))
    if np.any(excess > 0.0):
        row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
        raise ValueError(
            f"the parts of the motion do not join: joint {joint + 1} jumps by "
            f"{jump[row, joint]:.3g} at {times[row]:.6g} s"
        )


def from_scipy(curve: Any) -> PiecewiseMotion:
    """The motion of a `scipy.interpolate` `PPoly` or `BSpline` with values of shape `(n,)`."""
    if hasattr(curve, "k"):
        degree, knots = curve.k, curve.t[curve.k : len(curve.t) - curve.k]
    else:
        degree, knots = len(curve.c) - 1, curve.x
    knots = np.unique(knots)
    width = np.diff(knots)[:, None]
    pieces = [curve(knots[:-1], i) * (width**i / factorial(i)) for i in range(degree + 1)]
    return PiecewiseMotion(knots, np.stack(pieces, axis=1))
