"""How long a motion stands still on its way."""

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.trajectories.exact import ExactTrajectory

INSIDE = (0.1, 0.5, 0.9)
"""Places between two breaks at which a motion that stands still is looked at."""
STILL = 1e-9
"""Speed below which all joints stand still, over the motion's highest."""
SHORTEST = 1e-3
"""Shortest time that counts as a hold [s]."""


def holds(motion: ExactTrajectory) -> Array:
    """Times for which all joints stand still, in their order [s]."""
    starts, ends = motion.breaks[:-1], motion.breaks[1:]
    fastest = max(float(np.max(np.abs(side))) for side in motion.extremes(1))
    times = starts[:, None] + np.outer(ends - starts, INSIDE)
    speeds = np.abs(motion.derivative(times.ravel(), 1)).reshape(*times.shape, -1)
    still = np.all(speeds <= STILL * fastest, axis=(1, 2))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False]))))
    lengths = np.array([motion.breaks[b] - motion.breaks[a] for a, b in edges.reshape(-1, 2)])
    return lengths[lengths >= SHORTEST]


def holds_note(motion: ExactTrajectory) -> tuple[str, ...]:
    """One note on how often and how long a motion stands still; none if it never does."""
    found = holds(motion)
    if not len(found):
        return ()
    least, most = float(found.min()), float(found.max())
    same = most - least <= 1e-6 * most
    each = f"{most:.3g} s each time" if same else f"{least:.3g} to {most:.3g} s each time"
    times = "once" if len(found) == 1 else f"{len(found)} times"
    return (f"all joints are at standstill {times}: {each}, {found.sum():.3g} s in all",)
