"""The path of the tool, in space and from three sides, with the walls of its room as rectangles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.collision.solids_and_shapes import axes_along
from steelyard.excite.collision.workspace_from_tables import up_of
from steelyard.excite.constraints.tool_workspace import Marker
from steelyard.excite.page.design_text import DesignContent
from steelyard.model.equations.passive_joints import passive_positions
from steelyard.report.page import Numbers, Section, packed, rounded, script_json
from steelyard.report.page_figures import in_space, line, space_layout
from steelyard.report.words import significant
from steelyard.robot.file.excitation_sections import BoxSpans, WorkspaceSection
from steelyard.robot.robot import Robot, body_frames, frame_origins, sticks

SPACE_AXES = "xyz"
OPEN_WALL_LENGTH = 0.1  # a wall without an end is drawn so far beyond what is seen [m]
LINES_OF_OPEN_FACE = 7  # lines each way of a face that goes on


@dataclass(frozen=True, eq=False)
class Face:
    """A rectangle of a wall, from a corner along two edges `(2, 3)` [m], like that of `floor`.

    Per side whether the wall ends there, or goes on; and whether it is of a box to keep out of.
    """

    corner: Array
    edges: Array
    closed: tuple[bool, bool]
    forbidden: bool
    name: str

    def lines(self) -> Array:
        """Its outline, or lines across it with none where it goes on, shape `(L, 2, 3)` [m]."""
        found, shares = [], np.linspace(0.0, 1.0, 2 if all(self.closed) else LINES_OF_OPEN_FACE)
        for side, closed in enumerate(self.closed):
            for share in shares if closed else shares[1:-1]:
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
    for axis, span in enumerate(box.spans):
        u, v = (k for k in range(3) if k != axis)
        size = np.zeros((2, 3))
        size[0, u], size[1, v] = high[u] - low[u], high[v] - low[v]
        closed = (box.spans[u] is not None, box.spans[v] is not None)
        for level in span or ():
            corner = low.copy()
            corner[axis] = level
            yield Face(corner, size, closed, forbidden, name)


def _of_plane(normal: Array, above: float, seen: Array, name: str) -> Face:
    length = float(np.linalg.norm(normal))
    axes = axes_along(normal)
    inside = (seen @ axes)[:, :2]
    low = np.nanmin(inside, axis=0) - OPEN_WALL_LENGTH
    high = np.nanmax(inside, axis=0) + OPEN_WALL_LENGTH
    corner = axes @ np.array([*low, above / length])
    edges = (axes[:, :2] * (high - low)).T
    return Face(corner, edges, (False, False), False, name)


def box_corners(box: BoxSpans, seen: Array) -> tuple[Array, Array]:
    """Least and greatest corner, each `(3,)` [m]; an open side goes beyond what is drawn."""
    low = np.nanmin(seen, axis=0) - OPEN_WALL_LENGTH
    high = np.nanmax(seen, axis=0) + OPEN_WALL_LENGTH
    for k, span in enumerate(box.spans):
        if span is not None:
            low[k], high[k] = span
    return low, high


def face_segment(face: Face, a: int, b: int) -> Array | None:
    """The face as a line in the plane of two axes, shape `(2, 2)` [m]; `None` if seen flat on."""
    normal = np.cross(face.edges[0], face.edges[1])
    if abs(normal[3 - a - b]) > 1e-9 * np.linalg.norm(normal):
        return None
    ends = [face.corner, *(face.corner + edge for edge in (*face.edges, face.edges.sum(axis=0)))]
    flat = np.array(ends)[:, [a, b]]
    far = int(np.argmax(np.linalg.norm(flat - flat[0], axis=1)))
    return flat[[0, far]]


def all_lines(faces: Sequence[Face]) -> Array:
    """The lines of faces, shape `(L, 2, 3)` [m]."""
    return np.concatenate([face.lines() for face in faces]) if faces else np.zeros((0, 2, 3))


def tool_path(robot: Robot, tool: Marker, joints: Array) -> Array:
    """Positions of the tool's centre, shape `(N, 3)` [m]."""
    return frame_origins(robot, [tool.on(robot)], joints)[:, 0]


def skeleton(robot: Robot, tool: Marker, joints: Array) -> Array:
    """The robot as one broken line, from each joint to the next, and to the tool.

    Two ends and a gap of NaN per stick, shape `(3 sticks, 3)` [m], at positions of all joints.
    """
    last = tool.on(robot)
    ends = frame_origins(robot, [body_frames(robot)[last.body + 1], last], joints[None])[0]
    return np.concatenate([sticks(robot, joints), ends, np.full((1, 3), np.nan)])


TOOL_PATH_POINTS = 1500  # points of the path

VIEWS = (("from above", 0, 1), ("from the side", 0, 2), ("from the front", 1, 2))
PATH, ARM, PALE, START = "--blue", "--arm", "--pale", "--green"
TIME_COLOURS = [[0.0, "--blue"], [0.5, "--purple"], [1.0, "--amber"]]  # along the path

WALL, FORBIDDEN = "--poor", "--forbidden"


class DesignToolSection(
    Section, name="design-tool", title="Path of the tool", template="design_tool.html"
):
    """A picture in space, and one from each side."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """Path, arm and walls."""
        designed = content.design
        robot, tool = designed.robot, designed.tool
        t = np.linspace(0.0, designed.trajectory.duration, TOOL_PATH_POINTS)
        q = designed.trajectory.derivative(t, 0)
        joints = np.hstack([q, passive_positions(robot, q.T).T])
        path = tool_path(robot, tool, joints)
        arm = skeleton(robot, tool, joints[0])
        drawn = np.concatenate([path, arm])
        faces = faces_of(content.workspace, robot, drawn)
        workspace = content.workspace
        forbidden = () if workspace is None else workspace.keep_out
        boxes = [box_corners(box, drawn) for box in forbidden]
        return {
            "tool": tool.title,
            "radius": f"{1e3 * tool.radius:.3g} mm" if tool.radius > 0.0 else "",
            "spans": ", ".join(
                f"{axis} from {low:.3f} to {high:.3f} m"
                for axis, low, high in zip(
                    SPACE_AXES, path.min(axis=0), path.max(axis=0), strict=True
                )
            ),
            "length": significant(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())),
            "walls": list(dict.fromkeys(face.name for face in faces if not face.forbidden)),
            "forbidden": bool(boxes),
            "space": script_json(_space(t, path, arm, faces)),
            "views": [
                (words, script_json(_view(path, arm, faces, boxes, a, b))) for words, a, b in VIEWS
            ],
        }


def _space(t: Array, path: Array, arm: Array, faces: Sequence[Face]) -> dict[str, Any]:
    way = in_space(
        "tool",
        path,
        line={
            "width": 4,
            "color": packed(t),
            "colorscale": TIME_COLOURS,
            "showscale": True,
            "colorbar": {"title": {"text": "time [s]"}, "thickness": 10, "len": 0.7},
        },
        hovertemplate="%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>",
    )
    body = in_space(
        "arm at the start",
        arm,
        mode="lines+markers",
        line={"color": ARM, "width": 7},
        marker={"color": ARM, "size": 3},
        hoverinfo="skip",
    )
    walls = []
    for name in dict.fromkeys(face.name for face in faces):
        # faces of one name as one broken line
        own = [face for face in faces if face.name == name]
        lines = all_lines(own)
        gaps = np.full((len(lines), 1, 3), np.nan)
        wall = in_space(
            name,
            np.concatenate([lines, gaps], axis=1).reshape(-1, 3),
            mode="lines",
            opacity=1.0 if own[0].forbidden else 0.4,
            line={"color": WALL, "width": 2},
            hovertemplate=f"{name}<extra></extra>",
        )
        walls.append(wall)
    return {"x": "", "y": "", "traces": [way, body, *walls], "layout": space_layout()}


def _view(
    path: Array, arm: Array, faces: Sequence[Face], boxes: list[tuple[Array, Array]], a: int, b: int
) -> dict[str, Any]:
    """What is seen along one axis, both scales alike."""

    def seen(name: str, at: Array, colour: str, width: float, **more: Any) -> dict[str, Any]:
        return line(name, at[:, a], at[:, b], colour, width=width, **more)

    joints = {"mode": "lines+markers", "marker": {"color": ARM, "size": 6}, "hoverinfo": "skip"}
    traces = [
        seen("arm at the start", arm, PALE, 4.0, **joints),
        seen("tool", path, PATH, 1.3, hovertemplate="%{x:.3f}, %{y:.3f} m<extra></extra>"),
        seen("start", path[:1], START, 1.0, mode="markers", marker={"color": START, "size": 8}),
    ]
    filled = {"type": "rect", "fillcolor": FORBIDDEN, "layer": "below"}
    shapes = [_line(np.stack([low[[a, b]], high[[a, b]]])) | filled for low, high in boxes]
    edges = [face_segment(face, a, b) for face in faces if not face.forbidden]
    shapes += [_line(ends) for ends in edges if ends is not None]
    return {
        "x": f"{SPACE_AXES[a]} [m]",
        "y": f"{SPACE_AXES[b]} [m]",
        "traces": traces,
        "layout": {
            "yaxis": {"scaleanchor": "x", "constrain": "domain"},
            "xaxis": {"constrain": "domain"},
            "shapes": shapes,
            "showlegend": False,
        },
    }


def _line(ends: Array) -> dict[str, Any]:
    """A wall from end to end, shape `(2, 2)` [m]."""
    return {
        "type": "line",
        **{"x0": rounded(ends[0, 0]), "x1": rounded(ends[1, 0])},
        **{"y0": rounded(ends[0, 1]), "y1": rounded(ends[1, 1])},
        "line": {"color": WALL, "width": 1.2, "dash": "dot"},
    }
