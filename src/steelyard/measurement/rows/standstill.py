"""Where joints rest: a histogram of speeds that knows when each was first and last reached."""

import numpy as np

from steelyard.arrays import Array

PER_DECADE = 32
LOWEST, HIGHEST = -8, 4
"""Decades of speed, relative to the reference, that the histogram covers."""


class SpeedHistogram:
    """Speeds of all joints, in constant memory: logarithmic bins, 7.5 % wide.

    Args:
        reference: A speed per joint that is the edge of a bin, shape `(n,)` [rad/s; m/s].

    Attributes:
        highest: Highest speed of each joint, shape `(n,)` [rad/s; m/s].
    """

    def __init__(self, reference: Array) -> None:
        bins = (HIGHEST - LOWEST) * PER_DECADE + 1
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
            speed = np.maximum(np.abs(velocity) / self.reference[joint], 10.0**LOWEST)
            place = np.floor((np.log10(speed) - LOWEST) * PER_DECADE).astype(np.intp)
            np.clip(place, 0, self._count.shape[1] - 1, out=place)
            self._count[joint] += np.bincount(place, minlength=self._count.shape[1])
            bins, first = np.unique(place, return_index=True)
            last = len(place) - 1 - np.unique(place[::-1], return_index=True)[1]
            self._first[joint, bins] = np.minimum(self._first[joint, bins], t[first])
            self._last[joint, bins] = t[last]

    def quantile(self, share: float) -> Array:
        """Speed per joint below which a share of the samples is, shape `(n,)`."""
        below = np.cumsum(self._count, axis=1)
        place = [np.searchsorted(row, share * row[-1]) for row in below]
        return self.reference * self._edge(np.array(place) + 1)

    def edge_above(self, speed: Array) -> Array:
        """The lowest edges of bins that are not below `speed`, shape `(n,)`."""
        place = np.ceil((np.log10(speed / self.reference) - LOWEST) * PER_DECADE - 1e-6)
        return self.reference * self._edge(place)

    def moving(self, rest_speed: Array) -> tuple[float, float] | None:
        """First and last time at which any joint is faster than its rest speed (edges of bins)."""
        place = np.round((np.log10(rest_speed / self.reference) - LOWEST) * PER_DECADE)
        start = np.clip(place, 0, self._count.shape[1] - 1).astype(int)
        first = min(row[s:].min() for row, s in zip(self._first, start, strict=True))
        last = max(row[s:].max() for row, s in zip(self._last, start, strict=True))
        return None if first == np.inf else (float(first), float(last))

    def _edge(self, place: Array) -> Array:
        edge: Array = 10.0 ** (place / PER_DECADE + LOWEST)
        return edge
