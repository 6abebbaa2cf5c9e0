"""Boxes of the tool's room, for pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array

if TYPE_CHECKING:
    from steelyard.robot.excitation_schema import BoxSpans, WorkspaceSection

AXES = "xyz"

Wall = tuple[bool, "BoxSpans"]
"""Whether it is forbidden to be inside, and the box."""


def walls_of(workspace: WorkspaceSection | None) -> list[Wall]:
    """The box of the tool, if it has a wall at all, and those to keep out of."""
    if workspace is None:
        return []
    spans = [getattr(workspace.box, axis) for axis in AXES]
    inside: list[Wall] = [(False, workspace.box)] if any(spans) else []
    return inside + [(True, box) for box in workspace.keep_out]


def corners(box: BoxSpans, seen: Array) -> tuple[Array, Array]:
    """Least and greatest corner, each `(3,)` [m].

    Args:
        box: The box.
        seen: What is drawn, shape `(N, 3)` [m]; where the box is open, it ends with that.
    """
    low, high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
    for k, axis in enumerate(AXES):
        span = getattr(box, axis)
        if span is not None:
            low[k], high[k] = span
    return low, high


def edges(low: Array, high: Array) -> Array:
    """The twelve edges of a box, shape `(12, 2, 3)`."""
    found = []
    for axis in range(3):
        u, v = (k for k in range(3) if k != axis)
        for p in (low, high):
            for r in (low, high):
                ends = np.empty((2, 3))
                ends[:, axis] = low[axis], high[axis]
                ends[:, u], ends[:, v] = p[u], r[v]
                found.append(ends)
    return np.array(found)
