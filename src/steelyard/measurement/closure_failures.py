"""Samples of a run at which a robot's loops cannot close: what to say of them, and the rest."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.kernel.quantities.passive_joints import Follower
from steelyard.measurement.run import Block, Run
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class OpenStretch:
    """Consecutive samples at which a loop cannot close.

    Attributes:
        run: The run's name.
        loop: The loop's name.
        start: Time of the first sample, from the log's start [s].
        stop: Time of the last sample [s].
        gap: How far the loop's points stay apart at the first sample [m].
        samples: Number of samples.
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
                found.append(OpenStretch(run.name, *_named(follower, sample, t)))
    return tuple(found)


def _named(
    follower: Follower, sample: NDArray[np.float64], t: float
) -> tuple[str, float, float, float, int]:
    name, gap = follower.gap(sample)
    return name, t, t, gap, 1


def closed_parts(block: Block, closed: NDArray[np.bool_]) -> list[Block]:
    """The samples of a block at which loops are closed; every gap begins a new segment.

    Args:
        block: Consecutive samples.
        closed: Whether the loops are closed at each, shape `(B,)`.

    Returns:
        Blocks whose segments count on from the block's own by one per sample left out.
    """
    if closed.all():
        return [block]
    labels, parts = np.cumsum(~closed), []
    for label in np.unique(labels[closed]):
        inside = np.flatnonzero(closed & (labels == label))
        part = block.part(int(inside[0]), int(inside[-1]) + 1)
        parts.append(replace(part, segment=block.segment + int(label)))
    return parts
