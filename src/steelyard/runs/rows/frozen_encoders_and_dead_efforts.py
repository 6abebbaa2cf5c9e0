"""Stretches of a log in which an encoder is frozen, or an effort is dead.

A joint that comes to rest slows down before. The position of a frozen encoder stops or starts from
one row to the next, while others move. A measured effort has noise; a dead one keeps its value bit
for bit while its joint moves.
"""

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import DEAD, FROZEN, Channels, LeftOut
from steelyard.runs.rows.bridged_rows_segments_and_quality import Rows

MOVED = 0.01  # range of a joint that moves [rad; m]
FASTEST_SHARE, FASTEST_FACTOR = 0.995, 5.0
"""Quantile of a joint's changes that counts as its fastest, and how many times more is abrupt."""
FROZEN_ROWS, FROZEN_STEPS = 20, 10.0
"""Rows without any change from which on an encoder may be frozen, and least change of its step at
either end, in steps of its sensor."""
DEAD_ROWS, DEAD_STAYS = 20, 20.0
"""Rows without any change from which on an effort may be dead, and rows over those for which it
usually keeps a value."""
DEAD_MOTION = 0.1  # distance that its joint goes meanwhile, over its range in the log
MOST_DEAD = 0.9  # share of the rows from which on an effort is no measured one with dead stretches
ROWS_AT_ONCE = 100_000  # rows that are looked at together


def _stays(x: Array, least: float) -> list[tuple[int, int]]:
    """First and last row where a signal `(N,)` keeps one value for more than `least` rows."""
    edges = np.flatnonzero(np.diff(np.concatenate(([True], np.diff(x) != 0.0, [True]))))
    pairs = edges.reshape(-1, 2)
    return [(a, b) for a, b in pairs[np.diff(pairs, axis=1)[:, 0] >= least].tolist()]


def frozen_positions(q: Array, resolution: Array) -> tuple[Rows, ...]:
    """Where a position does not change, but others do, in rows `(N, n)`.

    Its step changes at one end, from one row to the next, by many times more than elsewhere;
    `resolution` is the smallest change of each position that is not zero, or zero, `(n,)`.
    """
    found = []
    for j, (x, least) in enumerate(zip(q.T, resolution, strict=True)):
        bend = np.abs(np.diff(x, n=2))
        if len(bend) <= FROZEN_ROWS or least == 0.0:
            continue
        abrupt = max(FASTEST_FACTOR * np.quantile(bend, FASTEST_SHARE), FROZEN_STEPS * least)
        for first, last in _stays(x, FROZEN_ROWS):
            ends = bend[[k - 1 for k in (first, last) if 0 < k <= len(bend)]]
            if np.any(ends > abrupt) and np.ptp(q[first : last + 1], axis=0).max() > MOVED:
                found.append((j, first, last))
    return tuple(found)


def dead_efforts(q: Array, effort: Array) -> tuple[Rows, ...]:
    """Where an effort keeps one value while its joint moves, in rows `(N, n)`."""
    found = []
    for j, (x, y) in enumerate(zip(q.T, effort.T, strict=True)):
        changes = int(np.count_nonzero(np.diff(y)))
        least = max(DEAD_ROWS, DEAD_STAYS * len(y) / max(changes, 1))
        far = max(MOVED, DEAD_MOTION * float(np.ptp(x))) if len(x) else np.inf
        held = [
            (j, first, last)
            for first, last in _stays(y, least)
            if np.ptp(x[first : last + 1]) > far
            and (y[first] == 0.0 or y.min() < y[first] < y.max())  # else it may be saturated
        ]
        if sum(last - first for _, first, last in held) < MOST_DEAD * len(y):
            found += held
    return tuple(found)


class FalseStretches:
    """The stretches of a recording, from its rows part by part.

    Frozen positions stay where repeated rows are kept, dead efforts where saturated ones are.
    """

    def __init__(self, channels: Channels, processing: Processing) -> None:
        self._channels, self._processing = channels, processing
        self._parts: list[tuple[Array, Array]] = []
        self._found: list[LeftOut] = []

    def add(self, t: Array, x: Array) -> None:
        """Take in rows that follow those before: time `(N,)` [s] and channels `(N, C)`."""
        self._parts.append((t, x))
        if sum(len(t) for t, _ in self._parts) >= ROWS_AT_ONCE:
            self._look()

    def found(self) -> tuple[LeftOut, ...]:
        """All of them, in the order of time."""
        self._look()
        return tuple(sorted(self._found, key=lambda s: s.start))

    def _look(self) -> None:
        if not self._parts:
            return
        t, x = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        self._parts = []
        q, effort = x[:, self._channels.q], x[:, self._channels.effort]
        frozen = frozen_positions(q, _resolution(q)) if self._processing.bridge_repeats else ()
        dead = dead_efforts(q, effort) if self._processing.leave_out_saturated else ()
        self._found += [LeftOut(float(t[a]), float(t[b]), FROZEN) for _, a, b in frozen]
        self._found += [LeftOut(float(t[a]), float(t[b]), DEAD, (j,)) for j, a, b in dead]


def _resolution(q: Array) -> Array:
    """Smallest change of each position `(N, n)` that is not zero; zero if none changes."""
    change = np.abs(np.diff(q, axis=0))
    tiny = 1e-12 * np.abs(q).max(axis=0)
    least = np.where(change > tiny, change, np.inf).min(axis=0, initial=np.inf)
    return np.where(np.isfinite(least), least, 0.0)
