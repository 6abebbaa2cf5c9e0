"""Walls of the room as rectangles that are drawn: boxes, planes and the floor."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.collision.shape_kinematics import axes_along
from steelyard.excite.collision.workspace_from_tables import up_of
from steelyard.robot.file.excitation_sections import BoxSpans, WorkspaceSection
from steelyard.robot.robot import Robot

SPACE_AXES = "xyz"
OPEN_WALL_LENGTH = 0.1  # a wall without an end is drawn so far beyond what is seen [m]
LINES_OF_OPEN_FACE = 7  # lines each way of a face that goes on


@dataclass(frozen=True, eq=False)
class Face:
    """A rectangle of a wall, from a corner along two edges `(2, 3)` [m], like that of `floor`.

    Per side whether the wall ends at its beginning and at its end; and whether it is of a box to
    keep out of.
    """

    corner: Array
    edges: Array
    ends: tuple[tuple[bool, bool], tuple[bool, bool]]
    forbidden: bool
    name: str

    @property
    def normal(self) -> Array:
        """Of length one, shape `(3,)`."""
        normal = np.cross(self.edges[0], self.edges[1])
        return np.asarray(normal / np.linalg.norm(normal))

    def lines(self) -> Array:
        """Its outline, or lines across it with none where it goes on, shape `(L, 2, 3)` [m]."""
        closed = all(end for side in self.ends for end in side)
        found, shares = [], np.linspace(0.0, 1.0, 2 if closed else LINES_OF_OPEN_FACE)
        for side, (begins, stops) in enumerate(self.ends):
            own = shares[0 if begins else 1 : len(shares) if stops else -1]
            for share in own:
                first = self.corner + share * self.edges[side]
                found.append((first, first + self.edges[1 - side]))
        return np.array(found)


def faces_of(workspace: WorkspaceSection | None, robot: Robot, seen: Array) -> tuple[Face, ...]:
    """All walls of a room, beside what is drawn (`seen`, shape `(N, 3)` [m], NaN for gaps)."""
    if workspace is None:
        return ()
    found = [*_of_box(workspace.box, seen, "box of the tool", forbidden=False)]
    for number, box in enumerate(workspace.keep_out, start=1):
        found += _of_box(box, seen, f"forbidden box {number}", forbidden=True)
    for number, plane in enumerate(workspace.planes, start=1):
        found.append(_of_plane(np.array(plane.normal), plane.above, seen, f"plane {number}"))
    if workspace.floor is not None:
        found.append(_of_plane(up_of(robot), workspace.floor, seen, "floor"))
    return tuple(found)


def _of_box(box: BoxSpans, seen: Array, name: str, *, forbidden: bool) -> Iterator[Face]:
    low, high = box_corners(box, seen)
    spans = [getattr(box, axis) for axis in SPACE_AXES]
    for axis, span in enumerate(spans):
        u, v = (k for k in range(3) if k != axis)
        size = np.zeros((2, 3))
        size[0, u], size[1, v] = high[u] - low[u], high[v] - low[v]
        closed = [spans[k] is not None for k in (u, v)]
        for level in span or ():
            corner = low.copy()
            corner[axis] = level
            ends = ((closed[0], closed[0]), (closed[1], closed[1]))
            yield Face(corner, size, ends, forbidden, name)


def _of_plane(normal: Array, above: float, seen: Array, name: str) -> Face:
    length = float(np.linalg.norm(normal))
    axes = axes_along(normal)
    inside = (seen @ axes)[:, :2]
    low = np.nanmin(inside, axis=0) - OPEN_WALL_LENGTH
    high = np.nanmax(inside, axis=0) + OPEN_WALL_LENGTH
    corner = axes @ np.array([*low, above / length])
    edges = (axes[:, :2] * (high - low)).T
    return Face(corner, edges, ((False, False), (False, False)), False, name)


def box_corners(box: BoxSpans, seen: Array) -> tuple[Array, Array]:
    """Least and greatest corner, each `(3,)` [m]; an open side goes beyond what is drawn."""
    low = np.nanmin(seen, axis=0) - OPEN_WALL_LENGTH
    high = np.nanmax(seen, axis=0) + OPEN_WALL_LENGTH
    for k, axis in enumerate(SPACE_AXES):
        span = getattr(box, axis)
        if span is not None:
            low[k], high[k] = span
    return low, high


def face_segment(face: Face, a: int, b: int) -> Array | None:
    """The face as a line in the plane of two axes, shape `(2, 2)` [m]; `None` if seen flat on."""
    across = 3 - a - b
    if abs(face.normal[across]) > 1e-9:
        return None
    ends = [face.corner, *(face.corner + edge for edge in (*face.edges, face.edges.sum(axis=0)))]
    flat = np.array(ends)[:, [a, b]]
    far = int(np.argmax(np.linalg.norm(flat - flat[0], axis=1)))
    return flat[[0, far]]


def all_lines(faces: Sequence[Face]) -> Array:
    """The lines of faces, shape `(L, 2, 3)` [m]."""
    return np.concatenate([face.lines() for face in faces]) if faces else np.zeros((0, 2, 3))
