"""What was found in a log, and what was done about it."""

from dataclasses import dataclass

from steelyard.arrays import Array
from steelyard.measurement.rows.marking import Marked


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
