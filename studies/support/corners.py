"""How far a tool goes beyond the corners of its path."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AFTER = 0.3
"""Time around a corner within which the tool may overshoot [s]."""


def corners(desired: Array) -> list[int]:
    """Samples at which the tool should be at a corner, the first one included: where it turns.

    Args:
        desired: Positions of the tool as they should be, shape `(N, 3)` [m].
    """
    steps = np.diff(desired, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    moving = np.flatnonzero(lengths > 1e-6)
    ways = steps[moving] / lengths[moving, None]
    turns = np.flatnonzero(np.sum(ways[1:] * ways[:-1], axis=1) < 0.7)
    return [0, *(moving[turns] + 1).tolist()]


def overshoot(t: Array, desired: Array, tool: Array) -> float:
    """Mean distance that the tool goes beyond a corner, along the edge that it came [m].

    Args:
        t: Times, shape `(N,)` [s].
        desired: Positions of the tool as they should be, shape `(N, 3)` [m].
        tool: As they are, likewise.
    """
    places = corners(desired)
    beyond = []
    for before, here in zip(places[:-1], places[1:], strict=True):
        edge = desired[here] - desired[before]
        edge = edge / np.linalg.norm(edge)
        rows = (t >= t[here] - AFTER) & (t <= t[here] + AFTER)
        beyond.append(((tool[rows] - desired[here]) @ edge).max())
    return float(np.mean(beyond))
