"""A run: clean motion and effort on a uniform clock, by parts; which samples move, open loops."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen, stretches
from steelyard.base.motion import Motion
from steelyard.model.equations.passive_joints import Follower
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import BASE_COORDINATES, Robot
from steelyard.runs.contact_projection import Touching
from steelyard.runs.first_pass_over_recording import Survey
from steelyard.runs.floating_base import with_base_motion
from steelyard.runs.mean_over_repetitions import Importance
from steelyard.runs.processing_chain import Chain, MotionPart
from steelyard.runs.recording import DEAD, LeftOut, Recording, efforts_left_out
from steelyard.runs.rows.bridged_rows_segments_and_quality import Quality, Segment
from steelyard.runs.rows.clock_and_row_scan import RowScan
from steelyard.runs.sample_cache import BLOCK_SAMPLES, KeptSamples, Source

LEAST_SPREAD = 0.2  # time around a stretch left out that low-passes of 5 Hz mix with it [s]


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples of a run, joint-major and contiguous for the inner loop."""

    segment: int  # number of the segment they lie in; gaps lie between segments
    t: Array  # time from the log's start, shape `(B,)` [s]
    q: Array  # positions, shape `(n, B)` [rad; m], as their derivatives `dq` and `ddq`
    dq: Array
    ddq: Array
    effort: Array  # as logged, not low-passed, shape `(n, B)` [A, Nm or N]
    moving: NDArray[np.bool_]  # whether each joint moves, shape `(n, B)`
    # what a model computed along the motion, shape `(n_channels, B)`; or `None`
    channels: Array | None = None
    # how much each sample of each effort counts, beside `moving`, shape `(n, B)`: 0 where the log
    # is not to be trusted; `None` if all count alike
    weights: Array | None = None
    # which contacts of unknown force touch; `None` if there is none
    touching: Touching | None = None
    # samples at rest that count all the same, shape `(n, B)`; `None` if rests do not count
    resting: NDArray[np.bool_] | None = None

    def part(self, start: int, stop: int) -> "Block":
        """The samples from `start` to `stop`."""
        names = ("q", "dq", "ddq", "effort", "moving", "channels", "weights", "resting")
        given = {name: x for name in names if (x := getattr(self, name)) is not None}
        inside: Any = {name: np.ascontiguousarray(x[:, start:stop]) for name, x in given.items()}
        if self.touching is not None:
            inside["touching"] = self.touching.part(start, stop)
        return replace(self, t=self.t[start:stop], **inside)

    @classmethod
    def joined(cls, blocks: Sequence["Block"]) -> "Block":
        """Consecutive blocks as one, with the segment of the first."""

        def along(name: str) -> Any:
            return np.concatenate([getattr(b, name) for b in blocks], axis=-1)

        motion = {name: along(name) for name in ("t", "q", "dq", "ddq", "effort", "moving")}
        given = ("channels", "resting")
        more = {x: along(x) for x in given if getattr(blocks[0], x) is not None}
        weights = None if all(b.weights is None for b in blocks) else along("counted")
        touching = [b.touching for b in blocks if b.touching is not None]
        found = Touching.joined(touching) if touching else None
        return cls(blocks[0].segment, **motion, **more, weights=weights, touching=found)

    @property
    def counted(self) -> Array:
        """The weights, ones where there are none, shape `(n, B)`."""
        return np.ones(self.moving.shape) if self.weights is None else self.weights


@dataclass(frozen=True, eq=False)
class RunData:
    """A whole run in memory: motion of N samples; effort as logged, shape `(N, n)` [A, Nm or N]."""

    motion: Motion
    effort: Array
    moving: NDArray[np.bool_]  # whether each joint moves, shape `(N, n)`
    segment: NDArray[np.intp]  # number of the segment of each sample, shape `(N,)`
    # how much each sample of each effort counts, see `Block`, shape `(N, n)`; `None` if all count
    # alike
    weights: Array | None = None

    @property
    def t(self) -> Array:
        """Time from the log's start, shape `(N,)` [s]."""
        return self.motion.t


@dataclass(frozen=True, eq=False)
class Moves:
    """Where the joints of a log move."""

    rest_speed: Array  # speed up to which each joint rests, shape `(n,)` [rad/s; m/s]
    span: tuple[float, float]  # first and last motion of any joint, from the log's start [s]

    def beside(self, base: int) -> "Moves":
        """The same of joints beside so many coordinates of a base, which always move."""
        return replace(self, rest_speed=frozen([*np.full(base, -1.0), *self.rest_speed]))


@dataclass(frozen=True, eq=False)
class Run:
    """A recording, cleaned when it is first read, in constant memory.

    Attributes:
        recording: Where it comes from, with context around a cut for the motion's filter.
        name: The recording's name, with its cut as written.
        chain: What is done with its rows.
        segments: Stretches without gaps that are long enough for the filters.
        rest_speed: Speed below which each joint rests, shape `(n,)` [rad/s; m/s]; 0 where none
            does.
        span: Times of the first and last motion of any joint, from the log's start [s].
        judged: Where the joints move by the log alone, whatever rest speed is set: errors count
            these samples.
        quality: What was found in the log.
        importance: Weights of efforts over time, of a mean over repetitions.
        survey: What the first look at the log found, but for its excerpt.
        kept: Motion and efforts, for the next pass.

    Example:
        >>> (run,) = load_runs("arm.toml", "fit.csv")
        >>> run.whole().motion.n_joints
        2
    """

    recording: Recording
    name: str
    chain: Chain
    segments: tuple[Segment, ...]
    rest_speed: Array
    span: tuple[float, float]
    judged: Moves
    quality: Quality
    importance: Importance | None = None
    survey: Survey | None = None
    kept: KeptSamples = field(default_factory=KeptSamples)

    def __repr__(self) -> str:
        joints = self.recording.channels.joints
        size = f"{self.n_samples} samples at {self.rate:g} Hz, {self.duration:.4g} s"
        return f"Run('{self.name}': {joints} joints, {size})"

    @property
    def rate(self) -> float:
        """Rate of the uniform clock [Hz]."""
        return self.chain.rate

    @property
    def motion_cutoff(self) -> float:
        """Low-pass of positions and velocities [Hz]."""
        return self.chain.motion_cutoff

    @property
    def matched_cutoff(self) -> float:
        """Low-pass meant for regressor and effort alike; not applied here [Hz]."""
        return self.chain.matched_cutoff

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
        return sum(max(0, b - a) for a, b in self._ranges.values())

    def blocks(self, size: int = BLOCK_SAMPLES) -> Iterator[Block]:
        """Samples from first to last motion, in blocks of at most `size`; can be begun anew."""
        n, ranges = self.recording.channels.joints, self._ranges
        for part in self._parts(ranges):
            first, last = ranges[part.segment.number]
            begin, end = max(0, first - part.first), min(part.signals.shape[1], last - part.first)
            for at in range(begin, end, size):
                yield self._block(part, slice(at, min(at + size, end)), n)

    def _block(self, part: MotionPart, inside: slice, n: int) -> Block:
        """Some samples of a part."""
        values = np.ascontiguousarray(part.signals[:, inside])
        values.flags.writeable = False
        q, dq, ddq, effort = values[: 4 * n].reshape(4, n, -1)
        touching = None
        if (base := self.recording.signals.base) is not None:
            q, dq, ddq = with_base_motion(base, q, dq, ddq)
            if base.touches:
                touching = Touching.of(base, self.recording.signals.gains, values[4 * n :])
        first = part.first + inside.start
        t = part.segment.start + np.arange(first, first + values.shape[1]) / self.rate
        moving = np.abs(dq) >= self.rest_speed[:, None]
        out = efforts_left_out(t, n, self.recording.left_out, self._spread)
        moving = moving if out is None else moving & ~out
        moving[: self.recording.channels.base] &= base is None or base.wrench_known
        weights = None if part.weights is None else part.weights[:, inside].copy()
        if weights is not None and (weights == 1.0).all():
            weights = None
        if self.importance is not None:
            own = self.importance.at(t)
            weights = own if weights is None else own * weights
        if out is not None:
            weights = np.where(out, 0.0, 1.0 if weights is None else weights)
        number = part.segment.number
        return Block(number, t, q, dq, ddq, effort, moving, weights=weights, touching=touching)

    def _parts(self, ranges: Mapping[int, tuple[int, int]]) -> Iterator[MotionPart]:
        """Parts of all segments; of those that are kept, only what has samples in the ranges."""
        source = self._source
        if self.kept.of(source):
            return self.kept.between(ranges)
        return self.kept.keeping(source, self.chain.parts(self.recording, self.segments))

    def displaced(self, offsets: Array) -> "Run":
        """The run with positions that far from those of the log, shape `(n,)` [rad; m]."""
        given = self.recording.signals.position_offset
        signals = replace(
            self.recording.signals,
            position_offset=frozen(offsets),
            unknown_offsets=(False,) * len(offsets),
        )
        recording = replace(self.recording, signals=signals)
        if not self.kept.of(self._source):
            return replace(self, recording=recording, kept=KeptSamples())
        change = (offsets if given is None else offsets - given)[:, None]
        source = Source(recording, self.chain, self.segments)
        return replace(self, recording=recording, kept=self.kept.displaced(change, source))

    def leaving_out(self, stretches: Sequence[LeftOut]) -> "Run":
        """The run in which efforts of some joints do not count in stretches of time."""
        left_out = (*self.recording.left_out, *stretches)
        return replace(self, recording=replace(self.recording, left_out=left_out))

    def unmeasured(self, t: Array) -> NDArray[np.bool_]:
        """Whether each effort is dead at times `(N,)`, by the log alone, shape `(n, N)`."""
        dead = [stretch for stretch in self.recording.left_out if stretch.reason == DEAD]
        n = self.recording.channels.joints
        out = efforts_left_out(t, n, dead, self._spread)
        return np.zeros((n, len(t)), dtype=np.bool_) if out is None else out

    @property
    def has_unknown_forces(self) -> bool:
        """Whether forces act that are not measured: of contacts, or on a floating base."""
        base = self.recording.signals.base
        return base is not None and (bool(base.touches) or not base.wrench_known)

    def with_forces(self, block: Block, predicted: Array) -> Array:
        """Predicted efforts of a block as logged, `(n, B)`, with unknown forces that fit best."""
        if block.touching is not None:
            predicted = block.touching.with_forces(block.q, block.effort, predicted)
        base, first = self.recording.signals.base, len(BASE_COORDINATES)
        if base is None or base.wrench_known:
            return predicted
        return np.concatenate([block.effort[:first], predicted[first:]])

    def around(self, context: float) -> "Run":
        """The run with that much of its segments before its first and after its last motion [s]."""
        start, stop = self.span
        return replace(self, span=(start - context, stop + context))

    @property
    def _spread(self) -> float:
        """How far filters mix an effort with what is around it [s]."""
        return max(1.0 / self.matched_cutoff, LEAST_SPREAD)

    @property
    def _source(self) -> Source:
        """What its samples are made from."""
        return Source(self.recording, self.chain, self.segments)

    def whole(self) -> RunData:
        """All samples from first to last motion, in memory."""
        blocks = list(self.blocks())
        one = Block.joined(blocks)
        return RunData(
            Motion(one.t, one.q.T, one.dq.T, one.ddq.T),
            np.ascontiguousarray(one.effort.T),
            one.moving.T.copy(),
            np.repeat([b.segment for b in blocks], [len(b.t) for b in blocks]),
            None if one.weights is None else one.weights.T.copy(),
        )

    @property
    def _ranges(self) -> dict[int, tuple[int, int]]:
        """First sample of each segment within the span that is used, and the one after the last."""
        (early, late), ranges = lost_ends(self.recording.signals), {}
        for s in self.segments:
            start = self.rate * (max(self.span[0], s.start + early) - s.start)
            stop = self.rate * (min(self.span[1], s.stop - late) - s.start)
            first, last = max(0, int(np.ceil(start - 1e-6))), int(np.floor(stop + 1e-6))
            ranges[s.number] = first, min(s.samples, last + 1)
        return ranges


def fastest_of(runs: Sequence[Run]) -> Array:
    """Greatest speed of each joint in any of the runs, shape `(n,)` [rad/s; m/s]."""
    return np.asarray(np.max([run.quality.max_speed for run in runs], axis=0))


def lost_ends(signals: Signals) -> tuple[float, float]:
    """How much of a segment's start and end has no value of every signal, for their delays [s]."""
    lags = signals.delays
    return max(0.0, -min(lags)), max(0.0, *lags)


MOST_MOTION_SAMPLES, LEAST_MOTION_SAMPLES = 600, 32
"""Rows that are kept of all runs together, and at least of each."""
MOST_ROWS_OF_RUN = 500_000  # rows of a run that are looked at
SPEED_TIME = 0.1  # time over which a speed is taken to distinguish motion from rest [s]
DIGITS_KEPT = 9  # significant digits that are kept


@dataclass(frozen=True, eq=False)
class MotionRows:
    """Clean rows of a run from first to last motion, as logged; `moving`: whether any joint moves.

    Shapes `(N,)` [s], `(N, n)` [rad; m], `(N, n)` [A, Nm or N] and `(N,)`.
    """

    t: Array
    q: Array
    effort: Array
    moving: NDArray[np.bool_]

    def where(self, kept: NDArray[np.bool_]) -> "MotionRows":
        """Some of the rows, those where `kept`, shape `(N,)`."""
        return MotionRows(self.t[kept], self.q[kept], self.effort[kept], self.moving[kept])


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Rows of a run at which joints move; one of them stands for a time `step` [s].

    Shapes `(M,)` [s], `(M, n)` [rad; m] and `(M, n)` [A, Nm or N].
    """

    run: str
    step: float
    t: Array
    q: Array
    effort: Array

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, with `DIGITS_KEPT` significant digits."""
        arrays = {name: _short(getattr(self, name)) for name in ("t", "q", "effort")}
        return {"run": self.run, "step": self.step, **arrays}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "MotionSamples":
        """The samples that `to_dict` wrote."""
        t = frozen(data["t"])
        q, effort = (frozen(data[name], (len(t), None)) for name in ("q", "effort"))
        return cls(data["run"], float(data["step"]), t, q, effort)


def _short(values: Array) -> Any:
    digits = [float(f"{x:.{DIGITS_KEPT}g}") for x in values.ravel()]
    return np.array(digits).reshape(values.shape).tolist()


def motion_rows(run: Run) -> MotionRows:
    """The rows of a run, the first `MOST_ROWS_OF_RUN` of them."""
    c, (start, stop) = run.recording.channels, run.span
    parts, count = list[tuple[Array, Array]](), 0
    for piece in RowScan(run.chain.clock, run.recording).pieces():
        inside = (piece.t >= start) & (piece.t <= stop)
        parts.append((piece.t[inside], piece.x[inside]))
        count += len(parts[-1][0])
        if count >= MOST_ROWS_OF_RUN:
            break
    t, x = (np.concatenate(part) for part in zip(*parts, strict=True))
    q = x[:, c.q]
    return MotionRows(t, q, x[:, c.effort], _moving(t, q, run.rest_speed))


def _moving(t: Array, q: Array, rest_speed: Array) -> NDArray[np.bool_]:
    if len(t) < 3:
        return np.zeros(len(t), dtype=np.bool_)
    reach = max(1, round(0.5 * SPEED_TIME * (len(t) - 1) / max(t[-1] - t[0], 1e-9)))
    at = np.arange(len(t))
    early, late = np.maximum(at - reach, 0), np.minimum(at + reach, len(t) - 1)
    speed = np.abs(q[late] - q[early]) / np.maximum(t[late] - t[early], 1e-9)[:, None]
    return np.asarray((speed > 2.0 * rest_speed).any(axis=1))


def motion_samples(runs: Sequence[Run]) -> tuple[MotionSamples, ...]:
    """Evenly spread rows of each run at which joints move."""
    whole = max(sum(run.duration for run in runs), 1e-9)
    shares = [round(MOST_MOTION_SAMPLES * run.duration / whole) for run in runs]
    return tuple(
        samples_of_rows(run.name, motion_rows(run), max(LEAST_MOTION_SAMPLES, share))
        for run, share in zip(runs, shares, strict=True)
    )


def samples_of_rows(name: str, rows: MotionRows, count: int = MOST_MOTION_SAMPLES) -> MotionSamples:
    """Evenly spread rows, about `count`, of those at which joints move."""
    at = np.unique(np.linspace(0, len(rows.t) - 1, count).round().astype(int))
    step = float(rows.t[-1] - rows.t[0]) / max(len(at) - 1, 1)
    at = at[rows.moving[at]]
    return MotionSamples(
        name, step, frozen(rows.t[at]), frozen(rows.q[at]), frozen(rows.effort[at])
    )


def spread_samples(run: Run) -> MotionSamples:
    """About `LEAST_MOTION_SAMPLES` samples of a run, on its uniform clock, without another pass."""
    stride, offset, kept = max(run.n_samples // LEAST_MOTION_SAMPLES, 1), 0, list[Block]()
    for block in run.blocks():
        at = np.arange(offset, len(block.t), stride)
        offset = int(at[-1]) + stride - len(block.t) if len(at) else offset - len(block.t)
        at = at[block.moving[:, at].any(axis=0)]
        kept += [block.part(k, k + 1) for k in at.tolist()]
    t = np.array([one.t[0] for one in kept])
    q, effort = (
        np.reshape([getattr(one, name)[:, 0] for one in kept], (len(kept), -1))
        for name in ("q", "effort")
    )
    return MotionSamples(run.name, stride / run.rate, frozen(t), frozen(q), frozen(effort))


@dataclass(frozen=True)
class OpenStretch:
    """Consecutive samples at which a loop cannot close, from first to last [s].

    The loop's points stay apart by `gap` at the first sample [m].
    """

    run: str
    loop: str
    start: float
    stop: float
    gap: float
    samples: int

    def __str__(self) -> str:
        return (
            f"{self.run}: loop '{self.loop}' does not close from {self.start:.4f} s to "
            f"{self.stop:.4f} s, closure error {self.gap:.3g} m at first: "
            f"{self.samples} samples left out"
        )


def open_stretches(run: Run, robot: Robot) -> tuple[OpenStretch, ...]:
    """The stretches of a run that are left out where open loops are dropped; none for a tree."""
    if not robot.passive:
        return ()
    found: list[OpenStretch] = []
    segment, follower, within = -1, Follower(robot), False
    for block in run.blocks():
        if block.segment != segment:
            segment, follower, within = block.segment, Follower(robot), False
        for sample, t in zip(np.ascontiguousarray(block.q.T), block.t.tolist(), strict=True):
            if follower.step(sample):
                within = False
            elif within:
                found[-1] = replace(found[-1], stop=t, samples=found[-1].samples + 1)
            else:
                within = True
                name, gap = follower.gap(sample)
                found.append(OpenStretch(run.name, name, t, t, gap, 1))
    return tuple(found)


def closed_parts(block: Block, closed: NDArray[np.bool_]) -> list[Block]:
    """The samples of a block at which loops are `closed`, `(B,)`; every gap begins a new segment.

    Segments count on from the block's own by one per sample left out.
    """
    if closed.all():
        return [block]
    numbers = (block.segment + np.cumsum(~closed)).tolist()
    return [replace(block.part(a, b), segment=numbers[a]) for a, b in stretches(closed)]
