"""The chain from a log's rows to motion and effort on a uniform clock, in constant memory."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import ceil

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.processing import Processing
from steelyard.runs.recording import Channels, Recording
from steelyard.runs.rows.clock import Clock, RowPiece, RowScan
from steelyard.runs.rows.resampling import (
    INTERPOLATIONS,
    THINNING_PASSBAND,
    Lane,
    Thinning,
    WorstReach,
    uniform,
)
from steelyard.runs.rows.row_checks import CUT_OFF, Marking, RowChecks
from steelyard.runs.smoothing.auto import Auto
from steelyard.runs.smoothing.filters import apply, continued_at_ends
from steelyard.runs.smoothing.method import Causal, Designed, Smooth

SATURATION_SPREAD = 0.5
"""How far around an effort at its limit samples do not count, in periods of the regression cut-off:
half the length over which the parallel filter mixes them."""

CONTEXT_PERIODS = 4.0
"""How far methods that are given whole segments look beyond a window, in periods of the cut-off."""


@dataclass(frozen=True, eq=False)
class MotionPart:
    """Samples of a segment on the uniform clock.

    Attributes:
        segment: Number of the segment.
        start: Number of the first sample in it.
        signals: `q, dq, ddq, effort`, shape `(4 n, N)`.
        weights: How much each effort counts, shape `(n, N)`; `None` if all count alike.
    """

    segment: int
    start: int
    signals: Array
    weights: Array | None


@dataclass(frozen=True, eq=False)
class Chain:
    """What is done with a recording's rows, with every choice made.

    Attributes:
        processing: The choices; cut-offs are numbers.
        clock: The log's clock.
        rate: Of the uniform clock [Hz].
        thinning: Samples of the clock that rows are brought to over samples that are left.
        row_checks: What is known of rows that are not to be believed.
        flagged: Whether any effort is marked, so that flags are worth carrying.
        before: What the rows are already, in words.
    """

    processing: Processing
    clock: Clock
    rate: float
    thinning: int
    row_checks: RowChecks
    flagged: bool = True
    before: str = ""

    @property
    def motion_cutoff(self) -> float:
        """Low-pass of the motion [Hz]."""
        return float(self.processing.motion_cutoff or 0.0)

    @property
    def matched_cutoff(self) -> float:
        """Low-pass of regressor and effort alike, which the pass applies [Hz]."""
        return float(self.processing.matched_cutoff or 0.0)

    @property
    def words(self) -> str:
        """The stages, for reports."""
        p, s = self.processing, self.row_checks
        stages = [self.before] if self.before else []
        stages += [
            "outliers kept"
            if s.threshold is None
            else f"Hampel threshold {s.threshold:g} scaled MAD"
        ]
        if s.bridge_stale:
            stages.append("repeated rows interpolated")
        if not np.isnan(s.limits).all():
            stages.append("efforts at their limit left out")
        stages.append(f"{p.resampling} to {self.rate:g} Hz")
        if self.thinning > 1:
            stages[-1] += f" behind a low-pass of {THINNING_PASSBAND * self.rate:g} Hz"
        stages += [f"motion {self._motion_words}", p.effort_words]
        return ", ".join(stages)

    @property
    def _motion_words(self) -> str:
        """How positions become motion."""
        motion, at = self.processing.motion, f"{self.motion_cutoff:g} Hz"
        if isinstance(motion, Auto):
            return f"by {self.processing.motion_words}, motion cut-off {at}"
        late = ""
        if isinstance(motion, Causal):
            delay = 1e3 * motion.lateness(self.motion_cutoff)
            late = f"; causal: slow accelerations {delay:.2g} ms late"
        return f"by {self.processing.motion_words} ({at}{late})"

    def operation(self, channels: Channels) -> "ToMotion":
        """The local part of the chain, on the uniform clock."""
        p, rate = self.processing, self.rate
        smooth = None
        if p.effort is not None:
            smooth = p.effort.smooth(p.effort_cutoff or self.motion_cutoff, rate)
        spread = ceil(SATURATION_SPREAD * rate / self.matched_cutoff) if self.flagged else None
        return ToMotion(channels, p.motion.designed(self.motion_cutoff, rate), smooth, spread)

    def context(self, recording: Recording) -> float:
        """How far beyond a window the chain looks [s]."""
        operation = self.operation(recording.channels)
        seconds = operation.halo / self.rate
        if operation.whole:
            seconds += CONTEXT_PERIODS / self.motion_cutoff
        if self.thinning > 1:
            seconds += Thinning.design(self.thinning).halo / (self.rate * self.thinning)
        lags = recording.signals.velocity_delay, recording.signals.effort_delay
        return seconds + max(abs(lag) for lag in lags) + self.row_checks.halo * self.clock.step

    def parts(
        self, recording: Recording, segments: Sequence[int], marking: Marking | None = None
    ) -> Iterator[MotionPart]:
        """Signals and weights of segments on the uniform clock.

        Args:
            recording: Raw rows.
            segments: Numbers of the segments wanted.
            marking: Counts what is marked; by default nothing is counted.
        """
        operation = self.operation(recording.channels)
        marking = Marking(self.row_checks) if marking is None else marking
        n = recording.channels.joints
        pieces = RowScan(self.clock, recording).pieces()
        for number, of_segment in groupby(pieces, key=lambda piece: piece.segment):
            if number not in segments:
                continue
            start = 0
            for part in operation.over(self._uniform(recording, of_segment, marking)):
                weights = part[4 * n :] if self.flagged else None
                yield MotionPart(number, start, part[: 4 * n], weights)
                start += part.shape[1]

    def _uniform(
        self, recording: Recording, pieces: Iterable[RowPiece], marking: Marking
    ) -> Iterator[Array]:
        """One segment's channels on the uniform clock; flags below them if they are carried."""
        c, s = recording.channels, recording.signals
        rows: Iterable[tuple[Array, Array]] = ((p.t, p.x) for p in pieces)
        if not self.row_checks.idle:
            rows = marking.rows(rows)
            if not self.flagged:
                rows = ((t, x[:, : c.count]) for t, x in rows)
        elif self.flagged:
            rows = ((t, np.pad(x, ((0, 0), (0, c.joints)))) for t, x in rows)
        even = uniform(
            rows, self.rate * self.thinning, self._lanes(c, s.velocity_delay, s.effort_delay)
        )
        if self.thinning == 1:
            return even
        return Thinning.design(self.thinning, c.joints if self.flagged else 0).thinned(even)

    def _lanes(self, c: Channels, velocity_delay: float, effort_delay: float) -> list[Lane]:
        kind = INTERPOLATIONS[self.processing.resampling]
        lanes = [
            Lane(c.q, kind),
            Lane(c.dq, kind, velocity_delay),
            Lane(c.effort, kind, effort_delay),
        ]
        joined: list[Lane] = []
        for lane in (one for one in lanes if one.channels.start < one.channels.stop):
            if joined and joined[-1].lag == lane.lag:
                whole = slice(joined[-1].channels.start, lane.channels.stop)
                joined[-1] = replace(lane, channels=whole)
            else:
                joined.append(lane)
        if self.flagged:
            joined.append(Lane(slice(c.count, c.count + c.joints), WorstReach(), effort_delay))
        return joined


class ToMotion:
    """Channels on the uniform clock to `q, dq, ddq, effort` and weights.

    Args:
        channels: Order of the channels.
        motion: From positions, and velocities if they are logged, to motion.
        effort: Smooths efforts; `None`: they pass unchanged.
        spread: Samples around an effort at its limit that do not count either; `None`: there are
            no flags.
    """

    def __init__(
        self, channels: Channels, motion: Designed, effort: Smooth | None, spread: int | None
    ) -> None:
        self._channels, self._motion, self._effort = channels, motion, effort
        self._spread = spread

    @property
    def _halos(self) -> tuple[int | None, int | None, int]:
        effort = 0 if self._effort is None else self._effort.halo
        return self._motion.halo, effort, self._spread or 0

    @property
    def whole(self) -> bool:
        """Whether a segment must be given at once."""
        return None in self._halos

    @property
    def halo(self) -> int:
        """Samples of context on each side that the local parts need."""
        return max(halo or 0 for halo in self._halos)

    def over(self, parts: Iterable[Array]) -> Iterator[Array]:
        """One segment: channels, and flags, in parts, to signals and weights."""
        if not self.whole:
            yield from apply(self, parts)
            return
        collected = list(parts)
        if collected:
            yield self(continued_at_ends(np.concatenate(collected, axis=-1), self.halo, self.halo))

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)`, flags below, to signals `(4 n, N)`, weights below."""
        c = self._channels
        motion, effort, spread = (self.halo - (halo or 0) for halo in self._halos)
        inner = extended[:, motion : extended.shape[1] - motion]
        velocity = inner[c.dq] if c.velocities else None
        signals = self._motion(inner[c.q], velocity)
        measured = extended[c.effort, effort : extended.shape[1] - effort]
        if self._effort is not None:
            measured = self._effort(measured)
        rows = [*signals, measured]
        if self._spread is not None:
            flags = np.abs(extended[c.count :, spread : extended.shape[1] - spread])
            rows.append(_weights(flags, self._spread))
        return np.concatenate(rows)


def _weights(flags: Array, spread: int) -> Array:
    """Weights of efforts from their flags.

    Args:
        flags: With context, shape `(n, N + 2 spread)`.
        spread: Samples around an effort at its limit that do not count either.
    """
    count = np.cumsum(np.pad(flags >= CUT_OFF, ((0, 0), (1, 0))), axis=1)
    near: Array = count[:, 2 * spread + 1 :] - count[:, : -2 * spread - 1]
    own = flags[:, spread : flags.shape[1] - spread]
    return np.where((near > 0) | (own > 0.0), 0.0, 1.0)
