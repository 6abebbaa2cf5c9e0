"""Rows that are not to be believed: found, bridged where that is possible, and counted."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.measurement.chunks import apply
from steelyard.measurement.recording import Channels
from steelyard.measurement.rows.outliers import (
    bridged,
    jolted,
    outlying,
    sensor_step,
    usual_bend,
    usual_distance,
)
from steelyard.measurement.rows.saturation import saturated
from steelyard.measurement.rows.stale import stale

COUNTS = 4
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
        step: See `stale.sensor_step`, shape `(n,)`.
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
        if self.bridge_stale and (rows := stale(x[c.q], self.step)).any():
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
        self._counts = [0] * COUNTS
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
            counts = part[-COUNTS:, inside].sum(axis=1).astype(int).tolist()
            self._counts = [old + new for old, new in zip(self._counts, counts, strict=True)]
            yield part[0], part[1:-COUNTS].T
