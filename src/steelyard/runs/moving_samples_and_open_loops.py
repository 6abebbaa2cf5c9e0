"""Samples of a run: those at which joints move, and those at which loops cannot close."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.model.equations.passive_joints import Follower
from steelyard.robot.robot import Robot
from steelyard.runs.rows.clock_and_row_scan import RowScan
from steelyard.runs.run import Block, Run

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
    parts, count = [], 0
    for piece in RowScan(run.chain.clock, run.recording).pieces():
        inside = (piece.t >= start) & (piece.t <= stop)
        parts.append((piece.t[inside], piece.x[inside]))
        count += len(parts[-1][0])
        if count >= MOST_ROWS_OF_RUN:
            break
    t = np.concatenate([t for t, _ in parts])
    x = np.concatenate([x for _, x in parts])
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
    labels, parts = np.cumsum(~closed), []
    for label in np.unique(labels[closed]):
        inside = np.flatnonzero(closed & (labels == label))
        part = block.part(int(inside[0]), int(inside[-1]) + 1)
        parts.append(replace(part, segment=block.segment + int(label)))
    return parts
