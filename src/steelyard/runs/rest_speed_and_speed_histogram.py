"""Speeds up to which joints count as at rest, and how often joints move at which speed."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.runs.processing_choices import Processing

BINS_PER_DECADE = 32
LOWEST_SPEED_DECADE, HIGHEST_SPEED_DECADE = -8, 4
"""Decades of speed, relative to the reference, that the histogram covers."""


class SpeedHistogram:
    """Speeds of all joints, in constant memory: logarithmic bins, 7.5 % wide.

    A speed per joint, `reference`, is the edge of a bin, beside the `highest` one; `(n,)`.
    """

    def __init__(self, reference: Array) -> None:
        bins = (HIGHEST_SPEED_DECADE - LOWEST_SPEED_DECADE) * BINS_PER_DECADE + 1
        self.reference = reference
        self.highest = np.zeros(len(reference))
        self._count = np.zeros((len(reference), bins), dtype=np.int64)
        self._first = np.full((len(reference), bins), np.inf)
        self._last = np.full((len(reference), bins), -np.inf)

    def add(self, t: Array, dq: Array) -> None:
        """Take in samples: time `(N,)` [s], increasing over calls, and velocity `(n, N)`."""
        if len(t) == 0:
            return
        for joint, velocity in enumerate(dq):
            self.highest[joint] = max(self.highest[joint], float(np.abs(velocity).max()))
            speed = np.maximum(np.abs(velocity) / self.reference[joint], 10.0**LOWEST_SPEED_DECADE)
            place = np.floor(_bin(speed)).astype(np.intp)
            np.clip(place, 0, self._count.shape[1] - 1, out=place)
            self._count[joint] += np.bincount(place, minlength=self._count.shape[1])
            bins, first = np.unique(place, return_index=True)
            last = len(place) - 1 - np.unique(place[::-1], return_index=True)[1]
            self._first[joint, bins] = np.minimum(self._first[joint, bins], t[first])
            self._last[joint, bins] = t[last]

    def quantile(self, share: float) -> Array:
        """Speed per joint below which a share of the samples is, shape `(n,)`."""
        place = [np.searchsorted(row, share * row[-1]) for row in np.cumsum(self._count, axis=1)]
        return self.reference * self._edge(np.array(place) + 1)

    def edge_above(self, speed: Array) -> Array:
        """The lowest edges of bins that are not below `speed`, shape `(n,)`."""
        return self.reference * self._edge(np.ceil(_bin(speed / self.reference) - 1e-6))

    def moving(self, rest_speed: Array) -> tuple[float, float] | None:
        """First and last time at which any joint is faster than its rest speed (edges of bins)."""
        place = np.round(_bin(rest_speed / self.reference))
        start = np.clip(place, 0, self._count.shape[1] - 1).astype(int)
        first = min(row[s:].min() for row, s in zip(self._first, start, strict=True))
        last = max(row[s:].max() for row, s in zip(self._last, start, strict=True))
        return None if first == np.inf else (float(first), float(last))

    def _edge(self, place: Array) -> Array:
        return np.asarray(10.0 ** (place / BINS_PER_DECADE + LOWEST_SPEED_DECADE))


def _bin(speed: Array) -> Array:
    """The bin, counted in fractions, of a speed over the reference."""
    return np.asarray((np.log10(speed) - LOWEST_SPEED_DECADE) * BINS_PER_DECADE)


REST_SHARE = 0.005  # rest speed over the speed that a joint exceeds 1 % of the time
REST_SHARE_OF_FASTEST = 0.001
"""Rest speed over the same speed of the fastest joint: slower ones are dragged, not driven."""
REST_NOISE = 4.0  # rest speed over the standard deviation of the velocity's noise
REST_STEPS = 2.0  # rest speed over the speed that one step of the sensor's resolution seems to be
REST_LOWEST = 1e-4  # lowest default rest speed [rad/s; m/s]
MOVING_OVER_REST = 2.0
"""Speed over rest speed at which a run's motion starts and ends: noise does not reach it."""


def default_rest_speed(fast: Array, noise: Array, step_speed: Array) -> Array:
    """Speed up to which a joint rests, shape `(n,)`.

    Args:
        fast: Speed that each joint exceeds 1 % of the time.
        noise: Standard deviation of each velocity's noise.
        step_speed: Speed that one step of each sensor's resolution seems to be.
    """
    slow = np.maximum(REST_SHARE * fast, max(REST_SHARE_OF_FASTEST * fast.max(), REST_LOWEST))
    return np.maximum(slow, np.maximum(REST_NOISE * noise, REST_STEPS * step_speed))


def given_rest_speed(processing: Processing, joints: int) -> Array | None:
    """The requested rest speeds, shape `(n,)`, or `None`."""
    if processing.rest_speed is None:
        return None
    speeds = np.atleast_1d(np.asarray(processing.rest_speed, dtype=np.float64))
    known = (np.isfinite(speeds) & (speeds > 0.0)).all() or not speeds.any()
    if len(speeds) not in (1, joints) or not known:
        raise LogError(
            f"rest speed {processing.rest_speed} does not fit {joints} joints",
            where="processing",
            fix=f"give one speed for all joints, or {joints} of them; 0: no joint rests",
        )
    return frozen(np.broadcast_to(speeds, (joints,)))


def rest_speed_of_runs(speeds: Sequence[Array], usual: Array) -> Array:
    """Speed up to which joints rest in all of some runs, shape `(n,)` [rad/s; m/s].

    The speed of a run, `(n,)`, is infinite where nothing moves; there the usual one counts.
    """
    return np.asarray(np.max([np.where(np.isfinite(one), one, usual) for one in speeds], axis=0))
