"""A run: clean motion and effort on a uniform clock, read by parts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.measurement.clock import Clock, Scan
from steelyard.measurement.derivative import smooth_derivatives
from steelyard.measurement.lowpass import low_pass
from steelyard.measurement.parts import apply
from steelyard.measurement.quality import Quality, Segment
from steelyard.measurement.recording import Channels, Recording
from steelyard.measurement.resample import uniform
from steelyard.motion import Motion

BLOCK = 4096
"""Samples of a block."""


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples of a run, joint-major and contiguous for the inner loop.

    Attributes:
        segment: Number of the segment they lie in; gaps lie between segments.
        t: Time from the log's start, shape `(B,)` [s].
        q: Positions, shape `(n, B)` [rad; m].
        dq: Velocities, shape `(n, B)` [rad/s; m/s].
        ddq: Accelerations, shape `(n, B)` [rad/s²; m/s²].
        effort: As logged, not low-passed, shape `(n, B)` [A, Nm or N].
        moving: Whether each joint moves, shape `(n, B)`.
        channels: What a model computed along the motion, shape `(n_channels, B)`; or `None`.
    """

    segment: int
    t: Array
    q: Array
    dq: Array
    ddq: Array
    effort: Array
    moving: NDArray[np.bool_]
    channels: Array | None = None

    def part(self, start: int, stop: int) -> "Block":
        """The samples from `start` to `stop`."""
        q, dq, ddq, effort = (
            np.ascontiguousarray(x[:, start:stop]) for x in (self.q, self.dq, self.ddq, self.effort)
        )
        moving = np.ascontiguousarray(self.moving[:, start:stop])
        channels = self.channels
        if channels is not None:
            channels = np.ascontiguousarray(channels[:, start:stop])
        return Block(self.segment, self.t[start:stop], q, dq, ddq, effort, moving, channels)

    @classmethod
    def joined(cls, blocks: Sequence["Block"]) -> "Block":
        """Consecutive blocks of one segment as one."""
        channels = [b.channels for b in blocks if b.channels is not None]
        return cls(
            blocks[0].segment,
            np.concatenate([b.t for b in blocks]),
            np.concatenate([b.q for b in blocks], axis=1),
            np.concatenate([b.dq for b in blocks], axis=1),
            np.concatenate([b.ddq for b in blocks], axis=1),
            np.concatenate([b.effort for b in blocks], axis=1),
            np.concatenate([b.moving for b in blocks], axis=1),
            np.concatenate(channels, axis=1) if channels else None,
        )


@dataclass(frozen=True, eq=False)
class RunData:
    """A whole run in memory.

    Attributes:
        motion: N samples of n joints.
        effort: As logged, shape `(N, n)` [A, Nm or N].
        moving: Whether each joint moves, shape `(N, n)`.
        segment: Number of the segment of each sample, shape `(N,)`.
    """

    motion: Motion
    effort: Array
    moving: NDArray[np.bool_]
    segment: NDArray[np.intp]

    @property
    def t(self) -> Array:
        """Time from the log's start, shape `(N,)` [s]."""
        return self.motion.t


@dataclass(frozen=True, eq=False)
class Run:
    """A recording, cleaned when it is read: every pass reads the log anew, in constant memory.

    Attributes:
        recording: Where it comes from, with context around a cut for the motion's filter.
        name: The recording's name, with its cut as written.
        clock: The log's clock.
        rate: Of the uniform clock [Hz].
        segments: Stretches without gaps that are long enough for the filters.
        motion_cutoff: Low-pass of positions and velocities [Hz].
        matched_cutoff: Low-pass meant for regressor and effort alike; not applied here [Hz].
        rest_speed: Speed up to which each joint rests, shape `(n,)` [rad/s; m/s].
        span: Times of the first and last motion of any joint, from the log's start [s].
        quality: What was found in the log.
    """

    recording: Recording
    name: str
    clock: Clock
    rate: float
    segments: tuple[Segment, ...]
    motion_cutoff: float
    matched_cutoff: float
    rest_speed: Array
    span: tuple[float, float]
    quality: Quality

    @property
    def effort_units(self) -> tuple[str, ...]:
        """Unit of each effort: `A`, `Nm` or `N`."""
        return tuple(self.recording.signals.effort_units)

    @property
    def duration(self) -> float:
        """Time from first to last motion, without gaps [s]."""
        return self.n_samples / self.rate

    @property
    def n_samples(self) -> int:
        """Number of samples from first to last motion."""
        return sum(max(0, b - a) for a, b in map(self._range, self.segments))

    def blocks(self, size: int = BLOCK) -> Iterator[Block]:
        """Samples from first to last motion, in blocks of at most `size`; can be begun anew."""
        segments = {s.number: s for s in self.segments}
        n = self.recording.channels.joints
        for number, start, signals in filtered(
            self.recording, self.clock, self.rate, self.motion_cutoff, tuple(segments)
        ):
            segment = segments[number]
            first, last = self._range(segment)
            for at in range(max(start, first), min(start + signals.shape[1], last), size):
                stop = min(at + size, start + signals.shape[1], last)
                q, dq, ddq, effort = np.ascontiguousarray(
                    signals[:, at - start : stop - start]
                ).reshape(4, n, -1)
                t = segment.start + np.arange(at, stop) / self.rate
                moving = np.abs(dq) > self.rest_speed[:, None]
                yield Block(number, t, q, dq, ddq, effort, moving)

    def whole(self) -> RunData:
        """All samples from first to last motion, in memory."""
        blocks = list(self.blocks())
        q, dq, ddq, effort = (
            np.concatenate([getattr(b, name) for b in blocks], axis=1).T
            for name in ("q", "dq", "ddq", "effort")
        )
        return RunData(
            Motion(np.concatenate([b.t for b in blocks]), q, dq, ddq),
            np.ascontiguousarray(effort),
            np.concatenate([b.moving for b in blocks], axis=1).T.copy(),
            np.concatenate([np.full(len(b.t), b.segment) for b in blocks]),
        )

    def _range(self, segment: Segment) -> tuple[int, int]:
        """First sample of a segment that is used, and the one after the last."""
        first, last = ((time - segment.start) * self.rate for time in self.span)
        return max(0, int(np.ceil(first - 1e-6))), min(
            segment.samples, int(np.floor(last + 1e-6)) + 1
        )


def filtered(
    recording: Recording, clock: Clock, rate: float, cutoff: float, segments: Sequence[int]
) -> Iterator[tuple[int, int, Array]]:
    """Positions, velocities, accelerations and efforts of segments on the uniform clock.

    Args:
        recording: Raw rows.
        clock: The log's clock.
        rate: [Hz].
        cutoff: Low-pass of positions and velocities [Hz].
        segments: Numbers of the segments wanted.

    Yields:
        Segment, number of the first sample in it, and signals, shape `(4 n, any)`.
    """
    operation = ToMotion(recording.channels, cutoff, rate)
    pieces = Scan(clock, recording).pieces()
    for number, of_segment in groupby(pieces, key=lambda piece: piece.segment):
        if number not in segments:
            continue
        start = 0
        for part in apply(operation, uniform(((p.t, p.x) for p in of_segment), rate)):
            yield number, start, part
            start += part.shape[1]


class ToMotion:
    """Low-pass and derivatives: logged channels to `q, dq, ddq, effort`; an operation with a halo.

    Logged velocities are low-passed and differentiated once; without them positions are
    differentiated twice. Efforts pass unchanged.
    """

    def __init__(self, channels: Channels, cutoff: float, rate: float) -> None:
        self._channels = channels
        self._twice = smooth_derivatives(cutoff, rate, 2)
        self._once = smooth_derivatives(cutoff, rate, 1)
        self._smooth = low_pass(cutoff, rate)

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return self._twice.halo

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)` to signals `(4 n, N)`."""
        c = self._channels
        effort = extended[c.effort, self.halo : extended.shape[1] - self.halo]
        if not c.velocities:
            return np.concatenate((*self._twice(extended[c.q]), effort))
        smooth = self._smooth(extended[c.q])
        return np.concatenate((*smooth, *self._once(extended[c.dq]), effort))
