"""Ways from rows at uneven times to times in between; each says how far it looks.

`CUBIC` runs, between two rows, the cubic that has their values and, as slopes there, those of the
parabola through each row and its neighbours: exact for parabolas, with a continuous slope. `PCHIP`
never overshoots [Fritsch1984], `SPLINE` has a continuous curvature, `LINEAR` has corners.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from steelyard.arrays import Array


class Interpolation(Protocol):
    """A way to values between rows."""

    @property
    def margin(self) -> int:
        """Rows needed beyond each end of the interval between two rows."""
        ...

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """Channels `(C, N)`, known at times `t`, at other times among these, `(C, len(at))`."""
        ...


@dataclass(frozen=True)
class Linear:
    """Straight lines."""

    margin: int = 0

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        i, u = _place(t, at)
        line: Array = x[:, i] + u * (x[:, i + 1] - x[:, i])
        return line


@dataclass(frozen=True)
class Worst:
    """The larger value of the rows before and after, for flags."""

    margin: int = 0

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        i, u = _place(t, at)
        after = np.where(u > 0.0, x[:, i + 1], x[:, i])
        return np.maximum(np.where(u < 1.0, x[:, i], after), after)


@dataclass(frozen=True)
class LocalCubic:
    """Cubics with the slopes of local parabolas."""

    margin: int = 1

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        step = np.diff(t)
        secant = np.diff(x, axis=1) / step
        slope = _slopes(step, secant)
        i, u = _place(t, at)
        h = step[i]
        a = slope[:, i] - secant[:, i]
        b = secant[:, i] - slope[:, i + 1]
        blend: Array = x[:, i] + u * h * (secant[:, i] + (1.0 - u) * ((1.0 - u) * a + u * b))
        return blend


@dataclass(frozen=True)
class Pchip:
    """Cubics with slopes that never overshoot."""

    margin: int = 1

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        from scipy.interpolate import PchipInterpolator

        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        values: Array = PchipInterpolator(t, x, axis=1)(at)
        return values


@dataclass(frozen=True)
class ThroughAll:
    """The cubic spline through all rows; a row's say falls by half or more from row to row."""

    margin: int = 60

    def __call__(self, t: Array, x: Array, at: Array) -> Array:
        """See `Interpolation`."""
        from scipy.interpolate import CubicSpline

        if len(t) == 1:
            return np.repeat(x, len(at), axis=1)
        values: Array = CubicSpline(t, x, axis=1)(at)
        return values


CUBIC = LocalCubic()
INTERPOLATIONS: dict[str, Interpolation] = {
    "cubic": CUBIC,
    "linear": Linear(),
    "pchip": Pchip(),
    "spline": ThroughAll(),
}
"""By the names they have in files."""


def _place(t: Array, at: Array) -> tuple[np.ndarray, Array]:
    """Row before each time, and how far between that and the next one the time is, in [0, 1]."""
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    return i, (at - t[i]) / (t[i + 1] - t[i])


def _slopes(step: Array, secant: Array) -> Array:
    """Slope at every row of the parabola through it and its neighbours, shape `(C, N)`."""
    slope = np.empty((len(secant), len(step) + 1))
    if len(step) == 1:
        slope[:] = secant
        return slope
    before, after = step[:-1], step[1:]
    slope[:, 1:-1] = (after * secant[:, :-1] + before * secant[:, 1:]) / (before + after)
    slope[:, 0] = 2.0 * secant[:, 0] - slope[:, 1]
    slope[:, -1] = 2.0 * secant[:, -1] - slope[:, -2]
    return slope
