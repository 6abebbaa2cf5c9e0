"""Rows that are marked and bridged, before a run is used; counts of them: the quality of a log."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.runs.recording import Channels
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
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import continued_at_ends

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
            # impacts and changes of contact are no outliers
            spikes[: c.base] = spikes[c.pushed] = spikes[c.touched] = False
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


Rows = tuple[int, int, int]  # joint, first and last row of a stretch
