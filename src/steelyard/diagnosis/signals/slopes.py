"""Derivatives of positions behind a Gaussian: quick, without delay, alike for all signals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.signal_overview import SignalOverview

WIDTH = 0.02
"""Standard deviation of the low-pass [s]: half the power is gone at 6.6 Hz."""
SHORTEST_WIDTH = 1.5
"""The same in samples, at least."""
ENDS = 4.0
"""Widths of the Gaussian on each side that are taken into account."""
STILL = 3e-4
"""Share of the fastest joint's rms speed below which a joint rests, in whatever unit it is."""
RANGE_STEPS, RANGE_NOISE = 30.0, 10.0
"""Range of a joint that moves, in steps of its sensor and in standard deviations of its noise."""


def noise_of(x: Array) -> Array:
    """Standard deviation of white noise in signals `(N, C)`, by second differences, `(C,)`."""
    if len(x) < 3:
        return np.zeros(x.shape[1])
    noise: Array = np.sqrt(np.square(np.diff(x, n=2, axis=0)).mean(axis=0) / 6.0)
    return noise


def width_of(rate: float) -> float:
    """Standard deviation of the low-pass at a rate [s]."""
    return max(WIDTH, SHORTEST_WIDTH / rate)


def smooth(x: Array, rate: float) -> Array:
    """Signals `(C, N)` behind the Gaussian, without its ends: shape `(C, fewer)`."""
    return _convolved(x, _bell(rate))


def slope(x: Array, rate: float) -> Array:
    """Their derivatives behind the same Gaussian, at the same times [1/s]."""
    bell = _bell(rate)
    at = np.arange(len(bell)) - len(bell) // 2
    kernel = -at * bell
    return _convolved(x, kernel * (rate / -(at @ kernel)))


def _bell(rate: float) -> Array:
    width = width_of(rate) * rate
    half = int(np.ceil(ENDS * width))
    bell: Array = np.exp(-0.5 * (np.arange(-half, half + 1) / width) ** 2)
    bell /= bell.sum()
    return bell


def _convolved(x: Array, kernel: Array) -> Array:
    if x.shape[1] < len(kernel):
        return np.zeros((len(x), 0))
    return np.stack([np.convolve(row, kernel, "valid") for row in x])


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of the positions in all stretches together.

    Attributes:
        t: Time, shape `(N,)` [s as declared].
        v: Derivatives, shape `(n, N)` [declared unit per true second].
        rate: [Hz].
        moving: Joints that move enough to say anything about, shape `(n,)`.
    """

    t: Array
    v: Array
    rate: float
    moving: NDArray[np.bool_]


def slopes(overview: SignalOverview, second: float = 1.0) -> Slopes:
    """Derivatives of the positions, and which joints move.

    Args:
        overview: The log.
        second: Seconds that a declared second really has.
    """
    even, rate = overview.even(np.column_stack((overview.t, overview.q)), second)
    half = len(_bell(rate)) // 2
    pieces = [(x[0, half : x.shape[1] - half], slope(x[1:], rate)) for x in even]
    pieces = [(t, v) for t, v in pieces if v.shape[1]]
    n = overview.channels.joints
    t = np.concatenate([np.zeros(0), *(t for t, _ in pieces)])
    v = np.concatenate([np.zeros((n, 0)), *(v for _, v in pieces)], axis=1)
    return Slopes(t, v, rate, moving(overview, v))


def moving(overview: SignalOverview, v: Array) -> NDArray[np.bool_]:
    """Joints that move enough to say anything about, shape `(n,)`.

    Args:
        overview: The log.
        v: Derivatives of its positions, shape `(n, any)`.
    """
    n = overview.channels.joints
    if v.shape[1] == 0:
        return np.zeros(n, dtype=np.bool_)
    speed = np.sqrt(np.square(v).mean(axis=1))
    steps = RANGE_STEPS * overview.resolution[overview.channels.q]
    spread = np.ptp(overview.q, axis=0)
    far = (spread > 0.0) & (spread >= np.maximum(steps, RANGE_NOISE * noise_of(overview.q)))
    enough: NDArray[np.bool_] = far & (speed >= STILL * speed.max())
    return enough
