"""Samples of one topic between which the rows of another lie, streamed."""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from itertools import chain, islice

import numpy as np

from steelyard.arrays import Array

HEAD = 200
"""Samples from which a topic's usual step is learnt."""
FAR = 10.0
"""Usual steps between two samples beyond which nothing is known between them."""
KEPT = 64
"""Samples behind the rows that are kept for rows a little out of order."""

Sample = tuple[float, Array]
"""A stamp [s] and values."""


class Track:
    r"""Values of one topic at the stamps of another, linearly interpolated.

    $v(t) = v_k + (t - t_k)/(t_{k+1} - t_k)\,(v_{k+1} - v_k)$ for $t_k \le t \le t_{k+1}$; NaN
    before the first sample, after the last, and between two that are further apart than ten of the
    topic's usual steps. Samples that are not newer than the one before them, or newer than the one
    after them, are passed over. At most `KEPT` samples are in memory, however long the topic
    pauses.

    Args:
        samples: The topic's samples as recorded.
        width: Values of a sample.
    """

    def __init__(self, samples: Iterator[Sample], width: int) -> None:
        forward = _forward(samples)
        head = list(islice(forward, HEAD))
        steps = np.diff([t for t, _ in head])
        self._far = FAR * float(np.median(steps)) if len(steps) else 0.0
        self._samples = chain(head, forward)
        self._unknown = np.full(width, np.nan)
        self._times: deque[float] = deque(maxlen=KEPT)
        self._values: deque[Array] = deque(maxlen=KEPT)

    def at(self, t: float, reach: float) -> Array:
        """Values at one stamp, shape `(width,)`.

        Args:
            t: The stamp [s].
            reach: The stamp that rows have reached [s], behind which samples may be forgotten.
        """
        times = self._times
        while not times or times[-1] < reach:
            sample = next(self._samples, None)
            if sample is None:
                break
            times.append(sample[0])
            self._values.append(sample[1])
        if not times or not times[0] <= t <= times[-1]:
            return self._unknown
        k = bisect_left(times, t)
        if times[k] == t:
            return self._values[k]
        step = times[k] - times[k - 1]
        if step > self._far:
            return self._unknown
        before = self._values[k - 1]
        return before + (t - times[k - 1]) / step * (self._values[k] - before)


def _forward(samples: Iterator[Sample]) -> Iterator[Sample]:
    """Samples whose stamps rise, without those that a later one contradicts."""
    last = -np.inf
    current = next(samples, None)
    while current is not None:
        following = next(samples, None)
        if last < current[0] and (following is None or not current[0] > following[0]):
            last = current[0]
            yield current
        current = following
