"""What a first pass over a recording finds: clock, band of the motion, rows that are left out.

Left out are stretches in which an encoder is frozen, or an effort is dead. A joint that comes to
rest slows down before. The position of a frozen encoder stops or starts from one row to the next,
while others move. A measured effort has noise; a dead one keeps its value bit for bit while its
joint moves.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.runs.processing_chain import evenly_sampled
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import DEAD, FROZEN, Channels, LeftOut, Recording
from steelyard.runs.rows.bridged_rows_segments_and_quality import RowChecks, Rows, Segment
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
from steelyard.runs.rows.resampling import sample_count
from steelyard.runs.spectrum_and_period import Band, motion_band

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
        hinged = x[:, self._channels.encoders]
        repeats = self._processing.bridge_repeats
        frozen = frozen_positions(hinged, smallest_steps(hinged)) if repeats else ()
        dead = dead_efforts(q, effort) if self._processing.leave_out_saturated else ()
        self._found += [LeftOut(float(t[a]), float(t[b]), FROZEN) for _, a, b in frozen]
        self._found += [LeftOut(float(t[a]), float(t[b]), DEAD, (j,)) for j, a, b in dead]


def smallest_steps(x: Array) -> Array:
    """Smallest change of each channel `(N, C)` that is not zero; zero if none changes."""
    change = np.abs(np.diff(x, axis=0))
    tiny = 1e-12 * np.abs(x).max(axis=0, initial=0.0)
    least = np.where(change > tiny, change, np.inf).min(axis=0, initial=np.inf)
    return np.where(np.isfinite(least), least, 0.0)


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


def survey(
    recording: Recording, processing: Processing | None = None, inner: Survey | None = None
) -> Survey:
    """Read a recording once, and once more without rows in which an encoder was found frozen.

    Of a window of it that was looked through before, the `inner` one, noise and band are known.
    """
    found = _survey(recording, processing, inner)
    known = recording.left_out
    found_now = tuple(
        s
        for s in found.left_out
        if not any(
            k.start <= s.start and s.stop <= k.stop and {*s.joints} <= {*k.joints} for k in known
        )
    )
    if any(not s.joints for s in found_now):
        found = _survey(replace(recording, left_out=(*known, *found_now)), processing, inner)
    return replace(found, left_out=(*known, *found_now))


def _survey(recording: Recording, processing: Processing | None, inner: Survey | None) -> Survey:
    wanted = Processing() if processing is None else processing
    clock = learn_clock(recording)
    scan = RowScan(clock, recording)
    c = recording.channels
    tally = _Tally(c.count, c.effort)
    excerpt, false = _Excerpt(recording), FalseStretches(c, wanted)
    for piece in scan.pieces():
        tally.add(piece)
        if inner is None:
            excerpt.add(piece)
        false.add(piece.t, piece.x)
    counts = scan.counts
    logged, rate = _rates(recording, counts, tally, wanted.rate)
    spans = sorted(tally.spans.items())
    own: dict[str, Any] = {
        "clock": clock,
        "logged_rate": logged,
        "rate": rate,
        "segments": tuple(Segment(k, a, b, sample_count(a, b, rate)) for k, (a, b) in spans),
        "counts": tuple(counts.tolist()),
        "steps": tally.steps,
        "left_out": false.found(),
    }
    if inner is not None:
        return replace(inner, **own)
    # noise and motion, by an excerpt of the rows
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
        band = _band(even, logged, c)
        velocity_noise = motion_band(even[c.dq], logged).noise if c.velocities else velocity_noise
    return Survey(
        **own,
        resolution=frozen(resolution),
        band=band,
        velocity_noise=velocity_noise if c.velocities else None,
        row_checks=checks,
        even=even,
    )


def _band(even: Array, rate: float, c: Channels) -> Band:
    """Band of the joints' motion, with the noise of all positions, those of a base included."""
    velocities = even[c.dq] if c.velocities else None
    found = motion_band(even[c.encoders], rate, velocities)
    if not c.base:
        return found
    return replace(found, noise=motion_band(even[c.q], rate).noise)


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
            self._origin = x[0, self._channels.encoders].copy()
        start = 0
        if not self._current:
            far = np.abs(x[:, self._channels.encoders] - self._origin) > DEPARTURE_OF_MOTION
            gone = far.any(axis=1)
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
