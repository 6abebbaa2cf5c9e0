"""Samples of a robot from rows that arrive: units, order, broken rows, delays, missing velocities.

No sample waits for later ones, except as long as signals are declared to be late.
"""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.robot.file.signals import ROW, Signals
from steelyard.robot.robot import Robot
from steelyard.runs.recording import NEAR_END_OF_RANGE, Channels, LogInMemory, Recording
from steelyard.runs.rows.faulty_row_detectors import FASTEST_LOGGED_SPEED, RowVerdict, broken_rows

RESTARTED = 20  # rows with rising times before the latest one, after which the clock was set back
JUMPS_UNTIL_RESTART = 3  # rows whose positions jump that are left out; more are where the robot is
PAUSE_SECONDS = 1.0  # time between a sample and the first one after the clock was set back [s]


@dataclass(frozen=True, eq=False)
class StreamSample:
    """A sample in SI units, its time from the first one, with the row `(columns,)` of that time."""

    t: float
    q: Array
    dq: Array
    effort: Array
    row: Array


class SampleStream:
    """Makes samples of rows.

    Rows that cannot be used are left out and counted: cells that are no numbers, values that no
    sensor can have measured, times that do not rise. Where the clock is set back, time goes on.

    `dropped` counts rows left out by verdict, `restarts` how often the clock was set back; `start`
    is the time of the first sample, as logged [s]; NaN before it.
    """

    def __init__(self, signals: Signals, robot: Robot) -> None:
        self.dropped: Counter[RowVerdict] = Counter()
        self.restarts = 0
        self.start = np.nan
        self._signals = signals
        self._channels = Channels(signals.n, signals.velocity is not None)
        revolute = np.array([c.kind == "revolute" for c in robot.coordinates])
        self._turns = revolute & (signals.position_map is None)
        self._near: Array | None = None
        self._count = 0
        self._late, self._latest = 0, -np.inf
        self._shift, self._last = 0.0, -np.inf
        self._q: Array | None = None
        self._jumps = 0
        lags = {"q": 0.0, "dq": signals.velocity_delay, "effort": signals.effort_delay}
        self._aligned = _Aligned(lags) if any(lags.values()) else None

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the rows that `samples` takes: a row number is counted here."""
        return tuple(name for name in self._signals.columns if name != ROW)

    def samples(self, rows: Array) -> Iterator[StreamSample]:
        """Samples of consecutive rows, shape `(N, len(columns))`."""
        if self._signals.time == ROW:
            numbers = self._count + np.arange(len(rows), dtype=np.float64)
            rows = np.column_stack([numbers, rows])
        self._count += len(rows)
        t, x, verdicts = self._read(rows)
        for k in range(len(t)):
            verdict = RowVerdict(int(verdicts[k]))
            if verdict is RowVerdict.KEPT:
                verdict = self._order(float(t[k])) or self._jump(float(t[k]), x[k])
            if verdict is not RowVerdict.KEPT:
                self.dropped[verdict] += 1
                continue
            sample = self._sample(float(t[k]) + self._shift, x[k], rows[k])
            if sample is not None:
                yield sample

    def _read(self, rows: Array) -> tuple[Array, Array, NDArray[np.uint8]]:
        """Time, channels without jumps of a turn, and what is to be said of each row alone."""
        plain = Recording(LogInMemory(Path("stream"), self._signals.columns, rows), self._signals)
        ((t, x),) = plain.raw((0, None), len(rows))
        verdicts = broken_rows(t, x, self._channels)
        kept = np.flatnonzero(verdicts == RowVerdict.KEPT)
        if len(kept) and self._turns.any():
            near = x[kept[0], self._channels.q] if self._near is None else self._near
            middles = np.where(self._turns, near, np.nan)
            ((t, x),) = replace(plain, middles=middles).raw((0, None), len(rows))
            self._near = x[kept[-1], self._channels.q].copy()
        return t, x, verdicts

    def _order(self, t: float) -> RowVerdict:
        """Whether a time rises; one set back is recognised by rows that follow it."""
        if t + self._shift > self._last:
            self._late, self._latest = 0, -np.inf
            return RowVerdict.KEPT
        if t + self._shift == self._last:
            return RowVerdict.REPEATED
        self._late = self._late + 1 if t > self._latest else 1
        self._latest = t
        if self._late <= RESTARTED:
            return RowVerdict.BACKWARD
        self.restarts += 1
        self._shift = self._last + PAUSE_SECONDS - t
        return RowVerdict.KEPT

    def _jump(self, t: float, x: Array) -> RowVerdict:
        """Whether positions jump farther than joints can move, up to `JUMPS_UNTIL_RESTART`."""
        step = t + self._shift - self._last
        if self._q is None or self._jumps == JUMPS_UNTIL_RESTART:
            self._jumps = 0
            return RowVerdict.KEPT
        far = np.abs(x[self._channels.q] - self._q).max()
        jumps = far > FASTEST_LOGGED_SPEED * step + NEAR_END_OF_RANGE
        self._jumps = self._jumps + 1 if jumps else 0
        return RowVerdict.JUMP if jumps else RowVerdict.KEPT

    def _sample(self, t: float, x: Array, row: Array) -> StreamSample | None:
        c, q = self._channels, x[self._channels.q]
        if np.isnan(self.start):
            self.start = t
        before, step = self._q, t - self._last
        self._last, self._q = t, q
        if c.velocities:
            dq = x[c.dq]
        elif before is None:
            return None
        else:
            dq = (q - before) / step
        logged = row.copy()
        logged[0] = t / self._signals.time_scale
        sample = StreamSample(t - self.start, q, dq, x[c.effort], logged)
        return sample if self._aligned is None else self._aligned(sample)


class _Aligned:
    """Brings signals that are late by so many seconds to one time, by interpolation."""

    def __init__(self, lags: dict[str, float]) -> None:
        self._reach = max(lags.values())
        self._back = {name: self._reach - lag for name, lag in lags.items()}
        self._kept: deque[StreamSample] = deque()

    def __call__(self, sample: StreamSample) -> StreamSample | None:
        """The sample that all signals are known for; `None` before the first."""
        self._kept.append(sample)
        longest = max(self._back.values())
        while len(self._kept) > 2 and self._kept[1].t <= sample.t - longest:
            self._kept.popleft()
        if self._kept[0].t > sample.t - longest:
            return None
        found = {name: self._at(name, sample.t - back) for name, back in self._back.items()}
        return replace(sample, t=sample.t - self._reach, **found)

    def _at(self, name: str, t: float) -> Array:
        times, values = [one.t for one in self._kept], [getattr(one, name) for one in self._kept]
        return np.array([np.interp(t, times, each) for each in zip(*values, strict=True)])
