"""What a first pass over a recording finds: clock, band of the motion, rows that are left out."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.runs.processing_chain import evenly_sampled
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LeftOut, Recording
from steelyard.runs.rows.bridged_rows_segments_and_quality import RowChecks, Segment
from steelyard.runs.rows.clock_and_row_scan import (
    SHORTEST_CHAIN,
    Clock,
    RowPiece,
    RowScan,
    learn_clock,
    nice_rate,
    not_followed,
    nothing_left,
)
from steelyard.runs.rows.faulty_row_detectors import Extremes, RowVerdict
from steelyard.runs.rows.frozen_encoders_and_dead_efforts import FalseStretches
from steelyard.runs.rows.resampling import sample_count
from steelyard.runs.spectrum_and_period import Band, motion_band

EXCERPT_ROWS = 100_000  # rows from which the motion's band is learnt
MOST_RATE_FACTOR = 4.0
"""Highest rate that can be requested, over the log's: more adds samples, but nothing to them."""
DEPARTURE_OF_MOTION = 0.01
"""How far a joint must be from where it started for the excerpt to begin [rad; m]."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What the first pass found."""

    clock: Clock
    logged_rate: float  # rate of the log, rounded, beside that of the uniform clock [Hz]
    rate: float
    segments: tuple[Segment, ...]
    counts: tuple[int, ...]  # rows per `RowVerdict`
    # mean, standard deviation, minimum and maximum of the log's steps [s]
    steps: tuple[float, float, float, float]
    resolution: Array  # smallest step of each channel that is not zero, shape `(C,)`
    band: Band
    # noise density of logged velocities, shape `(n,)`; `None` without them
    velocity_noise: Array | None
    row_checks: RowChecks
    # positions, and velocities if logged, of a stretch at the log's rate, `(n or 2n, N)`
    even: Array
    left_out: tuple[LeftOut, ...] = ()  # stretches that do not count

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return self.segments[-1].stop - self.segments[0].start


def no_joint_moves(recording: Recording) -> LogError:
    """The error of a log at standstill."""
    return LogError(
        "no joint moves in this log",
        where=recording.where,
        fix="record a motion of all joints; a log at standstill does not identify a robot",
    )


def survey(recording: Recording, processing: Processing | None = None) -> Survey:
    """Read a recording once, and once more without rows in which an encoder was found frozen."""
    found = _survey(recording, processing)
    known = recording.left_out
    found_now = tuple(
        s
        for s in found.left_out
        if not any(
            k.start <= s.start and s.stop <= k.stop and {*s.joints} <= {*k.joints} for k in known
        )
    )
    if any(not s.joints for s in found_now):
        found = _survey(replace(recording, left_out=(*known, *found_now)), processing)
    return replace(found, left_out=(*known, *found_now))


def _survey(recording: Recording, processing: Processing | None) -> Survey:
    wanted = Processing() if processing is None else processing
    clock = learn_clock(recording)
    scan = RowScan(clock, recording)
    c = recording.channels
    tally = _Tally(c.count, c.effort)
    excerpt, false = _Excerpt(recording), FalseStretches(c, wanted)
    for piece in scan.pieces():
        tally.add(piece)
        excerpt.add(piece)
        false.add(piece.t, piece.x)
    counts = scan.counts
    logged, rate = _rates(recording, counts, tally, wanted.rate)
    resolution = np.where(np.isfinite(tally.resolution), tally.resolution, 0.0)
    limits = tally.extremes.limits(resolution[c.effort])
    if not wanted.leave_out_saturated:
        limits = np.full_like(limits, np.nan)
    checks = RowChecks.of_excerpt(
        c, excerpt.rows, limits, threshold=wanted.outliers, bridge_stale=wanted.bridge_repeats
    )
    even = excerpt.even(logged, checks)
    band, velocity_noise = Band(0.0, np.zeros(c.joints)), np.zeros(c.joints)
    if even.shape[1] >= SHORTEST_CHAIN:
        band = motion_band(even[c.q], logged, even[c.dq] if c.velocities else None)
        velocity_noise = motion_band(even[c.dq], logged).noise if c.velocities else velocity_noise
    return Survey(
        clock=clock,
        logged_rate=logged,
        rate=rate,
        segments=tuple(
            Segment(number, start, stop, sample_count(start, stop, rate))
            for number, (start, stop) in sorted(tally.spans.items())
        ),
        counts=tuple(counts.tolist()),
        steps=tally.steps,
        resolution=frozen(resolution),
        band=band,
        velocity_noise=velocity_noise if c.velocities else None,
        row_checks=checks,
        even=even,
        left_out=false.found(),
    )


def _rates(
    recording: Recording, counts: NDArray[np.int64], tally: "_Tally", wanted: float | None
) -> tuple[float, float]:
    kept = counts[RowVerdict.KEPT]
    if kept == 0:
        raise nothing_left(recording, counts)
    if counts[[RowVerdict.REPEATED, RowVerdict.BACKWARD, RowVerdict.JUMP]].sum() > kept:
        raise not_followed(recording, counts)
    if tally.count < SHORTEST_CHAIN:
        raise LogError(
            f"the log is shorter than any filter: {kept} rows can be used",
            where=recording.where,
            fix="record for longer, or widen the window",
        )
    logged = nice_rate(tally.total / tally.count)
    rate = logged if wanted is None else wanted
    if rate > MOST_RATE_FACTOR * logged:
        raise LogError(
            f"a rate of {rate:g} Hz is far above the log's {logged:g} Hz",
            where=recording.where,
            fix=f"choose a rate up to {MOST_RATE_FACTOR * logged:g} Hz in [processing], or "
            "leave it out",
        )
    return logged, rate


class _Tally:
    """Steps of the clock and of the channels, and where segments start and stop."""

    def __init__(self, channels: int, effort: slice) -> None:
        self._effort, self.extremes = effort, Extremes(effort.stop - effort.start)
        self.resolution = np.full(channels, np.inf)
        self.spans: dict[int, tuple[float, float]] = {}
        self.count, self.total = 0, 0.0
        self._squares, self._least, self._most = 0.0, np.inf, 0.0
        self._last: RowPiece | None = None

    def add(self, piece: RowPiece) -> None:
        t, x = piece.t, piece.x
        last = self._last
        if last is not None and last.segment != piece.segment:
            self.extremes.end_segment()
            last = None
        self.extremes.add(np.ascontiguousarray(x[:, self._effort].T))
        if last is not None:
            t, x = np.concatenate((last.t, t)), np.concatenate((last.x, x))
        self._last = RowPiece(piece.segment, t[-1:].copy(), x[-1:].copy())
        start = self.spans.get(piece.segment, (float(t[0]), 0.0))[0]
        self.spans[piece.segment] = start, float(t[-1])
        if len(t) < 2:
            return
        step = np.diff(t)
        self.count += len(step)
        self.total += float(step.sum())
        self._squares += float(step @ step)
        self._least = min(self._least, float(step.min()))
        self._most = max(self._most, float(step.max()))
        change = np.abs(np.diff(x, axis=0))
        change[change == 0.0] = np.inf
        self.resolution = np.minimum(self.resolution, change.min(axis=0))

    @property
    def steps(self) -> tuple[float, float, float, float]:
        mean = self.total / self.count
        spread = np.sqrt(max(self._squares / self.count - mean * mean, 0.0))
        return mean, float(spread), self._least, self._most


class _Excerpt:
    """Rows of one segment, from the first departure on: the longest of the first segments.

    If no joint ever departs, these are the first rows, which hold the noise.
    """

    def __init__(self, recording: Recording) -> None:
        self._channels = recording.channels
        self._longest: list[RowPiece] = []
        self._current: list[RowPiece] = []
        self._still: list[RowPiece] = []
        self._origin: Array | None = None

    def add(self, piece: RowPiece) -> None:
        if _length(self._longest) >= EXCERPT_ROWS:
            return
        if self._current and self._current[0].segment != piece.segment:
            self._current = []
        x = piece.x
        if self._origin is None:
            self._origin = x[0, self._channels.q].copy()
        start = 0
        if not self._current:
            gone = (np.abs(x[:, self._channels.q] - self._origin) > DEPARTURE_OF_MOTION).any(axis=1)
            start = int(np.argmax(gone)) if gone.any() else len(x)
        rests = start == len(x) and not self._longest
        if rests and (not self._still or self._still[0].segment == piece.segment):
            _fill(self._still, piece, 0)
        if start < len(x):
            self._still = []
            _fill(self._current, piece, start)
        if _length(self._current) > _length(self._longest):
            self._longest = self._current

    @property
    def rows(self) -> Array:
        """All its rows, shape `(C, N)`."""
        pieces = [piece.x for piece in self._longest or self._still]
        return np.concatenate(pieces).T if pieces else np.zeros((self._channels.count, 0))

    def even(self, rate: float, checks: RowChecks) -> Array:
        """Positions, and velocities if logged, on the uniform clock, shape `(n or 2n, N)`."""
        pieces, moved = self._longest or self._still, self._channels.effort.start
        if _length(pieces) < SHORTEST_CHAIN:
            return np.zeros((moved, 0))
        return evenly_sampled(pieces, slice(0, moved), rate, checks)


def _fill(pieces: list[RowPiece], piece: RowPiece, start: int) -> None:
    """Add the rows of a piece from `start` on, as long as there is room."""
    if (room := EXCERPT_ROWS - _length(pieces)) > 0:
        inside = slice(start, start + room)
        pieces.append(RowPiece(piece.segment, piece.t[inside].copy(), piece.x[inside].copy()))


def _length(pieces: list[RowPiece]) -> int:
    return sum(len(piece.t) for piece in pieces)
