"""Joints, tool and walls of the workspace in space, for pictures of a motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.collision.cell import up_of
from steelyard.excite.collision.robot_shapes import along
from steelyard.model.equations.kinematics import frame_of
from steelyard.robot.robot import Frame, Robot, body_frames, frame_origins, sticks

if TYPE_CHECKING:
    from steelyard.excite.constraints.markers import Marker
    from steelyard.robot.file.excitation_sections import WorkspaceSection
    from steelyard.robot.file.motion_sections import BoxSpans
    from steelyard.robot.robot import Robot


SPACE_AXES = "xyz"

OPEN_WALL_LENGTH = 0.1
"""A wall without an end is drawn so far beyond what is seen [m]."""

LINES_OF_OPEN_FACE = 7
"""Lines each way of a face that goes on."""


@dataclass(frozen=True, eq=False)
class Face:
    """A rectangle of a wall.

    Attributes:
        corner: Shape `(3,)` [m].
        edges: From the corner along its two sides, shape `(2, 3)` [m].
        ends: Per side whether the wall ends at its beginning and at its end, shape `(2, 2)`.
        forbidden: Whether it belongs to a box that is kept out of.
        name: Such as `floor`, `plane 1` or `forbidden box 1`.
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
    """All walls of a room.

    Args:
        workspace: Its tables.
        robot: Says where up is.
        seen: What else is drawn, shape `(N, 3)` [m], NaN for gaps.
    """
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
    """The faces that a box has."""
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
    """A piece of a plane beside what is seen."""
    length = float(np.linalg.norm(normal))
    axes = along(normal / length)
    inside = (seen @ axes)[:, :2]
    low, high = (
        np.nanmin(inside, axis=0) - OPEN_WALL_LENGTH,
        np.nanmax(inside, axis=0) + OPEN_WALL_LENGTH,
    )
    corner = axes @ np.array([*low, above / length])
    edges = (axes[:, :2] * (high - low)).T
    return Face(corner, edges, ((False, False), (False, False)), False, name)


def box_corners(box: BoxSpans, seen: Array) -> tuple[Array, Array]:
    """Least and greatest corner, each `(3,)` [m].

    Args:
        box: The box.
        seen: What is drawn, shape `(N, 3)` [m]; an open side goes beyond that.
    """
    low, high = (
        np.nanmin(seen, axis=0) - OPEN_WALL_LENGTH,
        np.nanmax(seen, axis=0) + OPEN_WALL_LENGTH,
    )
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
    way = flat - flat[0]
    far = int(np.argmax(np.linalg.norm(way, axis=1)))
    return flat[[0, far]]


def all_lines(faces: Sequence[Face]) -> Array:
    """The lines of faces, shape `(L, 2, 3)` [m]."""
    return np.concatenate([face.lines() for face in faces]) if faces else np.zeros((0, 2, 3))


def tool_frame(robot: Robot, tool: Marker) -> Frame:
    """The tool's centre, as a frame on its body."""
    own = frame_of(robot, tool.frame)
    return Frame(own.name, own.body, own.rotation, own.position + own.rotation @ tool.offset)


def tool_path(robot: Robot, tool: Marker, joints: Array) -> Array:
    """Positions of the tool's centre, shape `(N, 3)` [m]."""
    return frame_origins(robot, [tool_frame(robot, tool)], joints)[:, 0]


def skeleton(robot: Robot, tool: Marker, joints: Array) -> Array:
    """The robot as one broken line, from each joint to the next, and to the tool.

    Args:
        robot: The robot.
        tool: Its tool.
        joints: Positions of all joints, shape `(n_joints,)`.

    Returns:
        Two ends and a gap of NaN per stick, shape `(3 sticks, 3)` [m].
    """
    last = tool_frame(robot, tool)
    ends = frame_origins(robot, [body_frames(robot)[last.body + 1], last], joints[None])[0]
    return np.concatenate([sticks(robot, joints), ends, np.full((1, 3), np.nan)])
