"""Rows that are not to be believed: marked, bridged, counted; the quality of a recording."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.runs.recording import Channels
from steelyard.runs.rows.faulty_rows import (
    bridged,
    jolted,
    outlying,
    saturated,
    sensor_step,
    stale_rows,
    usual_bend,
    usual_distance,
)
from steelyard.runs.smoothing.filters import apply

COUNTS_FULLY = 4
"""Number of counts of `Marked`."""
BRIDGED, CUT_OFF = 1.0, 2.0
"""Flags of efforts: interpolated, so that the sample itself does not count; held at a limit, so
that its surroundings do not count either."""


@dataclass(frozen=True)
class Marked:
    """How many rows of a run were marked, values of a row counted one by one.

    Attributes:
        outliers: Values bridged as outliers, of all channels.
        stale: Rows bridged as repeats of the row before.
        cut_off: Values of efforts held at a limit.
        efforts: Values of efforts among all these.
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
    """What is known of a log before its rows are judged; an operation on rows with a halo.

    Attributes:
        channels: Order of the channels.
        usual: See `outliers.usual_distance`, shape `(C,)`.
        bend: See `outliers.usual_bend`, shape `(n,)`.
        step: See `stale_rows.sensor_step`, shape `(n,)`.
        limits: Values at which efforts are cut off, shape `(n, 2)`; NaN for none.
        threshold: Usual distances from which on a row is an outlier; `None`: none is.
        bridge_stale: Whether stale rows are bridged.
    """

    channels: Channels
    usual: Array
    bend: Array
    step: Array
    limits: Array
    threshold: float | None
    bridge_stale: bool

    halo = 20
    """Rows of context on each side: those that a mark and a bridge depend on."""

    @property
    def idle(self) -> bool:
        """Whether no row can be marked."""
        return (
            self.threshold is None and not self.bridge_stale and bool(np.isnan(self.limits).all())
        )

    def __call__(self, extended: Array) -> Array:
        """Time and channels `(1 + C, N + 2 halo)` to channels, flags and counts.

        Returns:
            Shape `(1 + C + n + 4, N)`: time, channels bridged, a flag per effort, and of each row
            the counts of `Marked`.
        """
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
        whole = np.concatenate((t[None], bridged(t, x, marks, smooth), flags, np.stack(counts)))
        return whole[:, self.halo : whole.shape[1] - self.halo]


def row_checks(
    channels: Channels,
    excerpt: Array,
    limits: Array,
    threshold: float | None,
    bridge_stale: bool,
) -> RowChecks:
    """What an excerpt of a log says about the rows to expect.

    Args:
        channels: Order of the channels.
        excerpt: Consecutive rows, shape `(C, N)`.
        limits: Values at which efforts are cut off, shape `(n, 2)`.
        threshold: See `RowChecks`.
        bridge_stale: See `RowChecks`.
    """
    return RowChecks(
        channels,
        frozen(usual_distance(excerpt)),
        frozen(usual_bend(excerpt[channels.q])),
        frozen(sensor_step(excerpt[channels.q])),
        frozen(limits),
        threshold,
        bridge_stale,
    )


class Marking:
    """Rows of segments as they come, marked and bridged.

    Args:
        row_checks: What is known of the log.
        window: Times between which rows are counted [s].
    """

    def __init__(
        self, row_checks: RowChecks, window: tuple[float, float] = (-np.inf, np.inf)
    ) -> None:
        self._counts = [0] * COUNTS_FULLY
        self._suspicion, self._window = row_checks, window

    @property
    def found(self) -> Marked:
        """What was marked so far."""
        return Marked(*self._counts)

    def rows(self, rows: Iterable[tuple[Array, Array]]) -> Iterator[tuple[Array, Array]]:
        """Time `(N,)` and channels `(N, C)` to time and channels and flags, `(N, C + n)`."""
        s = self._suspicion
        stacked = (np.concatenate((t[None], x.T)) for t, x in rows)
        for part in apply(s, stacked):
            inside = (part[0] >= self._window[0]) & (part[0] <= self._window[1])
            counts = part[-COUNTS_FULLY:, inside].sum(axis=1).astype(int).tolist()
            self._counts = [old + new for old, new in zip(self._counts, counts, strict=True)]
            yield part[0], part[1:-COUNTS_FULLY].T


@dataclass(frozen=True)
class Segment:
    """A stretch of a run without a gap.

    Attributes:
        number: Its number in the clean recording.
        start: Time of its first row [s].
        stop: Time of its last row [s].
        samples: Samples on the uniform clock.
    """

    number: int
    start: float
    stop: float
    samples: int


@dataclass(frozen=True, eq=False)
class Quality:
    """Counts and figures of a recording's window.

    Attributes:
        rows: Rows read.
        kept: Rows used.
        dropped: Reason to number of rows; reasons that did not occur are left out.
        repeated: Rows with the time of the row before; among the dropped.
        backward: Rows whose time runs backward; among the dropped.
        gaps: Times of the last row before each gap, from the log's start [s].
        short: Segments between gaps that are shorter than the filters.
        rate: Sampling rate of the uniform clock [Hz].
        step_mean: Mean step of the log's clock, gaps aside [s].
        step_std: Its standard deviation, the jitter [s].
        step_min: Shortest step [s].
        step_max: Longest step that is not a gap [s].
        duration: Time from the first row to the last [s].
        resolution: Smallest step of each position, shape `(n,)` [rad; m].
        effort_resolution: Smallest step of each effort, shape `(n,)`.
        max_speed: Fastest motion of each joint, shape `(n,)` [rad/s; m/s].
        losses: What else could not be used, in sentences.
        notes: What was decided from the data, in sentences.
        marked: What was bridged, or does not count.
        unexamined: Times between the first row and the last that no segment covers: gaps, and
            stretches that are shorter than the filters, from the log's start [s].
    """

    rows: int
    kept: int
    dropped: dict[str, int]
    repeated: int
    backward: int
    gaps: tuple[float, ...]
    short: int
    rate: float
    step_mean: float
    step_std: float
    step_min: float
    step_max: float
    duration: float
    resolution: Array
    effort_resolution: Array
    max_speed: Array
    losses: tuple[str, ...]
    notes: tuple[str, ...]
    marked: Marked = Marked()
    unexamined: tuple[tuple[float, float], ...] = ()

    @property
    def rows_of_text(self) -> tuple[tuple[str, str], ...]:
        """Label and value, for tables."""
        return (
            ("rows", f"{self.kept} of {self.rows} used"),
            ("dropped", self._reasons or "none"),
            ("corrected", self.marked.words or "none"),
            ("duration", f"{self.duration:.2f} s"),
            ("clock", self.clock_text),
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

    @property
    def clock_text(self) -> str:
        """The log's clock in words."""
        return (
            f"{1e3 * self.step_mean:.4g} ms mean step, {1e3 * self.step_min:.4g} to "
            f"{1e3 * self.step_max:.4g} ms, jitter {1e3 * self.step_std:.2g} ms"
        )


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.2g}" for v in values)
