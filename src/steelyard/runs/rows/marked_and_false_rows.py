"""Rows that are not to be believed: marked, bridged, counted; frozen encoders, dead efforts.

A joint that comes to rest slows down before. The position of a frozen encoder stops or starts from
one row to the next, while others move. A measured effort has noise; a dead one keeps its value bit
for bit while its joint moves.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import DEAD, FROZEN, Channels, LeftOut
from steelyard.runs.rows.faulty_row_detectors import (
    bridged,
    jolted,
    outlying,
    saturated,
    sensor_step,
    stale_rows,
    usual_bend,
    usual_distance,
)
from steelyard.runs.smoothing.zero_phase_filters import continued_at_ends

COUNTS_OF_MARKS = 4  # number of counts of `Marked`
BRIDGED, CUT_OFF = 1.0, 2.0
"""Flags of efforts: interpolated, so that the sample itself does not count; held at a limit, so
that its surroundings do not count either."""


@dataclass(frozen=True)
class Marked:
    """How many rows of a run were marked, values of a row counted one by one.

    Values bridged as outliers, of all channels; rows bridged as repeats of the row before; values
    of efforts held at a limit; and values of efforts among all these.
    """

    outliers: int = 0
    stale: int = 0
    cut_off: int = 0
    efforts: int = 0

    @property
    def words(self) -> str:
        """What was marked; empty if nothing was."""
        marks = (
            (self.outliers, "outlier", "interpolated"),
            (self.stale, "repeated row", "interpolated"),
            (self.cut_off, "effort", "at its limit left out"),
        )
        return ", ".join(
            f"{count} {one}{'s' * (count > 1)} {done}" for count, one, done in marks if count
        )


@dataclass(frozen=True, eq=False)
class RowChecks:
    """What is known of a log before its rows are judged; an operation on rows with a halo."""

    channels: Channels
    usual: Array  # see `usual_distance`, shape `(C,)`
    bend: Array  # see `usual_bend`, shape `(n,)`
    step: Array  # see `sensor_step`, shape `(n,)`
    limits: Array  # values at which efforts are cut off, shape `(n, 2)`; NaN for none
    threshold: float | None  # usual distances from which on a row is an outlier; `None`: none is
    bridge_stale: bool  # whether stale rows are bridged

    halo: ClassVar[int] = 20
    """Rows of context on each side: those that a mark and a bridge depend on."""

    @classmethod
    def of_excerpt(
        cls, channels: Channels, rows: Array, limits: Array, **given: Any
    ) -> "RowChecks":
        """What consecutive rows `(C, N)` of a log say about those to expect."""
        usual, q = frozen(usual_distance(rows)), rows[channels.q]
        bend, step = frozen(usual_bend(q)), frozen(sensor_step(q))
        return cls(channels, usual, bend, step, frozen(limits), **given)

    @property
    def idle(self) -> bool:
        """Whether no row can be marked."""
        return (
            self.threshold is None and not self.bridge_stale and bool(np.isnan(self.limits).all())
        )

    def applied(self, t: Array, x: Array, lacking: tuple[int, int]) -> tuple[Array, Array, Array]:
        """Rows bridged and flagged; of time `(M,)` and channels `(C, M)`, both with context.

        `lacking` rows of the context are not there, before and behind. Returned are time `(N,)`;
        channels with flags of efforts below, `(C + n, N)`; the counts of `Marked` for each row,
        `(4, N)`.
        """
        before, behind = (min(rows, self.halo) for rows in lacking)
        extended = continued_at_ends(np.concatenate((t[None], x)), before, behind)
        c, t, x = self.channels, extended[0], extended[1:]
        spikes = np.zeros(x.shape, dtype=np.bool_)
        if self.threshold is not None:
            spikes = outlying(x, self.usual, self.threshold)
            if spikes[c.effort].any():
                q = bridged(t, x[c.q], spikes[c.q], range(c.joints))
                spikes[c.effort] &= ~jolted(q, self.bend)
        repeats = np.zeros(x.shape, dtype=np.bool_)
        if self.bridge_stale and (rows := stale_rows(x[c.q], self.step)).any():
            repeats[:, 1:] = rows[1:] & (x[:, 1:] == x[:, :-1])
        marks = spikes | repeats
        smooth = range(c.effort.start)
        clipped = saturated(x[c.effort], self.limits)
        flags = np.where(clipped, CUT_OFF, np.where(marks[c.effort], BRIDGED, 0.0))
        marks[c.effort] &= ~clipped
        spikes[c.effort] &= ~clipped
        counts = (
            spikes.sum(axis=0),
            repeats[c.q].any(axis=0),
            clipped.sum(axis=0),
            np.count_nonzero(flags, axis=0),
        )
        inner = slice(self.halo, len(t) - self.halo)
        channels = np.concatenate((bridged(t, x, marks, smooth)[:, inner], flags[:, inner]))
        return t[inner], channels, np.stack(counts)[:, inner]


@dataclass(frozen=True)
class Segment:
    """A stretch of a run without a gap, from the time of its first row to that of its last [s]."""

    number: int  # its number in the clean recording
    start: float
    stop: float
    samples: int  # samples on the uniform clock


@dataclass(frozen=True, eq=False)
class Quality:
    """Counts and figures of a recording's window."""

    rows: int
    kept: int
    dropped: dict[str, int]  # reason to number of rows; reasons that did not occur are left out
    gaps: tuple[float, ...]  # times of the last row before each gap, from the log's start [s]
    rate: float  # of the uniform clock [Hz]
    # mean, standard deviation (the jitter), minimum and maximum of the steps of the log's clock,
    # gaps aside [s]
    steps: tuple[float, float, float, float]
    duration: float  # time from the first row to the last [s]
    resolution: Array  # smallest step of each position, shape `(n,)` [rad; m]
    effort_resolution: Array  # smallest step of each effort, shape `(n,)`
    max_speed: Array  # fastest motion of each joint, shape `(n,)` [rad/s; m/s]
    losses: tuple[str, ...]  # what else could not be used, in sentences
    notes: tuple[str, ...]  # what was decided from the data, in sentences
    marked: Marked = Marked()  # what was bridged, or does not count
    # times between the first row and the last that no segment covers: gaps, and stretches that are
    # shorter than the filters, from the log's start [s]
    unexamined: tuple[tuple[float, float], ...] = ()

    @property
    def rows_of_text(self) -> tuple[tuple[str, str], ...]:
        """Label and value, for tables."""
        mean, spread, least, most = (1e3 * step for step in self.steps)
        clock = f"{mean:.4g} ms mean step, {least:.4g} to {most:.4g} ms, jitter {spread:.2g} ms"
        return (
            ("rows", f"{self.kept} of {self.rows} used"),
            ("dropped", self._reasons or "none"),
            ("corrected", self.marked.words or "none"),
            ("duration", f"{self.duration:.2f} s"),
            ("clock", clock),
            ("gaps", ", ".join(f"{t:.2f} s" for t in self.gaps[:10]) or "none"),
            ("uniform clock", f"{self.rate:g} Hz"),
            ("position resolution", _numbers(self.resolution)),
            ("effort resolution", _numbers(self.effort_resolution)),
            ("maximum speed", _numbers(self.max_speed)),
            ("processing", "; ".join(self.notes)),
        )

    @property
    def dropped_rows(self) -> str:
        """How many rows were dropped and why, as a sentence; empty if none."""
        if not self.dropped:
            return ""
        return f"dropped {self.rows - self.kept} of {self.rows} rows: {self._reasons}"

    @property
    def _reasons(self) -> str:
        return ", ".join(f"{count} with {reason}" for reason, count in self.dropped.items())


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.2g}" for v in values)


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

Rows = tuple[int, int, int]
"""Joint, first and last row of a stretch."""


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
