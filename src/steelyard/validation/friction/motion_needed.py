"""Whether logs contain enough motion for `friction = "auto"`.

Friction laws are compared by leaving out a fifth of the motion (or one run) in turn. Every part
should have motion of every joint at several speeds, over a distance at which laws with internal
states become usable (three of their lengths), and all parts together motion in both directions.
With fewer data no laws can be distinguished; with these, the comparison itself keeps Coulomb
friction unless another law is significantly better.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimation.fold_errors import FOLDS
from steelyard.robot.robot import Coordinate
from steelyard.validation.friction.mixes import LEVER, WIDE

LENGTHS = 3.0
"""Lengths of a law's state that a joint travels until its samples are used."""
SPEEDS = 2.0
"""Fast over slow motion (quantiles 0.9 and 0.1 of the speed) from which on speeds differ."""
SLOWEST = 0.03
"""Speed up to which a joint rests, relative to its fastest."""


@dataclass(frozen=True)
class JointMotion:
    """Motion of one joint over all logs.

    Attributes:
        reversals: Reversals of its direction.
        travel: Distance travelled [rad; m].
        speeds: Fast over slow motion, quantiles 0.9 and 0.1 of the speed in motion.
    """

    reversals: int
    travel: float
    speeds: float


def joint_motions(
    logs: Sequence[tuple[Array, NDArray[np.intp], float]],
) -> tuple[JointMotion, ...]:
    """Motion of each joint.

    Args:
        logs: Of each log velocities, shape `(n, B)` [rad/s; m/s], the number of the stretch that
            each sample lies in, shape `(B,)`, and the time between samples [s].
    """
    n = len(logs[0][0])
    fastest = [max(float(np.quantile(np.abs(dq[j]), 0.98)) for dq, _, _ in logs) for j in range(n)]
    found = []
    for joint in range(n):
        reversals, travel, speeds = 0, 0.0, [np.zeros(0)]
        for dq, stretch, step in logs:
            moving = np.abs(dq[joint]) > SLOWEST * fastest[joint]
            for number in np.unique(stretch[moving]):
                signs = np.sign(dq[joint][moving & (stretch == number)])
                reversals += int(np.count_nonzero(np.diff(signs)))
            travel += float(np.abs(dq[joint]).sum()) * step
            speeds.append(np.abs(dq[joint])[moving])
        every = np.concatenate(speeds)
        slow, fast = np.quantile(every, (0.1, 0.9)) if len(every) else (1.0, 0.0)
        found.append(JointMotion(reversals, travel, float(fast / slow)))
    return tuple(found)


def lacking(motions: Sequence[JointMotion], coordinates: Sequence[Coordinate]) -> tuple[str, ...]:
    """What is missing for `friction = "auto"`, one sentence per joint; none if nothing is."""
    found = []
    for motion, coordinate in zip(motions, coordinates, strict=True):
        size = LEVER if coordinate.kind == "prismatic" else 1.0
        least = FOLDS * LENGTHS * max(WIDE) * size
        if motion.reversals == 0:
            found.append(f"{coordinate.name} moves in one direction only")
        elif motion.travel < least:
            found.append(
                f"{coordinate.name} travels {motion.travel:.2g} {coordinate.unit} "
                f"({least:.2g} needed)"
            )
        elif motion.speeds < SPEEDS:
            found.append(f"{coordinate.name} moves at one speed only")
    return tuple(found)
